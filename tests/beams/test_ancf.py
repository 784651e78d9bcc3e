"""ANCF beam against closed forms, the audit's numbers and integrals done point by point."""

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation

from softrobot_env.beams.ancf import ANCF, LockingWarning
from softrobot_env.beams.ancf import actuation as ancf_actuation
from softrobot_env.beams.ancf.tangent import add_internal_tangent
from softrobot_env.robots import ARM, CANTILEVER_STIFF, CANTILEVER_WEAK, Tendon
from softrobot_env.robots.loads import Load
from studies.truths import analytic

#: Each dimension and integration rule is compiled by itself; what all models have in common is
#: tested in test_beam_models. Most models here are coarse on purpose.
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::softrobot_env.beams.ancf.LockingWarning"),
]

DIMENSIONS = [2, 3]
RING = replace(ARM, name="ring", poisson_ratio=0.3, gravity=(-9.81, 0.0, 2.0), tendons=())
WEIGHTLESS = {
    "weak": replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, 0.0)),
    "stiff": replace(CANTILEVER_STIFF, gravity=(0.0, 0.0, 0.0)),
}


def random_pose(model, seed=0, size=0.05):
    """Far from straight: gradients off by 5 %, positions by 5 mm."""
    rng = np.random.default_rng(seed)
    unit = np.where(model.data.scale < 1, 0.1, 1.0)  # scale is the length, or 1 of a gradient
    return model.rest() + size * unit * rng.normal(size=model.n)


def complex_gradient(function, q):
    """Gradient (..., n) of an analytic function of q (n,)."""
    steps = 1e-30j * np.eye(len(q))
    return np.stack([np.imag(function(q + step)) / 1e-30 for step in steps], axis=-1)


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
    return complex_gradient(lambda x: shapes(x, length, d), np.array(point, dtype=float))


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


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_both_exact_rules_agree_and_the_thesis_rule_tends_to_them(dimension):
    rules = ["exact", "chebyshev", 6, 8, 16]
    forces = {}
    for rule in rules:
        model = ANCF(RING, 2, dimension=dimension, quadrature=rule)
        v = np.random.default_rng(2).normal(size=model.n)
        forces[rule] = model.residual(random_pose(model), v, np.zeros(model.n))
    size = np.linalg.norm(forces["exact"])
    errors = {rule: np.linalg.norm(forces[rule] - forces["exact"]) / size for rule in rules}
    assert errors["chebyshev"] < 1e-13
    # The errors are those of the section's moments, which fall as n^-3.
    assert errors[6] > errors[8] > 3e-4
    assert errors[8] / errors[16] == pytest.approx(8, rel=0.25)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_rigid_motion_causes_no_force(dimension):
    robot = replace(RING, gravity=(0.0, 0.0, 0.0))
    model = ANCF(robot, 3, dimension=dimension, clamped=False)
    axis = np.array([0.0, 2.0, 0.0] if dimension == 2 else [1.0, 2.0, -0.5])
    turn = Rotation.from_rotvec(axis).as_matrix()
    if dimension == 2:
        turn = turn[np.ix_([0, 2], [0, 2])]
    x = nodal_vectors(model, model.rest(), 1) @ turn.T
    x[:, 0] += 0.3
    q, zero = x.ravel(), np.zeros(model.n)
    # Rounding of a strain of 1e-16.
    tolerance = 1e-14 * robot.youngs_modulus * robot.area
    np.testing.assert_allclose(model.residual(q, zero, zero), 0, atol=tolerance)
    assert model.potential_energy(q) < tolerance


