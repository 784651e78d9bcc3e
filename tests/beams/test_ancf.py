"""ANCF beam against closed forms, the audit's numbers and integrals done point by point."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.beam_kinds import gradient, located, state

from softrobot_env.beams.ancf import ANCF, LockingWarning, dynamics
from softrobot_env.robots import ARM, CANTILEVER_WEAK
from softrobot_env.robots.loads import Load

#: Each dimension and integration rule is compiled by itself; what all models have in common is
#: tested in test_beam_models. Most models here are coarse on purpose.
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::softrobot_env.beams.ancf.LockingWarning"),
]

DIMENSIONS = [2, 3]
RING = replace(ARM, name="ring", poisson_ratio=0.3, gravity=(-9.81, 0.0, 2.0), tendons=())
WEIGHTLESS = replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, 0.0))


def random_pose(model):
    """Far from straight: gradients off by 5 %, positions by 5 mm."""
    return state(model)[0]


# ------------------------------------------------------------- the element, point by point


def shapes(point, length, d):
    """Shape functions (2.55) and (2.57) at X (d,), for [r, r_,1, r_,2 (, r_,3)] at both nodes."""
    xi, *across = np.asarray(point) / length
    near = [length * (y - xi * y) for y in across]
    far = [length * xi * y for y in across]
    return np.array(
        [
            1 - 3 * xi**2 + 2 * xi**3,
            length * (xi - 2 * xi**2 + xi**3),
            *near,
            3 * xi**2 - 2 * xi**3,
            length * (-(xi**2) + xi**3),
            *far,
        ]
    )


def shape_gradients(point, length, d):
    """(2 (d + 1), d) derivatives of the shape functions by X, along imaginary steps."""
    return np.moveaxis(
        gradient(lambda x: shapes(x, length, d), np.array(point, dtype=float)), 0, -1
    )


def volume(robot, length):
    """Points X (k, 3) and weights (k,) [m3] in an element: polar in the section."""
    x, w = np.polynomial.legendre.leggauss(8)
    radius = (robot.outer_radius + robot.inner_radius) / 2 + x * (
        robot.outer_radius - robot.inner_radius
    ) / 2
    angle = 2 * np.pi * (np.arange(16) + 0.5) / 16
    along = length * (1 + x) / 2
    grid = np.stack(np.meshgrid(along, radius, angle, indexing="ij"), axis=-1).reshape(-1, 3)
    points = np.stack(
        [grid[:, 0], grid[:, 1] * np.cos(grid[:, 2]), grid[:, 1] * np.sin(grid[:, 2])], axis=1
    )
    thick = (robot.outer_radius - robot.inner_radius) / 2
    weights = np.einsum("i,j,k->ijk", length / 2 * w, thick * w * radius, np.full(16, np.pi / 8))
    return points, weights.ravel()


def nodal_vectors(model, q, clamp):
    """(nodes, d + 1, d)."""
    d, fixed = model.dimension, model.data.clamp * clamp
    return np.concatenate([fixed, q]).reshape(-1, d + 1, d)


def stiffness_tensor(model):
    """Hooke's law as a function from strain (k, d, d) to stress (k, d, d)."""
    modulus, nu = model.robot.youngs_modulus, model.robot.poisson_ratio
    if model.dimension == 2 and model.plane == "stress":
        factor = nu / (1 - nu)
    else:
        factor = nu / (1 - 2 * nu)

    def stress(strain):
        trace = np.trace(strain, axis1=1, axis2=2)
        identity = np.eye(model.dimension)
        return modulus / (1 + nu) * (strain + factor * trace[:, None, None] * identity)

    return stress


