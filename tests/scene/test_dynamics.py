"""Motion of the chain: frequencies, energy, convergence in the timestep, and honest failure."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from support.postures import posed

from softrobot_env.robots import ARM, CANTILEVER_WEAK
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import RULES
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.timestep import linearize
from studies.truths.varying_beam import bending_frequencies

FREE = replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, 0.0), damping_time=0.0)
PERIOD = 0.04


def chain(robot, pieces, rule="midpoint", **options):
    return build_scene(SceneConfig(replace(robot, tendons=()), pieces=pieces, rule=rule, **options))


def frequency_errors(rule, n):
    """Relative errors of the first three frequencies of n hinges against the exact beam."""
    model = chain(ARM, n // len(RULES[rule]), rule).model
    return np.abs(
        linearize(model).frequencies()[:3] / (2 * np.pi) / bending_frequencies(ARM, 3) - 1
    )


@pytest.mark.parametrize("rule", RULES)
def test_frequencies_converge_with_second_order_and_coupled_with_more(rule):
    first, coarse, fine = (frequency_errors(rule, n) for n in (12, 24, 48))
    if rule == "coupled2":
        assert np.all(np.log2(first / coarse) > 3.3)
        assert first[0] < frequency_errors("balanced2", 12)[0] / 4
    else:
        np.testing.assert_allclose(np.log2(coarse / fine), 2, atol=0.2)


def final_state(integrator, timestep, duration=0.8):
    robot = replace(FREE, damping_time=0.01)
    scene = chain(robot, 3, timestep=timestep, integrator=integrator, control_period=PERIOD)
    data = mujoco.MjData(scene.model)
    data.qpos[:] = 0.3
    mujoco.mj_step(scene.model, data, round(duration / timestep))
    return np.concatenate((data.qpos, data.qvel))


@pytest.mark.parametrize(
    ("integrator", "order", "tolerance"),
    [("implicitfast", 1, 0.05), ("Euler", 1, 0.05), ("discrete", 1, 0.15), ("RK4", 4, 0.05)],
)
def test_error_falls_with_the_integrators_order(integrator, order, tolerance):
    # RK4 at a fortieth of the smallest step is converged beyond 1e-12.
    truth = final_state("RK4", 2.5e-5)
    errors = [np.max(np.abs(final_state(integrator, h) - truth)) for h in (1e-3, 5e-4)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=tolerance)


@pytest.mark.parametrize("integrator", ["implicitfast", "discrete", "RK4"])
def test_advance_is_a_sequence_of_plain_steps_with_current_read_outs(integrator):
    scene = build_scene(SceneConfig(ARM, integrator=integrator))
    simulation, data = Simulation(scene), mujoco.MjData(scene.model)
    tendon_map, start = TendonMap(ARM), np.linspace(0.0, 0.1, 12)
    simulation.reset(start, np.zeros(6))
    data.qpos[:] = start
    for k in range(20):
        tension = tendon_map.tension(20 * np.sin([0.3 * k, 0.7 * k, 1.1 * k]))
        simulation.data.ctrl[:] = data.ctrl[:] = tension
        simulation.advance()
        mujoco.mj_step(scene.model, data, scene.timestep.substeps)
        np.testing.assert_array_equal(simulation.data.qpos, data.qpos)
        np.testing.assert_array_equal(simulation.data.qvel, data.qvel)
        tip = posed(scene.model, data.qpos).site("tip").xpos
        np.testing.assert_array_equal(simulation.data.site("tip").xpos, tip)
    assert simulation.data.time == data.time == pytest.approx(0.2)
    assert simulation.failure() is None
