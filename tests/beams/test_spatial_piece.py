from dataclasses import replace

import numpy as np
import pytest
from support.derivatives import differences

from softrobot_env.beams.pcc import PCC
from softrobot_env.robots import ARM, RIG, Head
from softrobot_env.thesis.rig import spatial_piece
from softrobot_env.thesis.rig.spatial_piece import SUBPIECES, make_rig_piece
from studies.truths import rig_piece

#: Gravity from the side as well, and a long head: nothing special about the upright rig.
TILTED = replace(
    RIG, gravity=(2.0, -3.0, -9.0), head=Head(0.055, 0.018, (6.2e-6, 6.2e-6, 6.2e-6), 0.05)
)
MODEL = PCC(TILTED, pieces=1, axes="spatial", inertia=SUBPIECES)
PIECE = make_rig_piece(TILTED)
L = RIG.length
#: Rates of PCC's curvatures (beta, gamma) to those of (mu, nu).
TURN = np.array([[0.0, -L], [L, 0.0]])


@pytest.fixture(params=[0.0, 1e-9, 1e-3, 0.4, 2.0, 3.5], ids="bend {}".format)
def state(request):
    """y, v, a and tensions of some size."""
    rng = np.random.default_rng(1)
    y, v, a = rng.normal(size=(3, 2)) * np.array([[1.0], [8.0], [90.0]])
    return request.param * y / np.linalg.norm(y), v, a, rng.uniform(1, 9, 3)


def curvatures(*vectors):
    return (np.linalg.solve(TURN, x) for x in vectors)


def test_equations_of_motion_are_those_of_the_general_model(state):
    y, v, a, tension = state
    out = np.empty(2)
    rig_piece.residual(PIECE, y, v, a, tension, out)
    expected = np.linalg.solve(TURN.T, MODEL.residual(*curvatures(y, v, a), tension))
    np.testing.assert_allclose(out, expected, atol=1e-14 * np.abs(expected).max() + 1e-15)
    rig_piece.acceleration(PIECE, y, v, tension, out)
    expected = TURN @ MODEL.acceleration(*curvatures(y, v), tension)
    np.testing.assert_allclose(out, expected, rtol=1e-11)


def test_energies_are_those_of_the_general_model(state):
    y, v, _, _ = state
    kinetic, potential = rig_piece.energies(PIECE, y, v)
    q, dq = curvatures(y, v)
    assert kinetic == pytest.approx(MODEL.kinetic_energy(q, dq), rel=1e-12)
    assert potential == pytest.approx(MODEL.potential_energy(q), rel=1e-12, abs=1e-15)


def forces_of_lagrange(piece, y, v, a):
    """M a + k by differences of the energies: d/dt dT/dv - dT/dy."""

    def kinetic(y, v):
        return rig_piece.energies(piece, y, v)[0]

    def momentum(y, v):
        return differences(lambda x: kinetic(y, x), v, 1e-3)  # exact: quadratic in v

    along = differences(lambda t: momentum(y + t * v, v + t * a), np.zeros(1), 1e-4, 4)[:, 0]
    return along - differences(lambda x: kinetic(x, v), y, 1e-4, 4)


@pytest.mark.parametrize("make", [make_rig_piece, rig_piece.distributed])
def test_inertial_forces_are_lagranges(state, make):
    """Also those of the head, which no other model here has."""
    y, v, a, _ = state
    piece, out = make(replace(TILTED, damping_time=0.0)), np.zeros(2)
    spatial_piece.add_dynamic(piece, y, v, a, out)
    np.testing.assert_allclose(out, forces_of_lagrange(piece, y, v, a), rtol=1e-7, atol=1e-7)


def test_the_head_counts_like_a_rigid_body_of_many_points():
    """Kinetic energy of the head, from the motion of its end section in the general model."""
    light = replace(TILTED, density=1e-9)
    piece = rig_piece.distributed(light)
    head, y, v = light.head, np.array([0.7, -1.1]), np.array([3.0, 2.0])
    offsets = np.array([[0.0, 0.0], [0.01, 0.0], [0.0, 0.01]])

    def frame(y):
        q = np.linalg.solve(TURN, y)
        base, x, z = MODEL.positions(q, np.full(3, L), offsets)
        axes = np.stack([(x - base) / 0.01, (z - base) / 0.01], axis=1)
        axes = np.column_stack([axes, np.cross(axes[:, 0], axes[:, 1])])
        return base + head.centre * axes[:, 2], axes

    step = 1e-5
    (p0, r0), (p1, r1) = frame(y - step * v), frame(y + step * v)
    speed, turning = (p1 - p0) / (2 * step), (r1 - r0) / (2 * step) @ frame(y)[1].T
    omega = np.array([turning[2, 1], turning[0, 2], turning[1, 0]])
    expected = 0.5 * (head.mass * speed @ speed + head.inertia[0] * omega @ omega)
    assert rig_piece.energies(piece, y, v)[0] == pytest.approx(expected, rel=1e-7)


def output(y, piece=PIECE):
    point, jacobian = np.empty(3), np.empty((3, 2))
    rig_piece.output(piece, y, point, jacobian)
    return point, jacobian


def test_output_is_on_the_tangent_of_the_end(state):
    q = np.linalg.solve(TURN, state[0])
    base, x, z = MODEL.positions(q, np.full(3, L), np.array([[0, 0], [1.0, 0], [0, 1.0]]))
    expected = base + TILTED.head.output * np.cross(x - base, z - base)
    np.testing.assert_allclose(output(state[0])[0], expected, atol=1e-15)