def internal_power(model, q, v):
    """Elastic energy [J] and twice the dissipated power / mu [W / s] at q, v, point by point."""
    d, length = model.dimension, model.robot.length / model.pieces
    points, weights = volume(model.robot, length)
    gradients = np.stack([shape_gradients(x[:d], length, d) for x in points])
    x, rate = nodal_vectors(model, q, 1), nodal_vectors(model, v, 0)
    stress = stiffness_tensor(model)
    energy = power = 0.0
    for e in range(model.pieces):
        jacobian, change = (
            np.einsum("sb,psj->pbj", y[e : e + 2].reshape(-1, d), gradients) for y in (x, rate)
        )
        transposed = jacobian.transpose(0, 2, 1)
        strain = (transposed @ jacobian - np.eye(d)) / 2
        strain_rate = (transposed @ change + change.transpose(0, 2, 1) @ jacobian) / 2
        energy += np.einsum("p,pij,pij->", weights, strain, stress(strain)) / 2
        power += np.einsum("p,pij,pij->", weights, strain_rate, stress(strain_rate))
    return energy, power


@pytest.mark.parametrize(
    ("dimension", "plane"), [(2, "stress"), (2, "strain"), (3, "stress")], ids=str
)
@pytest.mark.parametrize("quadrature", ["exact", "chebyshev"])
def test_energy_and_damping_are_the_volume_integrals(dimension, plane, quadrature):
    model = ANCF(RING, 2, dimension=dimension, plane=plane, quadrature=quadrature)
    rng = np.random.default_rng(1)
    q, v, zero = random_pose(model), rng.normal(size=model.n), np.zeros(model.n)
    energy, power = internal_power(model, q, v)
    gravity = -model.data.gravity @ (q - model.rest())
    assert model.potential_energy(q) - gravity == pytest.approx(energy, rel=1e-12)
    drag = model.residual(q, v, zero) - model.residual(q, zero, zero)
    assert v @ drag == pytest.approx(model.robot.damping_time * power, rel=1e-10)


# ------------------------------------------------------------- inertia


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_mass_is_the_volume_integral(dimension):
    model = ANCF(RING, 2, dimension=dimension, clamped=False)
    d, length = dimension, RING.length / 2
    points, weights = volume(RING, length)
    s = np.stack([shapes(x[:d], length, d) for x in points])
    element = RING.density * np.einsum("p,pi,pj->ij", weights, s, s)
    slots = d + 1
    expected = np.zeros((3 * slots, 3 * slots))
    for e in range(2):
        rows = slice(e * slots, (e + 2) * slots)
        expected[rows, rows] += element
    expected = np.kron(expected, np.eye(d))
    zero = np.zeros(model.n)
    q = random_pose(model)
    still = model.residual(q, zero, zero)
    mass = np.stack([model.residual(q, zero, a) - still for a in np.eye(model.n)], axis=1)
    atol = 1e-12 * np.abs(still).max()
    np.testing.assert_allclose(mass, expected, rtol=1e-11, atol=atol)


# ------------------------------------------------------------- points, loads and tendons


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_points_are_the_shape_functions(dimension):
    d, length = dimension, RING.length / 4
    model = ANCF(RING, 4, dimension=d)
    q, vectors = random_pose(model), nodal_vectors(model, random_pose(model), 1)
    places, offsets = [0.0, 0.17, 0.25, 0.5], np.array([[0.02, 0.012]] * 4)
    for at, offset, point in zip(places, offsets, model.positions(q, places, offsets), strict=True):
        e = min(int(at / length), 3)
        s = shapes([at - e * length, *offset[: d - 1]], length, d)
        expected = s @ vectors[e : e + 2].reshape(-1, d)
        np.testing.assert_allclose(point[[0, 2] if d == 2 else [0, 1, 2]], expected, atol=1e-14)
        assert d == 3 or point[1] == offset[1]


@pytest.fixture(params=DIMENSIONS)
def free(request):
    """A free beam with a load, its axes in the world, and a rotation vector in its plane."""
    model = ANCF(RING, 3, dimension=request.param, clamped=False, loads=[Load("m", 0.2)])
    axes, turn = [0, 1, 2], np.array([0.3, 0.7, -1.1])
    return (model, axes, turn) if request.param == 3 else (model, [0, 2], turn * [0, 1, 0])


