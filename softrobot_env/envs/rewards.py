"""Rewards of tip tracking and of grips, as named terms."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from math import dist, hypot
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy import float64, ndarray

from softrobot_env.core.arrays import namespace
from softrobot_env.core.records import Positive, Record, check_argument
from softrobot_env.core.registry import Registry
from softrobot_env.robots import RobotParams

from .observations.table import NEAR

#: Names of the terms in `info`.
TERMS = tuple(
    f"reward_{name}" for name in ("tracking", "precision", "effort", "smoothness", "failure")
)
GRIP_TERMS = ("reward_grip", *TERMS[2:])

_ZERO = float64(0.0)


class Outcome(NamedTuple):
    """Outcome of a step, for one robot or n.

    Attributes:
        error: [m] or (n,) [m], distance between tip and reference.
        action, previous: (..., n_inputs) [1], inputs of this step and of the one before.
        measured: The true state, functions as in `observations.table.Measured`.
    """

    error: Any
    action: ndarray
    previous: ndarray
    measured: Any


@dataclass(frozen=True)
class RewardTerm(Record, what="reward term"):
    """A user-defined term of a reward.

    Attributes:
        name: In `info`, after "reward_".
        value: Function of an `Outcome` that returns the term, a number or (n,).
    """

    name: str
    value: Callable[[Outcome], Any]


@dataclass(frozen=True)
class TrackingReward(Record, what="reward"):
    """Weights and scales of the reward terms; every term is dimensionless.

    Terms are named in `info` as in `TERMS`.

    Attributes:
        coarse_scale, fine_scale: [m], errors at which the two tracking terms fall to 1/e.
        tracking, precision, effort, smoothness: Weights [1] of the terms.
        failure: Reward [1] of a step that ends in failure.
        more: User-defined terms, which are added.
    """

    coarse_scale: Positive = 0.05
    fine_scale: Positive = 0.005
    tracking: float = 0.5
    precision: float = 0.5
    effort: float = 0.01
    smoothness: float = 0.05
    failure: float = -10.0
    more: tuple[RewardTerm, ...] = ()

    @property
    def none(self) -> dict[str, float64]:
        """Terms at the start of an episode: no reward."""
        return dict.fromkeys([*TERMS, *(f"reward_{term.name}" for term in self.more)], _ZERO)

    def _earned(self, error: Any, functions: Any) -> tuple[Any, Any]:
        """Terms tracking and precision of errors [m], by the functions of `math` or of arrays."""
        tracking = self.tracking * functions.exp(-error / self.coarse_scale)
        return tracking, self.precision * functions.exp(-error / self.fine_scale)

    def terms(
        self, error: float, action: list[float], previous: list[float], measured: Any = None
    ) -> tuple[float, dict[str, float64]]:
        """Reward of a step that succeeded, and the terms whose sum it is.

        Args:
            error: [m], distance between tip and reference at the end of the step.
            action, previous: (n_inputs,) [1], this step's action and the one before.
            measured: See `Outcome`, for user-defined terms.
        """
        size = len(action)
        tracking, precision = self._earned(error, math)
        effort = -self.effort * hypot(*action) ** 2 / size
        smoothness = -self.smoothness * dist(action, previous) ** 2 / size
        total = tracking + precision + effort + smoothness
        terms = {
            "reward_tracking": float64(tracking),
            "reward_precision": float64(precision),
            "reward_effort": float64(effort),
            "reward_smoothness": float64(smoothness),
            "reward_failure": _ZERO,
        }
        if self.more:
            own = self._own(Outcome(error, np.array(action), np.array(previous), measured))
            terms |= {name: float64(value) for name, value in own.items()}
            total += sum(own.values())
        return total, terms

    def _own(self, outcome: Outcome) -> dict[str, Any]:
        return {f"reward_{term.name}": term.value(outcome) for term in self.more}

    def batch_terms(
        self, error: ndarray, action: ndarray, previous: ndarray, measured: Any = None
    ) -> dict[str, ndarray]:
        """Terms for errors (n,) [m] and actions (n, n_inputs), NumPy's or tensors."""
        size, change, kind = action.shape[1], action - previous, namespace(error)
        tracking, precision = self._earned(error, kind)
        return {
            "reward_tracking": tracking,
            "reward_precision": precision,
            "reward_effort": (action**2).sum(axis=1) * (-self.effort / size),
            "reward_smoothness": (change**2).sum(axis=1) * (-self.smoothness / size),
            "reward_failure": kind.zeros_like(error),
            **self._own(Outcome(error, action, previous, measured)),
        }

    def failed_terms(self) -> tuple[float, dict[str, float64]]:
        """Reward of a step that failed, and its terms: the penalty alone."""
        return self.failure, self.none | {"reward_failure": float64(self.failure)}


