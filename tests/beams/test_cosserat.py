"""Cosserat rod against rigid-body mechanics, closed forms, the audit's numbers and itself halved.

Derivatives for comparison are taken by complex steps through the kernels' outputs.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from support.beam_kinds import STEP, derivative, located, state

from softrobot_env.beams.cosserat import GRIDS, CosseratRod, dynamics
from softrobot_env.beams.numerics import quaternions
from softrobot_env.robots import ARM, CANTILEVER_STIFF, CANTILEVER_WEAK, RobotParams, Tendon
from softrobot_env.robots.loads import Load
from studies.truths.analytic import section, torsion_angle
from studies.truths.spatial_rod import dead_loads, followed_rod
from studies.truths.varying_beam import bending_frequencies

WEIGHTLESS = replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, 0.0))
TWISTY = replace(WEIGHTLESS, poisson_ratio=0.49, gravity=(1.0, -2.0, 3.0))
WEIGHTINGS = [1, 2, 3, 4, 5]


def shaken(model):
    """A strongly deformed, moving state of unit quaternions."""
    q, v = state(model)
    dynamics.project(model.data, q, v)
    return q, v


def posed(model, *strain):
    """Coordinates of a chain of unstretched segments whose sections turn by strain (3,) * s."""
    home = 1.0 if model.grid == "middles" else 0.5  # a segment turns with the section there
    places = model.data.spacing * (np.arange(model.pieces) + home)
    turns = Rotation.from_rotvec(np.outer(places, strain))
    q, axis = model.rest(), turns.as_matrix()[:, :, 2]
    blocks = q[: 7 * model.pieces].reshape(-1, 7)
    blocks[:, :3] = np.cumsum(model.data.segments[:, None] * axis, axis=0)
    blocks[:, 3:] = turns.as_quat(scalar_first=True)
    return q


def twisted(model, rate):
    return posed(model, 0, 0, rate)


# ---------------------------------------------------------------- rotations


@pytest.mark.parametrize("angle", [1e-6, 0.05, 0.0999, 0.1002, 0.7, 1.5])
def test_weightings_are_those_of_the_thesis(angle):
    c, weighting = np.cos(angle), quaternions.weighting.py_func  # quicker than compiling it
    expected = [1, np.sqrt(2 / (1 + c)), 1 / c, 2 / (1 + c), angle / np.sin(angle)]
    axis = np.sin(angle) * np.array([2, -1, 2]) / 3
    for kind, xi in zip(WEIGHTINGS, expected, strict=True):
        found, slope = weighting(kind, (c, *axis))
        assert found == pytest.approx(xi, rel=1e-14)
        # By theta, along which the real part falls with -sin(theta).
        moved = np.cos(angle + 1j * STEP), *(axis * (1 + 1j * STEP * c / np.sin(angle)))
        by_angle = weighting(kind, moved)[0].imag / STEP
        assert -slope * np.sin(angle) == pytest.approx(by_angle, rel=1e-10, abs=1e-13)


def test_opposite_quaternions_are_the_same_rotation():
    model = CosseratRod(TWISTY, 4)
    q, v = shaken(model)
    a = model.acceleration(q, v)
    flipped, sign = q.copy(), np.ones(model.n)
    sign[7 + 3 : 14] = -1
    flipped *= sign
    np.testing.assert_allclose(model.acceleration(flipped, sign * v) * sign, a, rtol=1e-9)
    assert model.potential_energy(flipped) == pytest.approx(model.potential_energy(q), rel=1e-13)


@pytest.mark.parametrize("grid", GRIDS)
def test_curvature_is_the_angle_per_length(grid):
    model = CosseratRod(WEIGHTLESS, 3, grid=grid)
    np.testing.assert_allclose(
        model.curvature(posed(model, 0, 7.0, 0)), [[0, 7.0, 0]] * 3, atol=1e-12
    )
    np.testing.assert_allclose(model.curvature(twisted(model, 7.0)), [[0, 0, 7.0]] * 3, atol=1e-12)
    assert model.twist(twisted(model, 7.0)) == pytest.approx(3.5, rel=1e-13)


# ---------------------------------------------------------------- equations of motion


def test_a_free_section_precesses_as_euler_says():
    # Too fast for its elasticity: the section moves on its own. A disc, J = (1, 1, 2) J_x, spinning
    # with w_z nods in its frame with (J_z - J_x) / J_x w_z = w_z.
    model = CosseratRod(replace(WEIGHTLESS, youngs_modulus=10.0, damping_time=0.0), 1)
    rate, nod = 3e6, 2e6
    start = model.start()
    start.v[3:7] = 0, nod / 2, 0, rate / 2
    time = 1.3e-6
    end = model.simulate(time, start=start, method="rk4", step=1e-9).end
    p, dp = end.q[3:7], end.v[3:7]
    w = 2 * np.array(quaternions.quotient(tuple(p), tuple(dp))[1:])
    np.testing.assert_allclose(w, [nod * np.cos(rate * time), nod * np.sin(rate * time), rate])
    momentum = Rotation.from_quat(p, scalar_first=True).apply(np.array([1, 1, 2]) * w)
    np.testing.assert_allclose(momentum, [nod, 0, 2 * rate], atol=1e-9 * rate)


def test_damping_takes_its_power_from_the_strain_rates():
    damped = CosseratRod(TWISTY, 4, grid="thesis")
    undamped = CosseratRod(replace(TWISTY, damping_time=0.0), 4, grid="thesis")
    q, v = shaken(damped)
    zero = np.zeros(damped.n)
    power = v @ (damped.residual(q, v, zero) - undamped.residual(q, v, zero))
    d, rod = damped.data.spacing, section(TWISTY, 0.75)

    def strains(x):
        kappa = dynamics.curvatures(dynamics.sections(x, 4), -1, damped.data.cells, 5)
        blocks = x.reshape(4, 7)
        edges = np.diff(np.vstack((np.zeros(3), blocks[:, :3])), axis=0) / d
        p = blocks[:, 3:] / np.sqrt((blocks[:, 3:] ** 2).sum(axis=1))[:, None]
        gamma = [
            np.array(quaternions.rotate_back(tuple(r), tuple(e)))
            for r, e in zip(p, edges, strict=True)
        ]
        return np.concatenate((kappa[:4], gamma))

    rates = derivative(strains, q, v)
    bending, stretching = [rod.bending] * 2 + [rod.torsion], [rod.shear] * 2 + [rod.axial]
    lengths = d * np.array([0.5, 1, 1, 1])
    expected = lengths @ rates[:4] ** 2 @ bending + d * (rates[4:] ** 2).sum(axis=0) @ stretching
    assert power == pytest.approx(TWISTY.damping_time * expected, rel=1e-10)


# ---------------------------------------------------------------- quaternion norm


@pytest.mark.parametrize("rate", [0.0, 8.0])
def test_the_norm_drifts_or_decays(rate):
    model = CosseratRod(WEIGHTLESS, 2, grid="thesis", baumgarte=rate)
    start = model.rest()
    start[3:7] *= 1.01
    time, excess = 0.3, 1.01**2 - 1
    # By SciPy: our integrators project the drift away.
    y, right_side = np.append(start, 0 * start), model.first_order(np.empty(0))
    solution = solve_ivp(right_side, (0, time), y, rtol=1e-8, atol=1e-12)
    end = solution.y[:14, -1]
    expected = excess * (1 + rate * time) * np.exp(-rate * time)
    assert end[3:7] @ end[3:7] - 1 == pytest.approx(expected, rel=1e-5)
    # Unit quaternions are not disturbed, nor is the pose by the wrong one.
    np.testing.assert_allclose(end[10:14], [1, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(end[[2, 9]], [0.25, 0.5], rtol=1e-12)


def test_projection_normalises_and_leaves_the_motion():
    model = CosseratRod(TWISTY, 3)
    q, v = state(model)
    assert model.constraint_drift(q) > 0.01
    projected, velocity = q.copy(), v.copy()
    dynamics.project(model.data, projected, velocity)
    assert model.constraint_drift(projected) < 1e-15
    blocks = projected.reshape(3, 7)[:, 3:], velocity.reshape(3, 7)[:, 3:]
    np.testing.assert_allclose((blocks[0] * blocks[1]).sum(axis=1), 0, atol=1e-14)
    before, after = model.momentum(q, v), model.momentum(projected, velocity)
    np.testing.assert_allclose(after, before, rtol=1e-12)
    assert model.potential_energy(projected) == pytest.approx(model.potential_energy(q), rel=1e-12)


def test_tangent_spans_the_directions_that_keep_the_norm():
    model = CosseratRod(TWISTY, 3, clamped=False)
    q, _ = shaken(model)
    tangent = model.tangent(q)
    assert tangent.shape == (24, 21)
    assert np.linalg.matrix_rank(tangent) == 21
    for k in range(3):
        norm = np.zeros(24)
        norm[7 * k + 3 : 7 * k + 7] = q[7 * k + 3 : 7 * k + 7]
        np.testing.assert_allclose(norm @ tangent, 0, atol=1e-15)


# ---------------------------------------------------------------- points, loads and tendons

PLACES = np.array([0.0, 0.03, 0.125, 0.2, 0.3, 0.41, 0.5])
SIDES = np.array([[0.02, -0.01]] * 3 + [[0.0, 0.0]] + [[0.01, 0.03]] * 3)


#: Grid, and whether the rod is clamped.
BASES = [("middles", True), ("thesis", True), ("thesis", False)]


@pytest.mark.parametrize(("grid", "clamped"), BASES)
@pytest.mark.parametrize("pieces", [2, 5])
def test_points_follow_a_linear_twist_up_to_the_ends(pieces, grid, clamped):
    model = CosseratRod(WEIGHTLESS, pieces, grid=grid, clamped=clamped)
    rate = 1e-6
    points = model.positions(twisted(model, rate), PLACES, SIDES)
    expected = np.column_stack((SIDES, PLACES))
    expected[:, 0] -= rate * PLACES * SIDES[:, 1]
    expected[:, 1] += rate * PLACES * SIDES[:, 0]
    np.testing.assert_allclose(points, expected, atol=1e-13)


@pytest.mark.parametrize("share", [0.0, 0.03, 0.3, 0.6, 0.875])
def test_a_moment_twists_up_to_where_it_acts(share):
    load = Load("turn", 0.5 * share, moment=(0.0, 0.0, 0.01))
    model = CosseratRod(WEIGHTLESS, 4, loads=[load])
    q = model.equilibrium([1.0])
    angle = 2 * np.arctan2(q[-1], q[-4])
    assert angle == pytest.approx(0.01 * load.station / WEIGHTLESS.torsional_stiffness, abs=1e-12)


@pytest.mark.parametrize("pieces", [1, 2, 5])
def test_a_tip_moment_twists_as_the_audit_says(pieces):
    load, closed = Load("m", 0.5, moment=(0.0, 0.0, 0.01)), torsion_angle(WEIGHTLESS, 0.01)
    assert 1e3 * closed == pytest.approx(19.08, abs=0.005)
    for grid, last in (("thesis", closed * (1 - 1 / (2 * pieces))), ("middles", closed)):
        model = CosseratRod(WEIGHTLESS, pieces, grid=grid, loads=[load])
        q = model.equilibrium([1.0])
        assert 2 * np.arctan2(q[-1], q[-4]) == pytest.approx(last, rel=1e-9)
        assert model.twist(q) == pytest.approx(closed, rel=1e-9)


def test_following_axes_are_extrapolated_to_the_tip():
    load = Load("f", 0.5, force=(1.0, 0.0, 0.0), follows=True)
    model = CosseratRod(WEIGHTLESS, 5, grid="thesis", loads=[load])
    errors = []
    for curvature in (1e-3, 1.0):
        strain = curvature * np.array([2, 1, -2]) / 3
        _, axes = located(model.data, posed(model, *strain))
        np.testing.assert_allclose(axes[0] @ axes[0].T, np.eye(3), atol=1e-14)
        turn = Rotation.from_matrix(axes[0]) * Rotation.from_rotvec(-0.5 * strain)
        errors.append(turn.magnitude())
    assert errors[0] < 1e-9
    assert errors[1] < 1e-4  # third order of the half segment's angle, 0.05


@pytest.mark.parametrize("grid", GRIDS)
def test_channels_shorten_on_the_inner_side_of_a_bend(grid):
    ends = np.array([0.03, 0.125, 0.2, 0.4375])
    if grid == "middles":
        ends[-1] = 0.5  # the whole rod bends
    tendons = (Tendon(f"t{k}", (0.02, 0.01), end, 0, 100.0) for k, end in enumerate(ends))
    robot = replace(WEIGHTLESS, tendons=tuple(tendons))
    model = CosseratRod(robot, 4, grid=grid)
    np.testing.assert_allclose(model.tendon_length(model.rest()), ends, rtol=1e-14)
    np.testing.assert_allclose(
        model.tendon_length(posed(model, 0, 3.0, 0)), ends * (1 - 0.06), rtol=1e-13
    )
    # Helix: the tangent has the axial part 1 and the circumferential part rate * radius.
    helix = ends * np.hypot(1, 8.0 * np.hypot(0.02, 0.01))
    np.testing.assert_allclose(model.tendon_length(twisted(model, 8.0)), helix, rtol=1e-13)


@pytest.mark.parametrize(
    ("grid", "part"), [("middles", [1, 1, 1, 1, 0, 0]), ("thesis", [1, 1, 1, 1, 0.5, 0])]
)
def test_a_tendon_bends_up_to_its_end(grid, part):
    """It ends at the fourth vertex of the thesis' grid, whose cell is half inside."""
    model = CosseratRod(ARM, grid=grid)
    q = model.equilibrium(np.array([0, 0, 20.0, 0, 0, 0]))
    curvature = 20 * 0.025 / ARM.bending_stiffness
    np.testing.assert_allclose(model.vertex_curvature(q)[:, 1] / curvature, part, atol=1e-9)


