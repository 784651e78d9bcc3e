"""Policies by name."""

from collections.abc import Callable

from softrobot_env.control.base import Controller
from softrobot_env.control.feedforward import Feedforward
from softrobot_env.control.feedforward_pi import FeedforwardPI
from softrobot_env.control.hold import Hold
from softrobot_env.robots import RobotParams

#: Name -> factory(nominal robot, control period [s]).
POLICIES: dict[str, Callable[[RobotParams, float], Controller]] = {
    "hold": lambda robot, period: Hold(),
    "feedforward": lambda robot, period: Feedforward(robot),
    "feedforward_pi": FeedforwardPI,
}


def make_policy(name: str, robot: RobotParams, control_period: float) -> Controller:
    """Build a policy by name.

    Args:
        name: One of `POLICIES`.
        robot: The nominal robot, which the policy may know.
        control_period: [s] between calls of `predict`.

    Raises:
        ValueError: Unknown name; the message lists the known ones.
    """
    if name not in POLICIES:
        raise ValueError(f"unknown policy {name!r}; choose from {', '.join(POLICIES)}")
    return POLICIES[name](robot, control_period)
