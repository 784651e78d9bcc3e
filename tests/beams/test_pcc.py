"""Piecewise constant curvature against matrix exponentials and the exact beam."""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from support import exponentials
from support.beam_kinds import LOADS, PCCS, STEP, gradient, located, state

from softrobot_env.beams.pcc import PCC
from softrobot_env.beams.pcc import dynamics as pcc_dynamics
from softrobot_env.beams.pcc.constant_strain import stumpff
from softrobot_env.robots import CANTILEVER_STIFF, CANTILEVER_WEAK
from studies.truths.varying_beam import bending_frequencies

TILTED = replace(
    CANTILEVER_WEAK, poisson_ratio=0.3, gravity=(-9.0, 2.0, 3.0), damping_time=0.01, pieces=3
)


@pytest.fixture(params=PCCS, ids=str)
def model(request):
    return request.param.made(TILTED, ())


def states(model):
    return [state(model, seed) for seed in (7, 8)]


# ---------------------------------------------------------------- truth from exponentials


def strains(model, q):
    """(pieces, 3) strain, from the coordinates' definition."""
    q = np.reshape(q, (model.pieces, -1))
    beta, gamma, tau = np.concatenate([q, np.zeros((len(q), 2))], axis=1)[:, :3].T
    return np.stack([-gamma, beta, tau], axis=1)


def pose(model, q, s):
    """Pose (4, 4) of the section at arc length s."""
    return exponentials.pose(strains(model, q), model.edges, s)


def bodies(model):
    """Arc length, mass and principal moments of all bodies of a model."""
    robot = model.robot
    turning = robot.density * robot.second_moment * np.array([1.0, 1.0, 2.0])
    if model.inertia == "lumped":
        piece = robot.length / model.pieces
        sizes = [piece] * (model.pieces - 1) + [piece / 2]
        for i, size in enumerate(sizes):
            yield (i + 1) * piece, size * robot.mass_per_length, size * turning
    elif model.inertia == "distributed":
        x, w = np.polynomial.legendre.leggauss(8)
        piece = robot.length / model.pieces
        for i in range(model.pieces):
            for u, size in zip((x + 1) / 2, piece * w / 2, strict=True):
                yield (i + u) * piece, size * robot.mass_per_length, size * turning
    else:
        for s, mass, moments in model.inertia:
            yield s, mass, np.array(moments)


def jacobians(model, q, s):
    """Derivatives (3, n) of position and of rotation (world axes) of a section."""
    home = pose(model, q, s)
    changes = gradient(lambda p: pose(model, p, s), q)
    spins = [c[:3, :3] @ home[:3, :3].T for c in changes]
    return changes[:, :3, 3].T, np.array([[w[2, 1], w[0, 2], w[1, 0]] for w in spins]).T


def reference_mass(model, q):
    total = np.zeros((model.n, model.n))
    for s, mass, moments in bodies(model):
        shift, spin = jacobians(model, q, s)
        axes = pose(model, q, s)[:3, :3]
        total += mass * shift.T @ shift + spin.T @ axes @ np.diag(moments) @ axes.T @ spin
    return total


# ---------------------------------------------------------------- kinematics


@pytest.mark.parametrize("x", [0.0, 1e-24, 1e-8, 0.3, 3.999999, 4.0, 9.0, 45.0, 400.0])
def test_stumpff_functions_and_slopes_are_the_series(x):
    with mpmath.workdps(60):
        y = mpmath.mpf(x)
        terms = [[(-1) ** j / mpmath.factorial(2 * j + k) for j in range(90)] for k in range(8)]
        value = [float(mpmath.polyval(t[::-1], y)) for t in terms]
        slope = [float(mpmath.polyval([j * c for j, c in enumerate(t)][:0:-1], y)) for t in terms]
    np.testing.assert_allclose(stumpff(x), value, rtol=2e-14, atol=1e-16)
    found = np.imag(stumpff(x + 1j * STEP)) / STEP
    np.testing.assert_allclose(found, slope, rtol=1e-13, atol=1e-16)


@pytest.mark.parametrize("turn", [0.0, 1e-12, 1e-8, 1e-4, 1.9999, 2.0001, 4.0, 9.0, -14.0])
def test_pose_and_its_derivatives_are_those_of_the_exponential(turn):
    model = PCC(TILTED, 2, axes="torsion")
    q = turn / 0.25 * np.array([0.8, -0.6, 0.3, -0.2, 0.5, 0.9])
    for s, offset in [
        (0.0, (0.01, 0.02)),
        (0.07, (0.02, -0.01)),
        (0.25, (0.0, 0.03)),
        (0.5, (0.0, 0.0)),
    ]:
        local = np.array([*offset, 0.0, 1.0])

        def place(p, s=s, offset=offset):
            return located(model.probe([s], np.array([offset])), p)[0][0]

        np.testing.assert_allclose(place(q), (pose(model, q, s) @ local)[:3], atol=1e-14)
        expected = gradient(lambda p, s=s, x=local: (pose(model, p, s) @ x)[:3], q)
        np.testing.assert_allclose(gradient(place, q), expected, atol=2e-14)