@pytest.mark.parametrize("grid", GRIDS)
def test_discs_at_the_tip_bend_the_last_piece_as_the_others(grid):
    """Within a hundredth of constant curvature; a hinge between discs has the longer arm."""
    guides = tuple((0.5 / 12 * np.arange(1, 12)).tolist())
    robot = replace(ARM, tendons=tuple(replace(t, guides=guides) for t in ARM.tendons[4:]))
    model = CosseratRod(robot, 12, grid=grid)
    q = model.equilibrium(np.array([5.0, 0.0]))
    curvature = model.vertex_curvature(q)[:, 1]
    truth = 5 * 0.025 / ARM.bending_stiffness
    truth += 5 * truth * (0.5 / 12) ** 2 / 12 / ARM.bending_stiffness  # the chord's arm
    np.testing.assert_allclose(curvature[1:], truth, rtol=0.01)


# ---------------------------------------------------------------- convergence


def test_bending_in_the_middles_is_six_times_as_accurate_at_the_same_cost():
    """Tip under its weight, and first frequency, against the exact rod with shear."""
    for robot in (CANTILEVER_WEAK, CANTILEVER_STIFF):
        weightless = replace(robot, gravity=(0.0, 0.0, 0.0))
        truth = bending_frequencies(weightless, 1, 0.75)[0]
        errors = {}
        for grid in GRIDS:
            models = [CosseratRod(weightless, n, grid=grid) for n in (6, 12)]
            found = [m.linearize(m.start()).frequencies()[0] for m in models]
            errors[grid] = np.abs(np.array(found) / truth - 1)
        assert errors["middles"][1] < 1e-3
        assert np.all(errors["thesis"] > 6 * errors["middles"])
        for each in errors.values():
            assert each[0] / each[1] == pytest.approx(4, rel=0.12)