@pytest.mark.parametrize("clamped", [True, False])
@pytest.mark.parametrize("quadrature", ["exact", 3])
@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_tangent_is_the_derivative_of_the_residual(dimension, quadrature, clamped):
    model = ANCF(RING, 3, dimension=dimension, quadrature=quadrature, clamped=clamped)
    q, v, a = random_pose(model), *np.random.default_rng(7).normal(size=(2, model.n))
    damping, mass, k = 30.0, 500.0, 2 * model.data.block - 1
    found = np.ones((model.n, 3 * k + 1))
    assert add_internal_tangent(model.data, q, v, damping, mass, found)
    found -= 1  # it adds to what is there
    expected = np.zeros_like(found)
    for j in range(model.n):
        step = 1e-5 * model.data.scale[j] * np.eye(model.n)[j]
        # A polynomial of the third degree: fourth-order differences are exact.
        ahead, back, ahead2, back2 = (
            model.residual(q + h * step, v + h * damping * step, a + h * mass * step)
            for h in (1, -1, 2, -2)
        )
        column = (8 * (ahead - back) - (ahead2 - back2)) / (12 * step[j])
        for i in range(max(0, j - k), min(model.n, j + k + 1)):
            expected[i, j - i + k] = column[i]
    size = np.abs(expected).max()
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * size)


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


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_free_rod_falls_with_gravity(dimension):
    model = ANCF(RING, 3, dimension=dimension, clamped=False)
    a = model.acceleration(model.rest(), np.zeros(model.n))
    x = nodal_vectors(model, a, 1)
    world = [0, 2] if dimension == 2 else [0, 1, 2]
    expected = np.zeros_like(x)
    expected[:, 0] = np.array(RING.gravity)[world]
    np.testing.assert_allclose(x, expected, atol=1e-9)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_momentum_is_that_of_a_rigid_motion(dimension):
    """Rotation about the origin with angular velocity w: m w x c and inertia times w."""
    model = ANCF(RING, 3, dimension=dimension, clamped=False)
    spin = np.array([0.0, 0.7, 0.0] if dimension == 2 else [0.3, 0.7, -1.1])
    world = [0, 2] if dimension == 2 else [0, 1, 2]
    q = model.rest()
    x = np.zeros((4, dimension + 1, 3))
    x[..., world] = nodal_vectors(model, q, 1)
    v = np.cross(spin, x)[..., world].ravel()
    mass, length = RING.mass, RING.length
    rotary = RING.density * RING.second_moment * length
    inertia = np.diag([mass * length**2 / 3 + rotary] * 2 + [2 * rotary])
    linear = mass * np.cross(spin, [0, 0, length / 2])
    angular = inertia @ spin
    np.testing.assert_allclose(model.momentum(q, v), [*linear, *angular], atol=1e-14)
    energy = spin @ angular / 2
    assert model.kinetic_energy(q, v) == pytest.approx(energy, rel=1e-10)


# ------------------------------------------------------------- points, loads and tendons


def probe_model(dimension, follows=False):
    stations = (0.0, 0.17, 0.25, 0.5)
    loads = [
        Load(f"load{k}", s, force=(1.0, 0.0, 0.5), moment=(0.0, 0.3, 0.0), follows=follows)
        for k, s in enumerate(stations)
    ]
    tendons = (
        Tendon("guided", (0.02, 0.0), 0.5, 0, 80.0, guides=(0.1, 0.25, 0.4)),
        Tendon("short", (-0.02, 0.0), 0.31, 0, 80.0),
        Tendon("long", (0.01, 0.0), 0.5, 0, 80.0),
        Tendon("node", (0.01, 0.0), 0.125, 0, 80.0),
    )
    if dimension == 3:
        tendons = tuple(replace(t, offset=(t.offset[0], 0.012)) for t in tendons)
    return ANCF(replace(RING, tendons=tendons), 4, dimension=dimension, loads=loads)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_points_are_the_shape_functions_and_forces_their_transpose(dimension):
    model, d, length = probe_model(dimension), dimension, RING.length / 4
    q = random_pose(model)
    actuation = model.data.actuation

    def locate(x):
        out = np.empty((len(actuation.point_station), 3), x.dtype)
        ancf_actuation.locate(model.data, x, out)
        return out

    vectors, found = nodal_vectors(model, q, 1), locate(q)
    for at, offset, point in zip(
        actuation.point_station, actuation.point_offset, found, strict=True
    ):
        e = min(int(at / length), 3)
        s = shapes([at - e * length, *offset[: d - 1]], length, d)
        expected = s @ vectors[e : e + 2].reshape(-1, d)
        np.testing.assert_allclose(point[[0, 2] if d == 2 else [0, 1, 2]], expected, atol=1e-14)
    forces = np.random.default_rng(6).normal(size=found.shape)
    if dimension == 2:
        np.testing.assert_array_equal(found[:, 1], actuation.point_offset[:, 1])
    work = np.zeros(model.n)
    ancf_actuation.add_forces(model.data, q, forces, work)
    expected = np.einsum("kin,ki->n", complex_gradient(locate, q), forces)
    np.testing.assert_allclose(work, expected, atol=1e-13)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_channel_length_is_that_of_a_fine_polygon(dimension):
    model = probe_model(dimension)
    q = model.rest() + (random_pose(model) - model.rest()) / 5
    for tendon, found in list(zip(model.robot.tendons, model.tendon_length(q), strict=True))[1:]:
        at = np.linspace(0, tendon.end, 4001)
        points = model.positions(q, at, np.tile(tendon.offset, (len(at), 1)))
        polygon = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        assert found == pytest.approx(polygon, rel=1e-6)


