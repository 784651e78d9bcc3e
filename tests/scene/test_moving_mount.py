"""Robots on moving mounts against closed forms, and against the laws of mechanics."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.robots import CANTILEVER_WEAK, Base
from softrobot_env.scene.assembly import Assembly, Member, build_assembly
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.mount import Mount

#: Slender, so that it is Euler and Bernoulli's beam: rotary inertia, which goes with the square of
#: the radius, makes 0.2 % of the response at resonance.
BEAM = replace(
    CANTILEVER_WEAK,
    name="strip",
    length=0.2,
    outer_radius=0.005,
    youngs_modulus=1.65e6,
    gravity=(0.0, 0.0, 0.0),
    damping_time=0.05,
)


def mounted(directions, robot=BEAM, pivot=None, **options):
    config = SceneConfig(robot, accuracy=options.pop("accuracy", "0.01%"), **options)
    mount = Mount(directions, pivot)
    return build_assembly(Assembly("shaken", (Member("beam", config, mount=mount),)))


def shaken_tip(robot, omega):
    """Complex tip displacement over base displacement of a shaken beam at a circular frequency.

    Euler-Bernoulli with Kelvin-Voigt damping: E I (1 + i omega mu) w'''' = rho A omega^2 w, w the
    absolute displacement, w = 1 and w' = 0 at the base, w'' = w''' = 0 at the tip.
    """
    stiffness = robot.bending_stiffness * (1 + 1j * omega * robot.damping_time)
    beta = (robot.mass_per_length * omega**2 / stiffness) ** 0.25 * robot.length
    c, s, ch, sh = np.cos(beta), np.sin(beta), np.cosh(beta), np.sinh(beta)
    # w = A cos + B sin + C cosh + D sinh; A + C = 1, B + D = 0.
    matrix = np.array([[-c, -s, ch, sh], [s, -c, sh, ch], [1, 0, 1, 0], [0, 1, 0, 1]])
    a, b, cc, d = np.linalg.solve(matrix, np.array([0, 0, 1, 0], dtype=complex))
    return a * c + b * s + cc * ch + d * sh


@pytest.mark.parametrize("share", [0.5, 1.0, 3.0])
def test_a_shaken_beam_swings_as_euler_and_bernoullis(share):
    """Below, at, and beyond the first resonance; small amplitude, after the start has died out."""
    built = mounted(("x",), pieces=12, accuracy="0.001%")
    omega = share * 2 * np.pi * BEAM.first_frequency
    amplitude, ratio = 1e-3, shaken_tip(BEAM, omega)
    period = built.config.control_period
    duration = round(6.0 / period) * period
    motion = built.simulate(
        duration, samples=period, mounts={"beam": lambda t: [amplitude * np.sin(omega * t)]}
    )
    late = motion.time > 5.0
    t, x = motion.time[late], built["beam"].tip(motion.q[late])[:, 0] / amplitude
    basis = np.stack([np.sin(omega * t), np.cos(omega * t)], axis=1)
    found, *_ = np.linalg.lstsq(basis, x, rcond=None)
    assert abs(found[0] + 1j * found[1] - ratio) < 0.003 * abs(ratio)


def test_shaking_is_gravity_of_the_opposite_direction():
    """A base with constant acceleration from rest: its robot moves as under -a, to the accuracy."""
    built = mounted(("x", "z"), accuracy="0.1%")
    a = np.array([1.5, 0.0, -2.0])
    found = built.simulate(
        0.6, samples=0.1, mounts={"beam": lambda t: [a[0] * t**2 / 2, a[2] * t**2 / 2]}
    )
    truth = built["beam"].scene.simulate(0.6, samples=0.1, gravity=-a)
    tip = built["beam"].tip(found.q) - 0.5 * found.time[:, None] ** 2 * a
    assert np.abs(tip - built["beam"].scene.tip(truth.q)).max() < 2 * built.timestep.accuracy
    np.testing.assert_allclose(found.q[:, 0], a[0] * found.time**2 / 2, atol=1e-8)


def test_a_turning_beam_bends_outwards_by_the_centrifugal_force():
    """Beam parallel to the axis of a turntable, at a distance: small statics of a uniform load.

    In the turning frame rho A omega^2 (R + w) acts outwards, so that E I w'''' = rho A omega^2
    (R + w): a shaken beam's equation for the distance R + w from the axis.
    """
    distance, omega = 0.02, 2.0
    robot = replace(BEAM, base=Base((distance, 0.0, 0.0)))
    built = mounted(("turn_z",), robot, (0.0, 0.0, 0.0), bending="spatial", pieces=6)
    motion = built.simulate(4.0, mounts={"beam": lambda t: [omega * (t + np.exp(-2 * t) / 2)]})
    tip = built["beam"].tip(motion.q[-1])
    still = replace(robot, damping_time=0.0)
    truth = distance * shaken_tip(still, omega).real
    assert truth > 1.03 * distance
    assert np.hypot(*tip[:2]) - distance == pytest.approx(truth - distance, rel=2e-3)


def test_a_turned_base_turns_all():
    built = mounted(("turn_y",), replace(BEAM, outer_radius=0.03))
    slow = built.simulate(2.0, mounts={"beam": lambda t: [np.pi / 2 * np.sin(np.pi * t / 4) ** 2]})
    np.testing.assert_allclose(slow.q[-1][0], np.pi / 2, atol=1e-8)
    assert built["beam"].tip(slow.q[-1])[0] == pytest.approx(0.2, rel=0.01)