# ---------------------------------------------------------------- slender rods

# Loads that follow the sections have one equilibrium only, which `spatial_rod.followed_rod` finds
# without solving an equation.

LENGTH = 0.5
RATIOS = (0.05, 0.005, 0.0005)
PIECES = (12, 25, 50, 100)


def slender(ratio: float) -> RobotParams:
    """A weightless rod of solid section, its radius this share of its length."""
    return replace(
        CANTILEVER_STIFF,
        length=LENGTH,
        outer_radius=ratio * LENGTH,
        inner_radius=0.0,
        youngs_modulus=7e7,
        poisson_ratio=0.4,
        gravity=(0.0, 0.0, 0.0),
    )


def wrench(rng, name, station, robot, follows):
    """Random direction; up to 5 EI / L^2 and 4 EI / L, which bends by more than a half turn."""
    unit = robot.bending_stiffness / LENGTH
    force, moment = rng.normal(size=(2, 3))
    force *= rng.uniform(0, 5) * unit / LENGTH / np.linalg.norm(force)
    moment *= rng.uniform(0, 4) * unit / np.linalg.norm(moment)
    return Load(name, station, tuple(force), tuple(moment), follows=follows)


def random_case(rng):
    """A rod of any slenderness under a wrench at the tip and one in between."""
    robot = slender(10 ** rng.uniform(np.log10(5e-4), np.log10(0.05)))
    mid = rng.uniform(0.3, 0.9) * LENGTH
    places = (("tip", LENGTH), ("mid", mid))
    return robot, [wrench(rng, name, s, robot, rng.random() < 0.3) for name, s in places]