# ---------------------------------------------------------------- equations of motion


def mass_matrix(model, q):
    out = np.empty((model.n, model.n), q.dtype)
    pcc_dynamics.mass_and_momenta(model.data, q, out)
    return out


def test_mass_matrix_is_that_of_the_bodies(model):
    for q, _ in states(model):
        expected, mass = reference_mass(model, q), mass_matrix(model, q)
        # Quadrature of the distributed mass: four points against eight.
        tolerance = 1e-5 if model.inertia == "distributed" else 1e-13
        np.testing.assert_allclose(mass, expected, atol=tolerance * np.max(expected))
        np.testing.assert_array_equal(mass, mass.T)


def test_potential_is_the_springs_and_the_heights(model):
    robot, piece = model.robot, model.robot.length / model.pieces
    for q, _ in states(model):
        k = strains(model, q)
        bend, twist = robot.bending_stiffness, robot.torsional_stiffness
        expected = piece / 2 * np.sum(k**2 @ [bend, bend, twist])
        for s, mass, _ in bodies(model):
            expected -= mass * np.dot(robot.gravity, pose(model, q, s)[:3, 3] - [0, 0, s])
        tolerance = 1e-6 if model.inertia == "distributed" else 1e-13
        assert model.potential_energy(q) == pytest.approx(expected, rel=tolerance)
    assert model.potential_energy(model.rest()) == pytest.approx(0.0, abs=1e-15)


def test_inertial_forces_are_lagranges(model):
    """M a + dM/dt v - d(v M v / 2)/dq, with derivatives of the mass matrix by complex steps."""
    for q, v in states(model):
        a = 30.0 * np.cos(np.arange(model.n))
        slopes = gradient(lambda p: mass_matrix(model, p), q)
        inertial = mass_matrix(model, q) @ a
        inertial += np.einsum("kij,k,j->i", slopes, v, v) - 0.5 * np.einsum(
            "kij,i,j->k", slopes, v, v
        )
        stiffness = elastic(model)
        expected = inertial + stiffness * model.robot.damping_time * v
        found = model.residual(q, v, a) - model.residual(q, 0 * v, 0 * a)
        np.testing.assert_allclose(found, expected, atol=1e-13 * np.max(np.abs(expected)))


def elastic(model):
    """Generalised stiffness (n,) of the coordinates."""
    bend, twist = model.robot.bending_stiffness, model.robot.torsional_stiffness
    block = np.array([bend, bend, twist])[: model.n // model.pieces]
    return model.robot.length / model.pieces * np.tile(block, model.pieces)


def test_momentum_is_that_of_the_bodies(model):
    for q, v in states(model):
        expected = np.zeros(6)
        for s, mass, moments in bodies(model):
            shift, spin = jacobians(model, q, s)
            home = pose(model, q, s)
            axes, linear = home[:3, :3], mass * shift @ v
            own = axes @ (moments * (axes.T @ spin @ v))
            expected += [*linear, *(np.cross(home[:3, 3], linear) + own)]
        tolerance = 1e-5 if model.inertia == "distributed" else 1e-13
        np.testing.assert_allclose(
            model.momentum(q, v), expected, atol=tolerance * np.max(np.abs(expected))
        )


# ---------------------------------------------------------------- actuation


@pytest.mark.parametrize("kind", PCCS[:3], ids=str)
def test_moments_and_axes_are_those_of_the_sections(kind):
    model = kind.made(TILTED, LOADS[:2])
    moments = np.random.default_rng(3).normal(size=(2, 3))
    for q, _ in states(model):
        found, (_, frames) = np.ones(model.n), located(model.data, q)
        pcc_dynamics.add_wrenches(model.data, q, np.zeros((2, 3)), moments, found)
        expected = np.zeros(model.n)
        for load, moment, frame in zip(LOADS, moments, frames, strict=False):
            np.testing.assert_allclose(frame, pose(model, q, load.station)[:3, :3], atol=1e-14)
            expected += jacobians(model, q, load.station)[1].T @ moment
        np.testing.assert_allclose(found - 1, expected, atol=1e-14)


# ---------------------------------------------------------------- vibration


def test_distributed_inertia_converges_to_rayleighs_beam_from_above():
    """The pieces are a Ritz approximation: frequencies fall to the limit with order two."""
    robot, errors = replace(CANTILEVER_STIFF, gravity=(0, 0, 0)), []
    exact = bending_frequencies(robot, 2)
    for pieces in (8, 16):
        model = PCC(robot, pieces, axes="planar", inertia="distributed")
        errors.append(model.linearize(model.start()).frequencies()[:2] / exact - 1)
    assert np.all(errors[1] > 0) and np.all(errors[1] < 0.02)
    np.testing.assert_allclose(errors[0] / errors[1], 4, rtol=0.1)
