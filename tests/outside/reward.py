"""A reward term from outside: less for a tip that moves."""

from typing import Any

import softrobot_env
from softrobot_env.envs.rewards import Outcome, RewardTerm, TrackingReward
from softrobot_env.robots import RobotParams

NAME = "calm"


def haste(outcome: Outcome) -> Any:
    """-0.1 times the square of the tip's speed [m2/s2], of one robot or of many (n,)."""
    return -0.1 * (outcome.measured.tip_velocity() ** 2).sum(axis=-1)


def calm(robot: RobotParams) -> TrackingReward:
    """The usual reward with one more term."""
    return TrackingReward(more=(RewardTerm("haste", haste),))


def register() -> None:
    """What a package names in the entry-point group."""
    softrobot_env.register_reward(NAME, calm)