@pytest.mark.parametrize("drive", ["tension", "length"])
@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_equations_involve_the_promised_neighbours_only(dimension, drive):
    """Guides at nodes 0, 2 and 5, the rest between nodes: blocks up to three apart couple."""
    length, pieces = RING.length, 6
    tendon = Tendon(
        "t", (0.02, 0.0), length, 0, 80.0, guides=(length / 3, 5 / 6 * length), stiffness=1e3
    )
    model = ANCF(replace(RING, tendons=(tendon,)), pieces, dimension=dimension, drive=drive)
    assert model.data.reach == (3 if drive == "tension" else pieces)
    q, zero, u = random_pose(model), np.zeros(model.n), np.array([0.06])
    u = u if drive == "length" else 100 * u
    matrix = np.empty((model.n, model.n))
    for j in range(model.n):
        step = np.zeros(model.n)
        step[j] = 1e-6 * model.data.scale[j]
        moved = model.residual(q + step, zero, zero, u) - model.residual(q - step, zero, zero, u)
        matrix[:, j] = moved / (2 * step[j])
    block = np.arange(model.n) // model.data.block
    apart = np.abs(block[:, None] - block)
    assert not matrix[apart > model.data.reach].any()
    assert np.abs(matrix[apart == 3]).max() > 1


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_moments_do_work_on_the_rotation_of_the_section(dimension):
    model = ANCF(RING, 3, dimension=dimension, clamped=False, loads=[Load("m", 0.2)])
    world = [0, 2] if dimension == 2 else [0, 1, 2]
    spin = np.array([0.0, 0.7, 0.0] if dimension == 2 else [0.3, 0.7, -1.1])
    moment = np.array([0.2, -0.5, 0.9])
    q = random_pose(model)
    x = np.zeros((4, dimension + 1, 3))
    x[..., world] = nodal_vectors(model, q, 1)
    v = np.cross(spin, x)[..., world].ravel()
    force = np.zeros(model.n)
    ancf_actuation.add_moments(model.data, q, moment[None], force)
    assert force @ v == pytest.approx(moment @ spin, rel=1e-12)
    # A deformation of the section without rotation takes no work.
    stretch = np.zeros((4, dimension + 1, dimension))
    stretch[:, 2:] = 0.3 * x[:, 2:, world]
    assert force @ stretch.ravel() == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_load_axes_turn_with_the_section(dimension):
    model = ANCF(RING, 3, dimension=dimension, clamped=False, loads=[Load("m", 0.2)])
    axes = np.empty((1, 3, 3))
    ancf_actuation.load_axes(model.data, model.rest(), axes)
    np.testing.assert_allclose(axes[0], np.eye(3), atol=1e-15)
    turn = Rotation.from_rotvec([0.0, 1.3, 0.0] if dimension == 2 else [0.4, 1.3, -0.9])
    world = [0, 2] if dimension == 2 else [0, 1, 2]
    matrix = turn.as_matrix()[np.ix_(world, world)]
    q = (nodal_vectors(model, model.rest(), 1) @ matrix.T).ravel()
    ancf_actuation.load_axes(model.data, q, axes)
    np.testing.assert_allclose(axes[0], turn.as_matrix(), atol=1e-14)
    # The axes stay orthonormal on a deformed section.
    ancf_actuation.load_axes(model.data, random_pose(model), axes)
    np.testing.assert_allclose(axes[0].T @ axes[0], np.eye(3), atol=1e-14)
    assert np.linalg.det(axes[0]) == pytest.approx(1, abs=1e-12)