def test_derivatives_of_the_output(state):
    y, v, _, _ = state
    bias = np.empty(3)
    rig_piece.output_bias(PIECE, y, v, bias)
    slope = differences(lambda x: output(x)[0], y, 1e-3, 4)
    np.testing.assert_allclose(output(y)[1], slope, atol=1e-10)
    rate = differences(lambda t: output(y + t * v)[1], np.zeros(1), 1e-4)[..., 0]
    np.testing.assert_allclose(bias, rate @ v, atol=1e-5)


@pytest.mark.parametrize("bend", [0.0, 1e-9, 1e-3, 0.4, 1.5, 1.8])
@pytest.mark.parametrize("guess", [0.0, 0.3, 1.9])
def test_inverse_of_the_output(bend, guess):
    y, v, a = np.random.default_rng(2).normal(size=(3, 2))
    y = bend * y / np.linalg.norm(y)
    point, jacobian = output(y)
    bias = np.empty(3)
    rig_piece.output_bias(PIECE, y, v, bias)
    found = np.array([[guess, 0.0], [0, 0], [0, 0]])
    limit, _ = spatial_piece.reach(PIECE)
    wanted = (point[:2], (jacobian @ v)[:2], (jacobian @ a + bias)[:2])
    spatial_piece.invert_output(PIECE, limit, *wanted, *found)
    np.testing.assert_allclose(found, [y, v, a], atol=1e-12)


def test_reach_is_the_largest_distance():
    limit, distance = spatial_piece.reach(PIECE)
    grid = np.linspace(0, np.pi, 20001)
    distances = np.array([np.hypot(*output(np.array([0.0, angle]))[0][:2]) for angle in grid])
    assert distance == pytest.approx(distances.max(), rel=1e-8)
    assert limit == pytest.approx(grid[np.argmax(distances)], abs=2e-4)


# ---------------------------------------------------------------- the audit's numbers of the rig


def at_rest(piece):
    """Mass [kg m2] and stiffness [N m] of the straight pose, from the residual."""
    zero, out, step = np.zeros(2), np.empty(2), 1e-6
    rig_piece.residual(piece, zero, zero, np.array([1.0, 0.0]), np.zeros(3), out)
    mass = out[0]
    rig_piece.residual(piece, np.array([step, 0.0]), zero, zero, np.zeros(3), out)
    return mass, out[0] / step


def test_straight_pose_has_the_audits_stiffness_and_mass():
    mass, stiffness = at_rest(make_rig_piece(RIG))
    elastic = RIG.bending_stiffness / L
    assert elastic == pytest.approx(0.1017, abs=5e-5)
    assert stiffness - elastic == pytest.approx(-0.0579, abs=6e-5)
    assert stiffness == pytest.approx(0.0438, abs=6e-5)
    assert mass == pytest.approx(8.41e-4, rel=1e-3)
    assert np.sqrt(stiffness / mass) == pytest.approx(7.21, abs=0.01)
    tendon = RIG.tendons[0]
    driven = stiffness + 1.5 * tendon.stiffness * tendon.offset[0] ** 2
    assert np.sqrt(driven / mass) == pytest.approx(10.25, abs=0.02)
    damping = RIG.damping_time * elastic
    assert damping / (2 * np.sqrt(driven * mass)) == pytest.approx(0.22, abs=5e-3)


@pytest.mark.parametrize(
    ("radius", "moment", "angle"),
    [(0.090, 0.0414, 0.867), (0.120, 0.0654, 1.258), (0.128, 0.0747, 1.393)],
)
def test_bending_to_a_radius_takes_the_audits_moment(radius, moment, angle):
    piece, zero = make_rig_piece(RIG), np.zeros(2)
    y, v, a, force = np.zeros((4, 2))
    limit, _ = spatial_piece.reach(piece)
    spatial_piece.invert_output(piece, limit, np.array([0.0, radius]), zero, zero, y, v, a)
    spatial_piece.add_static(piece, y, force)
    assert np.linalg.norm(y) == pytest.approx(angle, abs=1e-3)
    assert np.linalg.norm(force) == pytest.approx(moment, rel=2e-3)
    assert y[0] < 0  # towards +y the rig turns about -x


def test_the_straight_rig_is_found_from_any_guess():
    piece = make_rig_piece(RIG)
    limit, _ = spatial_piece.reach(piece)
    for guess in np.linspace(0, limit, 400):
        assert spatial_piece.bending_angle(piece, 0.0, guess, limit) == 0.0


def test_uniform_backbone_with_head_at_rest():
    """Integrals over the backbone, whose section at s moves by s^2 / (2 L) and turns by s / L."""
    mass, stiffness = at_rest(rig_piece.distributed(RIG))
    head, turning = RIG.head, RIG.density * RIG.second_moment
    own = RIG.mass * L**2 / 20 + turning * L / 3
    beyond = head.mass * (L / 2 + head.centre) ** 2 + head.inertia[0]
    assert mass == pytest.approx(own + beyond, rel=1e-12)
    weight = 9.81 * (RIG.mass * L / 12 + head.mass * (L / 3 + head.centre))
    assert stiffness == pytest.approx(RIG.bending_stiffness / L - weight, rel=1e-8)


@pytest.mark.parametrize(
    ("robot", "reason"),
    [
        (replace(RIG, head=None), "needs a head"),
        (replace(ARM, head=RIG.head), "three tendons"),
        (replace(RIG, anisotropy=0.1), "without anisotropy and precurvature"),
        (replace(RIG, precurvature=(0.1, 0.0)), "without anisotropy and precurvature"),
    ],
)
def test_other_robots_are_refused(robot, reason):
    with pytest.raises(ValueError, match=reason):
        make_rig_piece(robot)
