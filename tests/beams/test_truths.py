"""Closed forms and exact rods against the audit's numbers and each other, in plane and space."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.optimize import brentq
from scipy.special import ellipk, ellipkinc

from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.robots import CANTILEVER_STIFF, CANTILEVER_WEAK
from softrobot_env.robots.loads import Load
from studies.truths import analytic
from studies.truths.analytic import Section, bent_rod
from studies.truths.spatial_rod import dead_loads, followed_rod, helix
from studies.truths.varying_beam import bending_frequencies

G = 9.81


def self_weight(robot):
    return robot.mass_per_length * G


# Audit, "Reference numbers": elastica deflection w and axial tip position [mm]. Its last printed
# digit is 0.01 mm (weak, tip) and 0.001 mm (w of the stiff one).
@pytest.mark.parametrize(
    ("robot", "deflection", "axial"),
    [(CANTILEVER_WEAK, 387.78, 273.71), (CANTILEVER_STIFF, 12.698, 199.54)],
    ids=["weak", "stiff"],
)
def test_elastica_under_self_weight_is_the_audits(robot, deflection, axial):
    rod = analytic.elastica(
        robot.length, robot.bending_stiffness, weight=(-self_weight(robot), 0.0)
    )
    np.testing.assert_allclose(1e3 * rod.tip, [-deflection, axial], rtol=0, atol=0.0051)


def test_euler_bernoulli_and_timoshenko_deflections_are_the_audits():
    robot = CANTILEVER_STIFF
    arguments = (robot.length, robot.bending_stiffness)
    shear = 0.75 * robot.youngs_modulus / 2 * robot.area  # Poisson ratio 0
    q = self_weight(robot)
    assert 1e3 * analytic.euler_bernoulli_deflection(*arguments, q) == pytest.approx(
        12.739, abs=5e-4
    )
    assert 1e3 * analytic.timoshenko_deflection(*arguments, shear, q) == pytest.approx(
        14.098, abs=6e-4
    )


@pytest.mark.parametrize(
    ("robot", "slender", "rotary"),
    [(CANTILEVER_WEAK, 0.6588, 0.6574), (CANTILEVER_STIFF, 5.4903, 5.367)],
    ids=["weak", "stiff"],
)
def test_first_frequencies_are_the_audits(robot, slender, rotary):
    beam = (robot.length, robot.bending_stiffness, robot.mass_per_length)
    assert analytic.euler_bernoulli_frequency(*beam) == pytest.approx(slender, abs=5.1e-5)
    # The audit's "Timoshenko, no shear", printed to four digits.
    assert bending_frequencies(robot)[0] == pytest.approx(rotary, rel=1.5e-4)


def test_roots_are_the_tabulated_ones_and_solve_their_equation():
    # Blevins, Formulas for Natural Frequency and Mode Shape, Tab. 8-1.
    table = [1.87510407, 4.69409113, 7.85475744, 10.99554073, 14.13716839]
    found = [analytic.clamped_free_root(n) for n in range(1, 6)]
    np.testing.assert_allclose(found, table, atol=6e-9)
    with pytest.raises(ValueError, match="from 1"):
        analytic.clamped_free_root(0)


def thinned(robot, ratio):
    """A robot of equal EI and mass per length, with a radius so many times less."""
    return replace(
        robot,
        outer_radius=robot.outer_radius / ratio,
        inner_radius=robot.inner_radius / ratio,
        youngs_modulus=robot.youngs_modulus * ratio**4,
        density=robot.density * ratio**2,
    )


def test_rotary_inertia_vanishes_with_the_square_of_the_thickness():
    robot = CANTILEVER_STIFF
    beam = (robot.length, robot.bending_stiffness, robot.mass_per_length)
    slender = np.array([analytic.euler_bernoulli_frequency(*beam, n) for n in (1, 2, 3)])
    drops = [1 - bending_frequencies(thinned(robot, f), 3) / slender for f in (10, 30, 3000)]
    # First-order perturbation: the drop is proportional to the rotary inertia.
    assert np.all(drops[1] > 0)
    np.testing.assert_allclose(drops[0] / drops[1], 9, rtol=0.01)
    np.testing.assert_allclose(drops[2], 0, atol=1e-7)


@pytest.mark.parametrize("turn", [-3.0, 1e-9, 0.0, 0.5, 2 * np.pi])
def test_pure_moment_bends_the_elastica_to_a_circular_arc(turn):
    length, stiffness = 0.4, 0.2
    rod = analytic.elastica(length, stiffness, moment=turn * stiffness / length)
    np.testing.assert_allclose(rod.curvature, turn / length, atol=1e-8)
    tip = analytic.arc_tip(length, turn / length)
    np.testing.assert_allclose(rod.tip, tip, atol=1e-8)
    if turn == 2 * np.pi:
        np.testing.assert_allclose(tip, 0, atol=1e-15)


def bisshopp_drucker(alpha):
    """Tip (x, z) / L under lateral force F, alpha^2 = F L^2 / EI, by elliptic integrals.

    Bisshopp and Drucker, Large deflection of cantilever beams, Q. Appl. Math. 3 (1945). With tip
    angle a and k^2 = (1 + sin a) / 2, sin p = 1 / (k sqrt 2): alpha = K(k) - F(p, k) and
    z / L = sqrt(2 sin a) / alpha; x follows from the moment balance by quadrature.
    """

    def mismatch(angle):
        k2 = (1 + np.sin(angle)) / 2
        return ellipk(k2) - ellipkinc(np.arcsin(1 / np.sqrt(2 * k2)), k2) - alpha

    tip = brentq(mismatch, 1e-6, np.pi / 2 - 1e-6, xtol=1e-14)
    # x = int sin t dt / t', t'^2 = 2 alpha^2 (sin a - sin t); sin t = (1 - u^2) sin a smooths it.
    u, w = np.polynomial.legendre.leggauss(200)
    u, w = (u + 1) / 2, w / 2
    sine = (1 - u**2) * np.sin(tip)
    x = np.sum(w * sine * 2 * np.sqrt(np.sin(tip)) / np.sqrt(1 - sine**2)) / (np.sqrt(2) * alpha)
    return np.array([x, np.sqrt(2 * np.sin(tip)) / alpha])


@pytest.mark.parametrize("alpha", [0.5, 1.0, 2.0, 3.0])
def test_lateral_tip_force_matches_the_elliptic_integrals(alpha):
    length, stiffness = 0.5, 0.25
    rod = analytic.elastica(length, stiffness, force=(alpha**2 * stiffness / length**2, 0.0))
    np.testing.assert_allclose(rod.tip / length, bisshopp_drucker(alpha), atol=1e-7)


@pytest.mark.parametrize("ratio", [0.5, 0.9], ids=["half", "near_buckling"])
def test_axial_compression_softens_as_beam_columns_do(ratio):
    """w = F (tan kL - kL) / (k P) with k^2 = P / EI (Timoshenko and Gere, Elastic Stability)."""
    length, stiffness = 0.5, 0.25
    push = ratio * (np.pi / (2 * length)) ** 2 * stiffness
    force, k = 1e-4 * push, np.sqrt(push / stiffness)
    linear = force * (np.tan(k * length) - k * length) / (k * push)
    rod = analytic.elastica(length, stiffness, force=(force, -push))
    # The cubic terms are of relative order (slope)^2 / (1 - ratio) < 1e-4.
    assert rod.tip[0] == pytest.approx(linear, rel=1e-4)


def test_clamp_carries_the_moment_of_all_loads():
    """Moments about the clamp from the deformed shape: an integral, not the equation solved."""
    length, stiffness, q, f, m = 0.5, 0.25, (-8.0, 3.0), (1.0, -2.0), 0.3
    rod = analytic.elastica(length, stiffness, weight=q, force=f, moment=m)
    x, z = rod.position.T
    distributed = trapezoid(z * q[0] - x * q[1], rod.station)
    clamp = m + rod.tip[1] * f[0] - rod.tip[0] * f[1] + distributed
    assert stiffness * rod.curvature[0] == pytest.approx(clamp, abs=1e-4 * abs(distributed))


def test_elastica_says_when_it_fails():
    with pytest.raises(EquilibriumError, match="no equilibrium of a bent rod"):
        analytic.elastica(0.5, 0.01, weight=(-50.0, 0.0), load_steps=1)


# ---------------------------------------------------------------- rods in space

LENGTH = 0.4
SECTION = Section(0.02, torsion=0.013)
STATIONS = np.linspace(0, LENGTH, 9)


@pytest.mark.parametrize("follows", [False, True])
@pytest.mark.parametrize("moment", [(0.1, -0.2, 0.15), (0, 0.3, 0), (0, 0, 0.2), (0, 0, 0)])
def test_a_helix_is_a_rod_under_a_moment(moment, follows):
    shape = helix(LENGTH, SECTION, moment, STATIONS, follows)
    seen = moment if follows else shape.frame[-1].T @ moment
    truth = followed_rod(LENGTH, SECTION, [Load("m", LENGTH, moment=tuple(seen))], STATIONS)
    np.testing.assert_allclose(shape.position, truth.position, atol=1e-11)
    np.testing.assert_allclose(shape.frame, truth.frame, atol=1e-9)


@pytest.mark.parametrize("section", [SECTION, Section(0.02, 30.0, 80.0, 0.013)])
@pytest.mark.parametrize("heavy", [False, True], ids=["loads", "weight"])
def test_planar_rods_seen_from_the_tip_are_those_of_dead_loads(section, heavy):
    unit = section.bending / LENGTH**2
    load = Load("f", LENGTH, force=(2.0 * unit, 0.0, -1.0 * unit), moment=(0, 0.3 * unit, 0))
    weight = np.array([4.0, 0.0, 2.0]) * heavy * unit / LENGTH
    loads = [] if heavy else [load]
    shape = followed_rod(LENGTH, section, loads, STATIONS, weight)
    known = {"weight": tuple((shape.frame[-1] @ weight)[[0, 2]])}
    for dead in dead_loads(loads, shape):
        known |= {"force": (dead.force[0], dead.force[2]), "moment": dead.moment[1]}
    flat = Section(section.bending, section.shear, section.axial)
    truth = bent_rod(LENGTH, flat, **known)
    assert np.linalg.norm(shape.tip - [0, 0, LENGTH]) > 0.2 * LENGTH
    np.testing.assert_allclose(shape.tip[[0, 2]], truth.tip, atol=1e-11)


def test_forces_and_moments_balance_in_space():
    """About the clamp, in the world; the section there carries what the curvature says."""
    loads = [
        Load("a", LENGTH, force=(0.3, -0.2, 0.1), moment=(0.05, 0.02, -0.04)),
        Load("b", 0.15, force=(-0.1, 0.25, 0.2), moment=(-0.03, 0.06, 0.02)),
    ]
    step = 1e-5
    stations = np.array([0.0, step, 0.15, LENGTH])
    shape = followed_rod(LENGTH, SECTION, loads, stations)
    dead = dead_loads(loads, shape)
    places = [shape.position[3], shape.position[2]]
    total = sum(np.cross(x, d.force) + d.moment for x, d in zip(places, dead, strict=True))
    turn = shape.frame[1] - shape.frame[1].T
    curvature = np.array([turn[2, 1], turn[0, 2], turn[1, 0]]) / 2 / step
    carried = np.array([SECTION.bending, SECTION.bending, SECTION.torsion]) * curvature
    np.testing.assert_allclose(carried, total, atol=1e-4 * np.linalg.norm(total))