# ------------------------------------------------------------- statics


@pytest.mark.parametrize(("plane", "expected"), [("stress", 11.16), ("strain", 2.24)])
def test_poisson_locking_is_the_audits(plane, expected):
    robot = replace(CANTILEVER_STIFF, poisson_ratio=0.49)
    model = ANCF(robot, 20, dimension=2, plane=plane)
    tip = model.tip(model.equilibrium(check_stability=False))
    assert -1e3 * tip[0] == pytest.approx(expected, abs=0.0051)


def test_small_deflection_converges_to_timoshenko_without_shear_correction():
    robot = replace(CANTILEVER_STIFF, gravity=(-9.81e-4, 0.0, 0.0))
    shear = robot.youngs_modulus / 2 * robot.area
    weight = robot.mass_per_length * 9.81e-4
    exact = analytic.timoshenko_deflection(
        robot.length, robot.bending_stiffness, shear, distributed=weight
    )
    errors = []
    for pieces in (8, 16, 32):
        model = ANCF(robot, pieces, dimension=2)
        tip = model.tip(model.equilibrium(check_stability=False))
        errors.append(1 + tip[0] / exact)
    assert errors[0] > errors[1] > errors[2] > 0
    # The clamp also holds r_,1, so that the first element cannot shear at its base: an error of
    # first order in the element's length besides that of second order. Both extrapolated:
    assert abs(errors[0] - 6 * errors[1] + 8 * errors[2]) / 3 < 2e-5


@pytest.mark.parametrize("follows", [False, True])
def test_planar_and_spatial_model_agree_without_poisson_effect(follows):
    robot = replace(RING, poisson_ratio=0.0, gravity=(-2.0, 0.0, 1.0))
    load = Load("tip", 0.4, force=(-1.0, 0.0, -0.2), moment=(0.0, -0.1, 0.0), follows=follows)
    tips = []
    for dimension in DIMENSIONS:
        model = ANCF(robot, 4, dimension=dimension, loads=[load])
        q = model.equilibrium(np.ones(1), check_stability=False)
        tips.append(np.concatenate([model.tip(q), model.curvature(q).ravel()]))
    np.testing.assert_allclose(tips[0], tips[1], atol=1e-9)
    assert abs(tips[0][0]) > 0.05


def test_spatial_model_treats_both_lateral_axes_alike():
    tips = []
    for gravity in ((-4.0, 0.0, 0.0), (0.0, -4.0, 0.0)):
        model = ANCF(replace(RING, gravity=gravity), 4)
        tips.append(model.tip(model.equilibrium(check_stability=False)))
    np.testing.assert_allclose(tips[0], tips[1][[1, 0, 2]], atol=1e-10)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_moment_about_y_bends_towards_x(dimension):
    robot, moment = WEIGHTLESS["weak"], 1e-3
    model = ANCF(robot, 4, dimension=dimension, loads=[Load("m", 0.5, moment=(0.0, moment, 0.0))])
    q = model.equilibrium(np.ones(1), check_stability=False)
    # A pure moment bends a cubic element exactly; large rotations enter at the second order.
    kappa = moment / robot.bending_stiffness
    curvature = model.curvature(q)
    np.testing.assert_allclose(curvature[:, 1], kappa, rtol=2e-3)
    np.testing.assert_allclose(curvature[:, [0, 2]], 0, atol=1e-9)
    assert model.tip(q)[0] == pytest.approx(kappa * robot.length**2 / 2, rel=2e-3)


@pytest.mark.parametrize("dimension", DIMENSIONS)
def test_opposed_channels_bend_as_their_moment(dimension):
    """A tension F at offset e bends by F e / EI; the compression it adds is small here."""
    tendon = Tendon("t", (0.02, 0.0), 0.5, 0, 80.0)
    robot = replace(WEIGHTLESS["weak"], tendons=(tendon,))
    model = ANCF(robot, 4, dimension=dimension)
    q = model.equilibrium(np.array([0.05]), check_stability=False)
    kappa = 0.05 * 0.02 / robot.bending_stiffness
    np.testing.assert_allclose(model.curvature(q)[:, 1], kappa, rtol=5e-3)


