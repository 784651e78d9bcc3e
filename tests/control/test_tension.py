"""Tension behind gears and feed lines, where the far ends of tendons tell the truth."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.control.registry import make_policy
from softrobot_env.control.tension import TensionObserver
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import find_robot
from softrobot_env.robots.tendons import FeedLine
from softrobot_env.robots.twin import with_real_drive

MOTION = ("reference", "reference_velocity", "reference_acceleration", "previous_action")


@pytest.mark.parametrize("name", ["silicone_rod", "planar_finger"])
def test_the_tension_behind_a_feed_line_is_estimated(name):
    """Nothing rubs in the robot itself, so the far end has the tension that enters."""
    robot, line = find_robot(name), FeedLine(1.5, 0.2)
    tendons = tuple(replace(t, feed_line=line, friction_coefficient=0.0) for t in robot.tendons)
    robot = with_real_drive(replace(robot, tendons=tendons))
    observer = TensionObserver(robot, 0.01)
    seen = {*observer.requires, *MOTION, "anchor_tension"}
    env = TrackingEnv("circle", robot=robot, observe=tuple(sorted(seen)))
    policy, state = make_policy("chain_dynamics", robot, env.control_period), None
    observation, _ = env.reset(seed=0)
    estimate, inside, errors = observer.start(observation), [], []
    for _ in range(300):
        action, state = policy.predict(observation, state)
        observation, *_ = env.step(action)
        estimate, truth = observer.update(estimate, observation), observation["anchor_tension"]
        room = 0.02 * np.abs(truth).max() + 0.02  # N
        inside.append((estimate.least - room < truth) & (truth < estimate.most + room))
        told = observation[observer.requires[0]]
        errors.append([np.abs(x - truth).mean() for x in (estimate.tension, told)])
    known, plain = np.mean(errors[50:], axis=0)
    assert known < 0.7 * plain
    assert np.mean(inside[50:]) > 0.9


def test_robots_without_tendons_have_no_tension():
    bare = replace(find_robot("planar_finger"), tendons=())
    with pytest.raises(ValueError, match="no tendons"):
        TensionObserver(bare, 0.02)
