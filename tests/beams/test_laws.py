"""Laws of mechanics that every beam model keeps, numbers of the audit, and what is refused.

Derivatives for comparison are taken by complex steps through the kernels.
"""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.linalg import eigvals
from support.beam_kinds import (
    CONTINUA,
    FREE,
    KINDS,
    PCCS,
    ROBOT,
    SLOW,
    Kind,
    derivative,
    filled,
    gradient,
    law,
    located,
    state,
)

from softrobot_env.beams import mechanics
from softrobot_env.beams.ancf import ANCF
from softrobot_env.beams.cosserat import GRIDS, CosseratRod
from softrobot_env.beams.numerics import band
from softrobot_env.beams.numerics.linearization import residual_derivatives
from softrobot_env.beams.pcc import PCC
from softrobot_env.robots import ARM, CANTILEVER_STIFF, CANTILEVER_WEAK, Tendon
from softrobot_env.robots.loads import Load
from studies.truths.analytic import bent_rod, section
from studies.truths.spatial_rod import helix

pytestmark = pytest.mark.filterwarnings("ignore::softrobot_env.beams.ancf.LockingWarning")

WEIGHTLESS = replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, 0.0))


@pytest.mark.parametrize("kind", [*KINDS, Kind(CosseratRod, 3, FREE | {"baumgarte": 5.0})], ids=str)
def test_accelerations_balance_all_forces(kind):
    model = kind.made()
    (q, v), u = state(model), np.linspace(1.0, 2.0, model.n_inputs)
    force = model.residual(q, v, np.zeros(model.n), u)
    left = model.residual(q, v, model.acceleration(q, v, u), u)
    np.testing.assert_allclose(left, 0, atol=1e-11 * np.abs(force).max())


@law
def test_forces_at_rest_are_the_gradient_of_the_energy(kind):
    model = kind.made()
    (q, _), zero = state(model), np.zeros(model.n)
    slope = gradient(lambda x: mechanics.potential(model.data, x), q)
    np.testing.assert_allclose(
        model.residual(q, zero, zero), slope, rtol=0, atol=1e-12 * np.abs(slope).max()
    )
    assert model.potential_energy(model.rest()) == pytest.approx(0, abs=1e-12)


@law
def test_nothing_but_damping_changes_the_energy(kind):
    model = kind.made(replace(ROBOT, damping_time=0.0))
    q, v = state(model)
    mechanics.project(model.data, q, v)
    n, a = model.n, model.acceleration(q, v)

    def energy(x):
        return mechanics.kinetic_energy(model.data, x[:n], x[n:]) + mechanics.potential(
            model.data, x[:n]
        )

    change = derivative(energy, np.append(q, v), np.append(v, a))
    assert abs(change) < 1e-11 * np.abs(v) @ np.abs(model.residual(q, v, np.zeros(n)))


@pytest.mark.parametrize(
    "kind",
    [
        Kind(CosseratRod, 4, FREE),
        Kind(CosseratRod, 4, FREE | {"weighting": 2, "moments": "printed"}),
        *(
            pytest.param(Kind(ANCF, 3, FREE | {"dimension": d}, directions), marks=SLOW)
            for d, directions in ((2, "planar"), (3, ""))
        ),
    ],
    ids=str,
)
def test_gravity_alone_changes_the_momentum_of_a_free_rod(kind):
    """Damped, so that internal damping forces are shown to balance, too."""
    model = kind.made(replace(ROBOT, tendons=()), ())
    q, v = state(model)
    mechanics.project(model.data, q, v)
    n, a = model.n, model.acceleration(q, v)
    momentum = filled(mechanics.momentum, model.data, 6)
    rate = derivative(lambda x: momentum(x[:n], x[n:]), np.append(q, v), np.append(v, a))
    moment = momentum(q, q).real[:3]  # the first one of the mass: places move as places are
    weight, internal = np.array(model.robot.gravity), np.abs(a).max() * ROBOT.mass
    np.testing.assert_allclose(rate[:3], ROBOT.mass * weight, atol=1e-12 * internal)
    np.testing.assert_allclose(rate[3:], np.cross(moment, weight), atol=1e-12 * internal)