def test_torsion_is_the_closed_form():
    model = ANCF(WEIGHTLESS["weak"], 3, loads=[Load("m", 0.5, moment=(0.0, 0.0, 0.01))])
    twist = model.twist(model.equilibrium(np.ones(1), check_stability=False))
    # M L / GJ for small angles.
    assert twist == pytest.approx(0.01 * 0.5 / model.robot.torsional_stiffness, rel=1e-4)
    assert 1e3 * twist == pytest.approx(19.08, abs=0.0051)


# ------------------------------------------------------------- frequencies


@pytest.mark.parametrize(("poisson", "expected"), [(0.0, 6.938), (0.49, 5.684)])
def test_torsional_frequency_converges_to_the_audits(poisson, expected):
    robot = replace(WEIGHTLESS["weak"], poisson_ratio=poisson)
    # Quarter wave: f = sqrt(GJ / (2 rho I)) / (4 L).
    inertia = 2 * robot.density * robot.second_moment
    exact = np.sqrt(robot.torsional_stiffness / inertia) / (4 * robot.length)
    assert exact == pytest.approx(expected, abs=5.1e-4)
    errors = []
    for pieces in (5, 10):
        model = ANCF(robot, pieces)
        space = model.linearize(model.start())
        # Sections turn as a whole where r_,2 moves along y as r_,3 does against x.
        turn = np.zeros((model.n, pieces))
        for k in range(pieces):
            turn[12 * k + 7, k], turn[12 * k + 9, k] = 1, -1
        stiffness, mass = (turn.T @ m @ turn for m in (space.stiffness, space.mass))
        frequency = np.sqrt(eigh(stiffness, mass, eigvals_only=True)[0]) / (2 * np.pi)
        errors.append(frequency / exact - 1)
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert abs(errors[1]) < 1.1e-3


def test_damping_is_proportional_to_stiffness_in_the_straight_pose():
    model = ANCF(WEIGHTLESS["stiff"], 3)
    space = model.linearize(model.start())
    size = np.abs(space.stiffness).max()
    mu = model.robot.damping_time
    np.testing.assert_allclose(space.damping, mu * space.stiffness, atol=1e-13 * size)


# ------------------------------------------------------------- interface


# ---------------------------------------------------------------- locking


@pytest.mark.parametrize("dimension", DIMENSIONS)
@pytest.mark.parametrize(
    ("ratio", "pieces", "turn"), [(0.01, 6, 1.0), (0.003, 12, np.pi), (0.001, 24, 1.0)]
)
def test_slender_beams_lock_as_the_rule_says_and_warn(dimension, ratio, pieces, turn):
    """A moment bends to turn / (1 + share); the rule counts the bend that is left."""
    robot = replace(WEIGHTLESS["weak"], outer_radius=0.5 * ratio, inner_radius=0.0)
    moment = turn * robot.bending_stiffness / 0.5
    load = Load("m", 0.5, moment=(0.0, moment, 0.0))
    model = ANCF(robot, pieces, dimension=dimension, loads=[load])
    with pytest.warns(LockingWarning, match=rf"with {pieces} elements locks .* or more elements"):
        q = model.equilibrium([1.0])
    share = turn / (0.5 * model.curvature(q)[:, 1].mean()) - 1
    assert share > 0.03
    assert model.locking(q) == pytest.approx(share, rel=0.2)


def test_the_elements_that_the_warning_asks_for_do_not_lock():
    robot = replace(WEIGHTLESS["weak"], outer_radius=0.005, inner_radius=0.0)
    load = Load("m", 0.5, moment=(0.0, robot.bending_stiffness / 0.5, 0.0))
    with pytest.warns(LockingWarning, match="take 10 or more"):
        ANCF(robot, 6, dimension=2, loads=[load]).equilibrium([1.0])
    model = ANCF(robot, 11, dimension=2, loads=[load])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        q = model.equilibrium([1.0])
    assert 0.5 * model.curvature(q)[:, 1].mean() == pytest.approx(1.0, abs=0.01)