@dataclass(frozen=True)
class LogReward(TrackingReward):
    """A reward for smaller errors at every scale, for agents trained from scratch.

    The term tracking is tracking (1 - log(1 + e / fine_scale) / log(1 + coarse_scale / fine_scale))
    for an error e: halving it earns about the same at any distance. It is positive up to
    `coarse_scale`, so that no agent gains by a failure. Other terms are those of `TrackingReward`.

    Attributes:
        coarse_scale: [m], error without reward.
        fine_scale: [m], error below which smaller errors earn little more.
    """

    coarse_scale: Positive = 1.0
    fine_scale: Positive = 1e-3
    precision: float = 0.0
    effort: float = 0.0
    smoothness: float = 0.0

    @classmethod
    def of(cls, robot: RobotParams) -> "LogReward":
        """Use the scales of a robot: twice its reach, and `observations.table.NEAR` times it."""
        return cls(coarse_scale=2 * robot.reach, fine_scale=NEAR * robot.reach)

    def _earned(self, error: Any, functions: Any) -> tuple[Any, Any]:
        most = math.log1p(self.coarse_scale / self.fine_scale)
        lost = functions.log1p(error / self.fine_scale) / most
        return self.tracking * (1 - lost), super()._earned(error, functions)[1]


#: Rewards by name, functions of a robot.
REWARDS: Registry[Callable[[RobotParams], TrackingReward]] = Registry(
    "reward", {"tracking": lambda robot: TrackingReward(), "log": LogReward.of}
)


def register_reward(
    name: str, make: Callable[[RobotParams], TrackingReward], replace: bool = False
) -> None:
    """Add a reward by name, or replace one: a function of the robot that makes it.

    Raises:
        ValueError: The name is taken and `replace` is not set.
    """
    REWARDS.register(name, make, replace)


def reward_of(
    reward: TrackingReward | str | None, robot: RobotParams, learns: bool
) -> TrackingReward:
    """The reward of an environment.

    Args:
        reward: A reward, its name, or None for the default.
        robot: The robot that defines its scales.
        learns: Whether "log" is the default.

    Raises:
        ValueError: Neither a reward nor a known name; the message names what is allowed.
    """
    check_argument("reward", reward, TrackingReward | Literal[tuple(REWARDS)] | None)
    if isinstance(reward, TrackingReward):
        return reward
    return REWARDS[reward or ("log" if learns else "tracking")](robot)


@dataclass(frozen=True)
class GripReward(Record, what="reward"):
    """Weights [1] of a gripper's reward terms, which are listed by name in `info`.

    With the error e of the task, relative to the limit for success, the term grip is `grip`
    exp(-e), effort is -`effort` times the mean square of the tensions over their limits, and
    smoothness -`smoothness` times the mean square of the change of the actions.
    """

    grip: float = 1.0
    effort: float = 0.05
    smoothness: float = 0.05
    failure: float = -10.0

    @property
    def none(self) -> dict[str, float64]:
        """See `TrackingReward`."""
        return dict.fromkeys(GRIP_TERMS, _ZERO)

    failed_terms = TrackingReward.failed_terms

    def batch_terms(self, error: ndarray, action: ndarray, previous: ndarray) -> dict[str, ndarray]:
        """Terms (n,) for errors (n,) and actions (n, inputs)."""
        return {
            "reward_grip": self.grip * np.exp(-error),
            "reward_effort": -self.effort * np.mean(((action + 1) / 2) ** 2, axis=1),
            "reward_smoothness": -self.smoothness * np.mean((action - previous) ** 2, axis=1),
            "reward_failure": np.zeros_like(error),
        }