@law
def test_forces_on_points_are_the_transpose_of_their_motion(kind):
    model, places = kind.made(), np.array([0.0, 0.03, 0.125, 0.2, 0.3, 0.41, 0.5])
    sides = np.array([[0.02, -0.01]] * 3 + [[0.0, 0.0]] + [[0.01, 0.03]] * 3)
    data, (q, _) = model.probe(places, sides), state(model)
    forces, found = np.random.default_rng(3).normal(size=(7, 3)), np.ones(model.n)
    mechanics.add_wrenches(data, q, forces, np.empty((0, 3)), found)  # it adds
    moves = gradient(lambda x: located(data, x)[0], q)
    np.testing.assert_allclose(found - 1, np.einsum("nki,ki->n", moves, forces), atol=1e-13)
    with pytest.raises(ValueError, match="as many rows as the model has points"):
        mechanics.add_wrenches(data, q, forces[1:], np.empty((0, 3)), found)


@law
def test_loads_that_follow_are_turned_as_their_sections(kind):
    model = kind.made()
    data, (q, _), zero = model.data, state(model), np.zeros(model.n)
    u = np.array([0.0] * len(ROBOT.tendons) + [1.0, -0.5, 2.0])
    _, axes = located(data, q)
    moments, found = np.empty((3, 3)), zero.copy()
    forces = np.zeros((len(axes), 3))  # the loads' points come first
    for k, load in enumerate(model.loads):
        turn = u[-3 + k] * (axes[k] if load.follows else np.eye(3))
        forces[k], moments[k] = turn @ load.force, turn @ load.moment
    mechanics.add_wrenches(data, q, forces, moments, found)
    applied = model.residual(q, zero, zero) - model.residual(q, zero, zero, u)
    np.testing.assert_allclose(applied, found, atol=1e-11)


@law
def test_tendons_pull_along_the_slope_of_their_lengths(kind):
    model = kind.made()
    (q, _), tension, found = state(model), np.array([3.0, 7.0, 2.0, 5.0]), np.ones(model.n)
    mechanics.add_applied(model.data, q, np.append(tension, np.zeros(3)), found)
    slope = gradient(filled(mechanics.tendon_lengths, model.data, 4), q)
    np.testing.assert_allclose(1 - found, slope @ tension, atol=1e-12)
    straight = np.full(4, np.nan)  # whatever was there counts for nothing
    mechanics.tendon_lengths(model.data, model.rest(), straight)
    np.testing.assert_allclose(straight, [t.end for t in ROBOT.tendons], rtol=1e-14)


@pytest.mark.parametrize("kind", [*PCCS, *CONTINUA], ids=str)
def test_channels_are_as_long_as_polygons_through_their_points(kind):
    model = kind.made()
    q, _ = state(model, size=0.2)
    tendons = model.robot.tendons[:3]
    for found, tendon in zip(model.tendon_length(q)[:3], tendons, strict=True):
        at = np.unique([*np.linspace(0, tendon.end, 3001), *model.edges])
        at = at[at <= tendon.end]
        points = model.positions(q, at, np.tile(tendon.offset, (len(at), 1)))
        polygon = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        assert found == pytest.approx(polygon, rel=1e-6)


# ---------------------------------------------------------------- reach of the equations


def channelled(*ends, **options):
    places = [(0.02, 0.01), (0.0, 0.02), (-0.01, 0.02), (0.02, 0.0)]
    tendons = (
        Tendon(f"t{k}", offset, end, 0, 100.0, **options)
        for k, (end, offset) in enumerate(zip(ends, places, strict=False))
    )
    return replace(WEIGHTLESS, tendons=tuple(tendons))


def guided(tendon, distance):
    guides = np.arange(distance, tendon.end - distance / 2, distance)
    return replace(tendon, guides=tuple(guides.tolist()))


