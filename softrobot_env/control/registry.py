"""Policies by name."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from softrobot_env.control.base import Controller
from softrobot_env.control.feedforward import Feedforward
from softrobot_env.control.feedforward_pi import FeedforwardPI
from softrobot_env.control.hold import Hold
from softrobot_env.robots import RobotParams


@dataclass(frozen=True)
class PolicySpec:
    """How to build a policy, and the environment it is meant for.

    Attributes:
        make: Factory(nominal robot, control period [s]).
        environment: Keyword arguments of the environment (`control_period`, `preview`) where the
            policy needs others than the defaults.
    """

    make: Callable[[RobotParams, float], Controller]
    environment: dict[str, Any] = field(default_factory=dict)


POLICIES: dict[str, PolicySpec] = {
    "hold": PolicySpec(lambda robot, period: Hold()),
    "feedforward": PolicySpec(lambda robot, period: Feedforward(robot)),
    "feedforward_pi": PolicySpec(FeedforwardPI),
}


def _find(name: str) -> PolicySpec:
    if name not in POLICIES:
        raise ValueError(f"unknown policy {name!r}; choose from {', '.join(POLICIES)}")
    return POLICIES[name]


def make_policy(name: str, robot: RobotParams, control_period: float) -> Controller:
    """Build a policy by name.

    Args:
        name: One of `POLICIES`.
        robot: The nominal robot, which the policy may know.
        control_period: [s] between calls of `predict`.

    Raises:
        ValueError: Unknown name; the message lists the known ones. Or a control period that the
            policy cannot work with.
    """
    return _find(name).make(robot, control_period)


def policy_environment(name: str) -> dict[str, Any]:
    """Keyword arguments that an environment for this policy needs; none if any will do.

    `gymnasium.make("SoftRobot/ArmSwing-v0", **policy_environment("mpc"))` suits the policy.

    Raises:
        ValueError: Unknown name; the message lists the known ones.
    """
    return dict(_find(name).environment)
