"""A linearised chain against the formula of a beam, equilibria, and forced motions."""

import numpy as np
import pytest

from softrobot_env.core.motion import State
from softrobot_env.robots import ARM, find_robot
from softrobot_env.scene.inverse import workspace_of
from softrobot_env.scene.linearised import linearised


def test_frequencies_of_the_straight_arm_are_those_of_a_cantilever():
    area, length = np.pi * (ARM.outer_radius**2 - ARM.inner_radius**2), ARM.length
    scale = np.sqrt(ARM.bending_stiffness / (ARM.density * area)) / length**2
    found = linearised(workspace_of(ARM).inverse, np.zeros(3)).frequencies[:2]
    np.testing.assert_allclose(2 * np.pi * found[0], 1.8751**2 * scale, rtol=5e-3)
    np.testing.assert_allclose(2 * np.pi * found[1], 4.6941**2 * scale, rtol=3e-2)  # 6 pieces


@pytest.mark.parametrize("name", ["planar_finger", "hanging_trunk", "silicone_rod"])
def test_at_rest_the_tip_answers_as_equilibria_do(name):
    inverse = workspace_of(find_robot(name)).inverse
    scale = inverse.inputs.input_scale
    inputs = 0.15 * scale * np.array([1.0, -0.3, -0.7, 0.8])[: len(scale)]
    step = 1e-3 * scale * np.array([1.0, 0.5, -0.2, 0.3])[: len(scale)]
    ends = [inverse.scene.tip(inverse.posture(inputs + h)) for h in (step, -step)]
    answer = linearised(inverse, inputs).response(0.0)
    assert np.abs(answer.imag).max() == 0
    wanted = ends[0] - ends[1]
    np.testing.assert_allclose(answer.real @ (2 * step), wanted, atol=1e-4 * np.abs(wanted).max())


def test_a_forced_motion_is_that_of_the_response():
    """A small sine at 0.7 of the first frequency, after ten periods, against the simulation."""
    inverse = workspace_of(find_robot("planar_finger")).inverse
    scene, inputs = inverse.scene, 0.2 * inverse.inputs.input_scale
    chain = linearised(inverse, inputs)
    rate, change = 0.7 * 2 * np.pi * chain.frequencies[0], np.array([0.02, 0.0])
    lap, period = 2 * np.pi / rate, scene.config.control_period
    posture = inverse.posture(inputs)

    def controls(time):
        out = np.zeros(scene.n_inputs)
        out[:4] = inverse.inputs.command(inputs + change * np.sin(rate * time))
        return out

    count = round(12 * lap / period)
    start = State(posture, np.zeros(scene.model.nv))
    motion = scene.simulate(count * period, controls, start, samples=period)
    late = motion.time > 10 * lap
    found = scene.tip(motion.q[late]) - scene.tip(posture)
    turn = np.exp(1j * rate * motion.time[late])
    wanted = np.outer(turn, chain.response(rate) @ change).imag
    assert np.abs(found - wanted).max() < 0.02 * np.abs(wanted).max()