FOLLOWER = Load("f", 0.29, force=(1, 2, 3), moment=(0.1, 0.2, 0.3), follows=True)
RING = replace(ARM, name="ring", poisson_ratio=0.3, gravity=(-9.81, 0.0, 2.0), tendons=())
#: Guides at nodes 0, 2 and 5 of six elements: blocks up to three apart couple.
WIDE = Tendon("t", (0.02, 0.0), 0.5, 0, 80.0, guides=(0.5 / 3, 2.5 / 6), stiffness=1e3)
DISCS = replace(ARM, tendons=tuple(guided(t, 0.13) for t in ARM.tendons))
REACHING = {
    "plain": (CosseratRod, 8, WEIGHTLESS, {}),
    "free": (CosseratRod, 8, WEIGHTLESS, FREE),
    "printed": (
        CosseratRod,
        8,
        WEIGHTLESS,
        {"moments": "printed", "weighting": 2, "baumgarte": 10.0},
    ),
    "follower": (CosseratRod, 8, WEIGHTLESS, {"loads": [FOLLOWER]}),
    "channels": (CosseratRod, 8, channelled(0.5, 0.3, 0.21, 0.03), {}),
    "discs": (CosseratRod, 8, DISCS, {}),
    "length": (CosseratRod, 8, channelled(0.5, 0.3, stiffness=1e3), {"drive": "length"}),
} | {
    f"ancf {name} {d}": (ANCF, pieces, robot, options | {"dimension": d})
    for d in (2, 3)
    for name, pieces, robot, options in (
        ("exact", 3, RING, {}),
        ("free", 3, RING, FREE | {"quadrature": 3}),
        ("discs", 6, replace(RING, tendons=(WIDE,)), {}),
        ("length", 6, replace(RING, tendons=(WIDE,)), {"drive": "length"}),
    )
}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=SLOW if "ancf" in n else ()) for n in REACHING]
)
def test_the_iteration_matrix_is_the_derivative_and_reaches_far_enough(name):
    make, pieces, robot, options = REACHING[name]
    model = make(robot, pieces, **options)
    (q, v), n, data = state(model, size=0.2), model.n, model.data
    a, u = 10 * v, (0.005 if model.drive == "length" else 3.0) * np.arange(1.0, model.n_inputs + 1)
    width = mechanics.bandwidth(data)
    rows, matrix = np.empty((3, n, 3 * width + 1)), np.empty((n, 3 * width + 1))
    residual_derivatives(data, q, v, a, u, rows)
    by_q, by_v, by_a = band.dense(rows)
    # Column by column, without any knowledge of the reach.
    missing = filled(mechanics.residual, data, n)
    exact = gradient(lambda x: missing(x, v + 7 * (x - q), a + 30 * (x - q), u), q).T
    size = np.abs(exact).max()
    np.testing.assert_allclose(by_q + 7 * by_v + 30 * by_a, exact, atol=1e-13 * size)
    mechanics.iteration_matrix(data, q, v, a, u, 7.0, 30.0, matrix)
    found = band.dense(matrix)
    block = np.arange(n) // data.block
    distance = np.abs(block[:, None] - block)
    assert not np.any(exact[distance > data.reach])
    # Driven by length, a tendon couples all that it passes, which may not be all of the robot.
    farthest = 4 if model.drive == "length" else min(data.reach, block[-1])
    assert np.any(exact[distance == farthest])
    # A continuum knows the derivative of its own forces, others are differences.
    within = 1e-11 if make is ANCF and not model.n_inputs else 1e-6
    np.testing.assert_allclose(found, exact, rtol=10 * within, atol=within * size)


# ---------------------------------------------------------------- statics in closed form