def tip_of(robot, pieces, loads):
    model = CosseratRod(robot, pieces, loads=loads)
    return model.tip(model.equilibrium(np.ones(len(loads)), check_stability=False))


@pytest.mark.parametrize("pieces", PIECES)
@pytest.mark.parametrize(
    ("count", "seed"), [(12, 101), pytest.param(200, 0, marks=pytest.mark.slow)]
)
def test_random_wrenches_are_solved_at_any_slenderness(count, seed, pieces):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        robot, loads = random_case(rng)
        assert np.all(np.isfinite(tip_of(robot, pieces, loads)))


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("follows", [False, True])
def test_wrenches_in_space_give_the_exact_tip(ratio, follows):
    rng, robot = np.random.default_rng(3), slender(ratio)
    for _ in range(4):
        loads = [wrench(rng, "tip", LENGTH, robot, True)]
        truth = followed_rod(LENGTH, section(robot, 0.75), loads, [LENGTH])
        loads = loads if follows else dead_loads(loads, truth)
        coarse, fine = (np.linalg.norm(tip_of(robot, n, loads) - truth.tip) for n in (25, 50))
        assert fine < 1e-3 * LENGTH
        assert coarse / fine == pytest.approx(4, rel=0.15)


def test_steps_of_newtons_method_change_strains_as_they_say():
    """`moved` is the sum to first order, and the strains it leaves are linear in the step."""
    model = CosseratRod(slender(0.01), 5)
    rng = np.random.default_rng(2)
    q = model.moved(model.rest(), 0.3 * rng.normal(size=model.n))
    change = rng.normal(size=model.n)
    blocks = change.reshape(5, 7)[:, 3:]
    blocks -= (blocks * q.reshape(5, 7)[:, 3:]).sum(axis=1)[:, None] * q.reshape(5, 7)[:, 3:]
    small = 1e-5
    np.testing.assert_allclose(model.moved(q, small * change), q + small * change, atol=1e-8)

    def stretch(x):
        places = np.vstack([np.zeros(3), x.reshape(5, 7)[:, :3]])
        return np.linalg.norm(np.diff(places, axis=0), axis=1)

    assert model.constraint_drift(model.moved(q, change)) < 1e-14
    bend = np.zeros((5, 7))
    bend[:, 5] = 0.2 * np.arange(1, 6)  # quaternions turn about y, the vertices follow
    bend[:, 0] = 2 * np.cumsum(model.data.segments * bend[:, 5])
    bent = model.moved(model.rest(), bend.ravel())
    assert bent[-7] > 0.2 * LENGTH
    np.testing.assert_allclose(stretch(bent), model.data.segments, rtol=1e-14)


def test_a_rod_that_nothing_holds_has_no_equilibrium():
    load = Load("f", LENGTH, force=(1e-3, 0.0, 0.0))
    model = CosseratRod(slender(0.01), 4, loads=[load], clamped=False)
    with pytest.raises(RuntimeError, match=r"nothing holds the robot|no equilibrium"):
        model.equilibrium([1.0])