def test_moments_do_work_on_the_rotation_of_the_section(free):
    model, world, spin = free
    moment, q = np.array([0.2, -0.5, 0.9]), random_pose(model)
    x = np.zeros((4, model.dimension + 1, 3))
    x[..., world] = nodal_vectors(model, q, 1)
    v = np.cross(spin, x)[..., world].ravel()
    force = np.zeros(model.n)
    dynamics.add_wrenches(model.data, q, np.zeros((1, 3)), moment[None], force)
    assert force @ v == pytest.approx(moment @ spin, rel=1e-12)
    # A deformation of the section without rotation takes no work.
    stretch = np.zeros((4, model.dimension + 1, model.dimension))
    stretch[:, 2:] = 0.3 * x[:, 2:, world]
    assert force @ stretch.ravel() == pytest.approx(0, abs=1e-12)


def test_load_axes_turn_with_the_section(free):
    model, world, turn = free
    turn = Rotation.from_rotvec(turn).as_matrix()
    rest = nodal_vectors(model, model.rest(), 1)
    for matrix, within in ((np.eye(3), 1e-15), (turn, 1e-14)):
        moved = rest @ matrix[np.ix_(world, world)].T
        _, axes = located(model.data, moved.ravel())
        np.testing.assert_allclose(axes[0], matrix, atol=within)
    # The axes stay orthonormal on a deformed section.
    _, axes = located(model.data, random_pose(model))
    np.testing.assert_allclose(axes[0].T @ axes[0], np.eye(3), atol=1e-14)
    assert np.linalg.det(axes[0]) == pytest.approx(1, abs=1e-12)


# ------------------------------------------------------------- statics


def test_torsion_is_the_closed_form():
    model = ANCF(WEIGHTLESS, 3, loads=[Load("m", 0.5, moment=(0.0, 0.0, 0.01))])
    twist = model.twist(model.equilibrium(np.ones(1), check_stability=False))
    # M L / GJ for small angles.
    assert twist == pytest.approx(0.01 * 0.5 / model.robot.torsional_stiffness, rel=1e-4)
    assert 1e3 * twist == pytest.approx(19.08, abs=0.0051)


# ---------------------------------------------------------------- locking


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize(
    ("ratio", "pieces", "turn"), [(0.01, 6, 1.0), (0.003, 12, np.pi), (0.001, 24, 1.0)]
)
def test_slender_beams_lock_as_the_rule_says_and_warn(dimension, ratio, pieces, turn):
    """A moment bends to turn / (1 + share); the rule counts the bend that is left."""
    robot = replace(WEIGHTLESS, outer_radius=0.5 * ratio, inner_radius=0.0)
    moment = turn * robot.bending_stiffness / 0.5
    load = Load("m", 0.5, moment=(0.0, moment, 0.0))
    model = ANCF(robot, pieces, dimension=dimension, loads=[load])
    with pytest.warns(LockingWarning, match=rf"with {pieces} elements locks .* or more elements"):
        q = model.equilibrium([1.0])
    share = turn / (0.5 * model.curvature(q)[:, 1].mean()) - 1
    assert share > 0.03
    assert model.locking(q) == pytest.approx(share, rel=0.2)


def test_the_elements_that_the_warning_asks_for_do_not_lock():
    robot = replace(WEIGHTLESS, outer_radius=0.005, inner_radius=0.0)
    load = Load("m", 0.5, moment=(0.0, robot.bending_stiffness / 0.5, 0.0))
    with pytest.warns(LockingWarning, match="take 10 or more"):
        ANCF(robot, 6, dimension=2, loads=[load]).equilibrium([1.0])
    model = ANCF(robot, 11, dimension=2, loads=[load])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        q = model.equilibrium([1.0])
    assert 0.5 * model.curvature(q)[:, 1].mean() == pytest.approx(1.0, abs=0.01)