@pytest.mark.parametrize(
    ("make", "within"),
    [
        *((partial(PCC, axes=axes), 1e-9) for axes in ("planar", "spatial", "torsion")),
        *((partial(CosseratRod, grid=grid), 1e-9) for grid in GRIDS),
        *(pytest.param(partial(ANCF, dimension=d), 5e-3, marks=SLOW) for d in (2, 3)),
    ],
)
def test_a_tendon_bends_towards_it_to_constant_curvature(make, within):
    """A tension F at the offset e bends by F e / EI; the compression it adds is small."""
    tendon = Tendon("t", (0.02, 0.0), 0.5, 0, 80.0)
    model = make(replace(WEIGHTLESS, tendons=(tendon,)), 4)
    q = model.equilibrium([0.05], check_stability=False)
    kappa = 0.05 * 0.02 / WEIGHTLESS.bending_stiffness
    np.testing.assert_allclose(model.curvature(q)[:, 1], kappa, rtol=within)
    np.testing.assert_allclose(model.curvature(q)[:, [0, 2]], 0, atol=1e-9)
    assert model.tip(q)[0] == pytest.approx(kappa * 0.5**2 / 2, rel=0.05)


@pytest.mark.parametrize("follows", [False, True])
@pytest.mark.parametrize(
    ("make", "pieces", "turns", "within"),
    [
        (PCC, 1, (0, 1.7, 0), 1e-9),
        (PCC, 4, (0, 0.5, 0), 1e-9),
        (partial(PCC, axes="torsion"), 1, (0.15, -0.3, 0.5), 1e-9),
        (partial(PCC, axes="torsion"), 3, (0.15, -0.3, 0.5), 1e-9),
        (CosseratRod, 6, (0, 0.5, 0), 1e-9),
        (CosseratRod, 6, (0.15, -0.3, 0.5), 1e-9),
        *(
            pytest.param(partial(ANCF, dimension=d), 4, (0, 1e-3, 0), 2e-3, marks=SLOW)
            for d in (2, 3)
        ),
    ],
)
def test_a_tip_moment_bends_to_a_circle_and_bends_and_twists_to_a_helix(
    make, pieces, turns, within, follows
):
    """With GJ = EI the strain is M / EI everywhere."""
    strain = 2 * np.pi * np.array(turns) / 0.5
    moment = strain * WEIGHTLESS.bending_stiffness
    load = Load("m", 0.5, moment=tuple(moment), follows=follows)
    model = make(WEIGHTLESS, pieces, loads=[load])
    q = model.equilibrium([1.0], load_steps=10, check_stability=False)
    np.testing.assert_allclose(model.curvature(q), [strain] * pieces, rtol=within, atol=1e-9)
    if isinstance(model, PCC):
        tip = helix(0.5, section(WEIGHTLESS, None), moment, [0.5], follows).tip
        np.testing.assert_allclose(model.tip(q), tip, atol=1e-9)


WEAK, STIFF = CANTILEVER_WEAK, CANTILEVER_STIFF
PLANAR, TWISTING = partial(PCC, axes="planar"), partial(PCC, axes="torsion")


@pytest.mark.parametrize(
    ("make", "shear"),
    [
        (partial(PLANAR, inertia="distributed"), None),
        (CosseratRod, 0.75),
        (partial(CosseratRod, moments="printed"), 0.75),
    ],
    ids=["pcc", "conservative", "printed"],
)
def test_the_own_weight_bends_to_the_exact_rod_to_second_order(make, shear):
    weight = (-9.81 * WEAK.mass_per_length, 0.0)
    exact = bent_rod(0.5, section(WEAK, shear), weight=weight).tip
    models = [make(WEAK, pieces) for pieces in (10, 20, 40)]
    tips = [m.tip(m.equilibrium(load_steps=4, check_stability=False))[[0, 2]] for m in models]
    errors = np.linalg.norm(tips - exact, axis=1)
    np.testing.assert_allclose(errors[:-1] / errors[1:], 4, rtol=0.1)


# ---------------------------------------------------------------- the audit's numbers

