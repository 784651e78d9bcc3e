"""What the test rig's environment measures, and its reference."""

import copy
from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest
from support.rig_episodes import rig, steps

from softrobot_env.robots import RIG
from softrobot_env.tasks import RIG_TASKS, make_task


@pytest.mark.parametrize("options", [{}, {"pieces": 3, "rule": "gauss3"}, {"integrator": "RK4"}])
def test_sensors_are_current(options):
    env = rig(**options)
    env.reset()
    model, tip = env.model, env.model.site("tip").id
    jacobian = np.zeros((3, model.nv))
    hinge = np.array([model.joint(i).name.startswith("hinge") for i in range(model.njnt)])
    for observation, *_, info in steps(env, 10):
        data = copy.copy(env.data)
        mujoco.mj_forward(model, data)
        mujoco.mj_jacSite(model, data, jacobian, None, tip)
        close = partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-11)
        close(observation["tip_position"], data.site_xpos[tip, :2])
        close(observation["tip_velocity"], (jacobian @ data.qvel)[:2])
        for name, angles in (("curvature", data.qpos), ("curvature_rate", data.qvel)):
            close(observation[name], [angles[hinge].sum() / 0.18, angles[~hinge].sum() / 0.18])
        close(info["tendon_length"], data.ctrl)
        bend = np.array([angles.sum() for angles in (data.qpos[hinge], data.qpos[~hinge])])
        pull = np.array([t.offset for t in RIG.tendons]) @ bend
        tension = np.maximum(0, 0.5 + 980 * (data.ctrl - pull))
        np.testing.assert_allclose(info["tendon_tension"], tension, atol=1e-9)
        np.testing.assert_allclose(observation["tendon_tension"], tension, atol=1e-9)
        close(info["error"], np.hypot(*(observation["tip_position"] - observation["reference"])))


@pytest.mark.parametrize("name", RIG_TASKS)
def test_reference_is_the_trajectory(name):
    preview = (0.0, 0.033, 2.0)
    env = rig(name, preview=preview)
    first = env.reset()
    trajectory = env.current_task.trajectory
    for observation, *_, info in [first, *steps(env, 300)]:
        t = info["time"]
        close = partial(np.testing.assert_allclose, atol=1e-8)
        now, later = np.array([t]), t + np.array(preview)
        close(observation["reference"], trajectory.position(now)[0, :2])
        close(observation["reference_preview"], trajectory.position(later)[:, :2].ravel())
        close(observation["reference_velocity"], trajectory.velocity(now)[0, :2])
        close(observation["reference_acceleration"], trajectory.acceleration(now)[0, :2])


def test_curvature_of_the_robots_pieces():
    """Two pieces of the robot on four of the chain, in a posture of known bends."""
    task = replace(make_task("triangle"), robot=replace(RIG, pieces=2))
    env = rig(task)
    env.reset()
    layout = env.scene.layout
    for station, (piece, weight) in enumerate(zip(layout.piece, layout.weights, strict=True)):
        env.data.joint(f"hinge{station}").qpos = weight * (3.0 if piece < 2 else 5.0)
        env.data.joint(f"side{station}").qpos = weight * (-1.0 if piece < 2 else 2.0)
    env._readout.update()
    np.testing.assert_allclose(env._readout.bend, [3.0, -1.0, 5.0, 2.0], rtol=1e-12)
