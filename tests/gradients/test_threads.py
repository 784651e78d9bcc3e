"""Derivatives on threads are those of one."""

import numpy as np
import pytest

from softrobot_env.core.motion import State
from softrobot_env.gradients import Rollout
from softrobot_env.gradients.threads import on_threads
from studies.truths.moving_robots import moving

pytestmark = pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")


def gradient(rollout, given):
    motion = rollout.run(*given)
    return motion.vjp(tip=motion.observed.tip).inputs


def test_many_motions_are_derived_side_by_side():
    robot = moving(2)
    rollout, start = Rollout(robot.scene), State(robot.position, robot.velocity)
    shares = np.random.default_rng(0).uniform(0.2, 0.8, 6)
    items = [(share * robot.inputs, start) for share in shares]
    alone = [gradient(rollout, item) for item in items]
    for threads in (1, 3):
        together = on_threads(gradient, rollout, items, threads)
        np.testing.assert_array_equal(together, alone)


def test_errors_come_out_and_no_thread_is_refused():
    robot = moving(2)
    rollout = Rollout(robot.scene)
    with pytest.raises(ValueError, match="need a row of inputs"):
        on_threads(lambda own, item: own.run(item), rollout, [np.zeros(3)] * 3, 2)
    with pytest.raises(ValueError, match="threads must be"):
        on_threads(gradient, rollout, [], 0)