THESIS_ROD = partial(CosseratRod, grid="thesis")
PRINTED_ROD = partial(THESIS_ROD, weighting=2, moments="printed")
FLAT = partial(ANCF, dimension=2)
#: With Poisson's ratio, which locks elements however many there are.
LOCKED = replace(STIFF, poisson_ratio=0.49)
#: Deflection [mm] of 3 and 5 pieces by weighting.
WEIGHTINGS = {
    1: {3: 427.95, 5: 406.90},
    2: {3: 426.45, 5: 406.32},
    3: {3: 422.14, 5: 404.60},
    4: {3: 425.00, 5: 405.74},
    5: {3: 425.97, 5: 406.13},
}


# Numbers by pieces, and half a digit more.
@pytest.mark.parametrize(
    ("make", "robot", "numbers", "half"),
    [
        (PLANAR, WEAK, {1: 320.8, 2: 368.0, 3: 378.8, 5: 384.6, 8: 386.5}, 0.051),
        (PLANAR, STIFF, {1: 12.67, 2: 12.69, 3: 12.70, 5: 12.70, 8: 12.70}, 0.0051),
        (PRINTED_ROD, WEAK, {1: 482.4, 2: 450.7, 3: 426.5, 4: 413.3, 5: 406.3, 8: 398.3}, 0.051),
        (PRINTED_ROD, STIFF, {1: 26.59, 2: 17.21, 3: 15.46, 4: 14.84, 5: 14.56, 8: 14.25}, 0.0051),
        pytest.param(FLAT, WEAK, {1: 156.8, 2: 277.1, 5: 379.7, 20: 393.9}, 0.051, marks=SLOW),
        pytest.param(FLAT, STIFF, {1: 9.25, 2: 12.54, 5: 13.51, 20: 13.70}, 0.0051, marks=SLOW),
        pytest.param(FLAT, LOCKED, {20: 11.16}, 0.0051, marks=SLOW),
        pytest.param(partial(FLAT, plane="strain"), LOCKED, {20: 2.24}, 0.0051, marks=SLOW),
        *(
            (partial(PRINTED_ROD, weighting=kind), WEAK, numbers, 0.0051)
            for kind, numbers in WEIGHTINGS.items()
        ),
    ],
)
def test_deflections_under_the_own_weight_are_the_audits(make, robot, numbers, half):
    for pieces, expected in numbers.items():
        model = make(robot, pieces)
        tip = model.tip(model.equilibrium(load_steps=4, check_stability=False))
        assert -1e3 * tip[0] == pytest.approx(expected, abs=half), pieces


@pytest.mark.parametrize(
    ("make", "robot", "numbers", "half"),
    [
        (PCC, WEAK, {1: 0.5290, 3: 0.6382, 5: 0.6505, 14: 0.6566}, 7e-5),
        (PCC, STIFF, {1: 4.331, 3: 5.209, 5: 5.310, 14: 5.359}, 6e-4),
        (THESIS_ROD, WEAK, {1: 0.3735, 3: 0.5997, 5: 0.6330, 14: 0.6511}, 7e-5),
        (THESIS_ROD, STIFF, {1: 3.016, 3: 4.706, 5: 4.940, 14: 5.065}, 6e-4),
        pytest.param(ANCF, WEAK, {1: 0.8311, 3: 0.6692, 14: 0.6554}, 5.1e-5, marks=SLOW),
        pytest.param(ANCF, STIFF, {1: 6.426, 3: 5.266, 14: 5.158}, 5.1e-4, marks=SLOW),
    ],
)
def test_first_frequencies_are_the_audits(make, robot, numbers, half):
    for pieces, expected in numbers.items():
        model = make(replace(robot, gravity=(0.0, 0.0, 0.0)), pieces)
        found = model.linearize(model.start()).frequencies()[:2]  # alike in both directions
        np.testing.assert_allclose(found, expected, atol=half, err_msg=str(pieces))


