"""Arguments of the test rig's environment, options of its `reset`, starts and failures."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from support.rig_episodes import TWINS, act, rig

from softrobot_env.envs.options import REAL_OPTIONS, parse_options
from softrobot_env.robots import RIG
from softrobot_env.robots.twin import Twin
from softrobot_env.tasks import Task, make_task
from softrobot_env.thesis.envs import RigEnv

OTHER = replace(RIG, name="other", pieces=2)


@TWINS
def test_starts_are_equilibria(twin):
    start = np.array([0.012, -0.006, -0.002])
    env = rig(twin=twin, control_period=0.05)
    observation, info = env.reset(options={"start_length": start})
    np.testing.assert_allclose(observation["previous_action"], start / 0.03)
    tip = env.data.site("tip").xpos.copy()
    assert np.hypot(*tip[:2]) > 0.05
    for _ in range(10):
        *_, info = env.step((start / 0.03).astype(np.float32))
    np.testing.assert_allclose(env.data.site("tip").xpos, tip, atol=2e-6)
    np.testing.assert_allclose(info["tendon_length"], start + env.twin.servo_offset, atol=1e-9)


def test_options_hold_for_one_episode():
    env = rig("reach", seed=3)
    first = env.reset()[0]["reference"]
    np.testing.assert_array_equal(first, make_task("reach", seed=3).trajectory.points[0][:2])
    other = env.reset(options={"task": {"seed": 4}})[0]["reference"]
    np.testing.assert_array_equal(other, make_task("reach", seed=4).trajectory.points[0][:2])
    np.testing.assert_array_equal(env.reset()[0]["reference"], first)


def test_other_options_keep_the_tasks_own_robot_and_start():
    start = (0.012, -0.006, -0.002)
    own = replace(make_task("triangle", period=2.0), robot=OTHER, start_input=start)
    env = rig(own)
    observation, _ = env.reset(options={"task": {"period": 3.0}})
    assert observation["curvature"].shape == (4,)
    np.testing.assert_allclose(observation["previous_action"], np.array(start) / 0.03)
    assert env._current.robot == OTHER


def test_other_options_keep_the_real_rigs_robot():
    own = replace(make_task("triangle", period=2.0), robot=OTHER)
    found = parse_options({"task": {"period": 3.0}}, REAL_OPTIONS).changed(own)
    assert found == replace(make_task("triangle", period=3.0), robot=OTHER)


def test_a_sharp_bend_ends_the_episode():
    """A rig of a hundredth of the stiffness is folded by its tendon."""
    soft = replace(RIG, youngs_modulus=RIG.youngs_modulus / 100, gravity=(0.0, 0.0, 0.0))
    near = tuple(replace(t, offset=tuple(0.3 * x for x in t.offset)) for t in RIG.tendons)
    env = rig(replace(make_task("triangle"), robot=replace(soft, tendons=near)))
    env.reset()
    results = []
    for _ in range(500):
        results.append(env.step(np.array([1, -1, -1], np.float32)))
        if results[-1][2]:
            break
    observation, reward, terminated, truncated, info = results[-1]
    assert terminated
    assert not truncated
    assert "left the workspace: curvature" in info["failure"]
    assert reward == -10
    for name, value in observation.items():
        np.testing.assert_array_equal(value, results[-2][0][name])
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(act(env))


class Broken:
    """A path at rest on the axis, one of whose functions is not a number from 0.5 s on."""

    def __init__(self, broken):
        self.broken = broken

    def __getattr__(self, name):
        if name not in ("position", "velocity", "acceleration", "path"):
            raise AttributeError(name)
        late = np.nan if name == self.broken else 0.0
        return lambda t: np.where(np.asarray(t)[:, None] < 0.5, 0.0, late) * np.ones(3)


@pytest.mark.parametrize("broken", ["position", "velocity", "acceleration"])
def test_references_that_are_not_finite_are_refused(broken):
    with pytest.raises(ValueError, match="must be finite"):
        RigEnv(Task("broken", RIG, Broken(broken), 1.0, (0.0,) * 3, axes="xy"))


def test_a_twin_of_another_robot_may_be_given():
    twin = Twin(OTHER, 0.1, (0.0,) * 3, (0.0,) * 3)
    env = rig(replace(make_task("triangle"), robot=OTHER), twin=twin)
    assert env.twin is twin