@pytest.mark.parametrize("make", [TWISTING, THESIS_ROD])
@pytest.mark.parametrize(
    ("robot", "numbers", "half"),
    [
        (WEAK, {1: 6.246, 2: 6.761, 3: 6.859, 5: 6.909}, 2.2e-3),
        (STIFF, {1: 15.62, 2: 16.90, 3: 17.15, 5: 17.27}, 6e-3),
    ],
)
def test_frequencies_of_torsion_are_the_audits(make, robot, numbers, half):
    """The straight rod's torsion is its own, in every third or sixth coordinate."""
    for pieces, expected in numbers.items():
        model = make(replace(robot, gravity=(0.0, 0.0, 0.0)), pieces)
        space = model.linearize(model.start())
        own = slice(2, None, 3) if isinstance(model, PCC) else slice(5, None, 6)
        square = eigvals(space.stiffness[own, own], space.mass[own, own]).real.min()
        assert np.sqrt(square) / (2 * np.pi) == pytest.approx(expected, abs=half), pieces


# ---------------------------------------------------------------- what is refused

SIDE, TWIST = Load("side", 0.1, force=(0, 1, 0)), Load("turn", 0.1, moment=(0, 0, 1))
WHOLE = "pieces must be a whole number, at least one"


@pytest.mark.parametrize(
    ("model", "options", "allowed"),
    [
        *((model, {"pieces": n}, WHOLE) for model in (PCC, CosseratRod, ANCF) for n in (0, 2.5)),
        (PCC, {"axes": "planar", "loads": [SIDE]}, r"x-z plane; remove load 'side' \(force y\) or"),
        (PCC, {"axes": "spatial", "loads": [TWIST]}, r"remove load 'turn' \(moment z\) or choose"),
        (PCC, {"axes": "all"}, "unknown axes 'all'; choose from planar, spatial, torsion"),
        (PCC, {"inertia": "point"}, "unknown inertia 'point'; choose from lumped, distributed"),
        (PCC, {"inertia": [(0.6, 1.0, (0, 0, 0))]}, "off the robot"),
        (PCC, {"inertia": [(0.5, -1.0, (0, 0, 0))]}, "zero or more"),
        (PCC, {"inertia": [(0.5, 1.0, (0, 0))]}, "three moments"),
        (PCC, {"inertia": [(0.5, np.nan, (0, 0, 0))]}, "finite mass"),
        (PCC, {"inertia": [(0.1, 1.0, (1e-3, 1e-3, 1e-3))]}, "without inertia"),
        (PCC, {"inertia": []}, "without inertia"),
        (CosseratRod, {"grid": "ends"}, "choose from middles, thesis"),
        (CosseratRod, {"grid": "middles", "clamped": False}, "free rod has the grid 'thesis'"),
        (CosseratRod, {"weighting": 6}, "weighting must be 1, 2, 3, 4 or 5"),
        (CosseratRod, {"moments": "exact"}, "choose from conservative, printed"),
        (CosseratRod, {"shear_coefficient": 0.0}, "shear_coefficient must be positive"),
        (CosseratRod, {"baumgarte": -1.0}, "baumgarte must be zero or a positive rate"),
        (ANCF, {"dimension": 1}, "2 or 3"),
        (ANCF, {"plane": "bent"}, "stress, strain"),
        (ANCF, {"quadrature": 0}, "chebyshev"),
        (ANCF, {"quadrature": "simpson"}, "chebyshev"),
        (ANCF, {"dimension": 2, "loads": [Load("m", 0.1, moment=(1.0, 0.0, 0.0))]}, "x-z plane"),
        (ANCF, {"dimension": 2, "loads": [SIDE]}, "x-z plane"),
        (ANCF, {"robot": replace(ROBOT, gravity=(0, 0, 0)), "dimension": 2}, "x-z plane"),
        (ANCF, {"robot": replace(CANTILEVER_WEAK, gravity=(0, 1, 0)), "dimension": 2}, "x-z plane"),
        (ANCF, {"robot": replace(CANTILEVER_WEAK, poisson_ratio=0.5)}, "Poisson"),
    ],
)
def test_wrong_options_are_refused(model, options, allowed):
    with pytest.raises(ValueError, match=allowed):
        model(**{"robot": CANTILEVER_WEAK} | options)
