"""The reward of tip tracking, as named terms."""

from dataclasses import dataclass
from math import dist, exp, hypot

import numpy as np
from numpy import float64

from softrobot_env.fields import Positive, check_fields

#: Names of the terms, as `info` has them.
TERMS = tuple(
    f"reward_{name}" for name in ("tracking", "precision", "effort", "smoothness", "failure")
)

_ZERO = float64(0.0)

#: Terms of the start of an episode, which earns nothing.
NO_REWARD = dict.fromkeys(TERMS, _ZERO)


@dataclass(frozen=True)
class TrackingReward:
    """Weights and scales of the reward terms; every term is dimensionless.

    Terms come by their names in `info`, `TERMS`.

    Attributes:
        coarse_scale, fine_scale: [m], errors at which the two tracking terms fall to 1/e.
        tracking, precision, effort, smoothness: Weights [1] of the terms.
        failure: Reward [1] of a step that ends in failure.
    """

    coarse_scale: Positive = 0.05
    fine_scale: Positive = 0.005
    tracking: float = 0.5
    precision: float = 0.5
    effort: float = 0.01
    smoothness: float = 0.05
    failure: float = -10.0

    def __post_init__(self) -> None:
        check_fields(self, "reward")

    def terms(
        self, error: float, action: list[float], previous: list[float]
    ) -> tuple[float, dict[str, float64]]:
        """Reward of a step that succeeded, and the terms whose sum it is.

        Args:
            error: [m], distance between tip and reference at the end of the step.
            action, previous: (n_inputs,) [1], this step's action and the one before.
        """
        size = len(action)
        tracking = self.tracking * exp(-error / self.coarse_scale)
        precision = self.precision * exp(-error / self.fine_scale)
        effort = -self.effort * hypot(*action) ** 2 / size
        smoothness = -self.smoothness * dist(action, previous) ** 2 / size
        return tracking + precision + effort + smoothness, {
            "reward_tracking": float64(tracking),
            "reward_precision": float64(precision),
            "reward_effort": float64(effort),
            "reward_smoothness": float64(smoothness),
            "reward_failure": _ZERO,
        }

    def batch_terms(
        self, error: np.ndarray, action: np.ndarray, previous: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Terms for errors (n,) [m] and actions (n, n_inputs)."""
        size, change = action.shape[1], action - previous
        return {
            "reward_tracking": self.tracking * np.exp(-error / self.coarse_scale),
            "reward_precision": self.precision * np.exp(-error / self.fine_scale),
            "reward_effort": action**2 @ np.full(size, -self.effort / size),
            "reward_smoothness": change**2 @ np.full(size, -self.smoothness / size),
            "reward_failure": np.zeros(len(error)),
        }

    def failed_terms(self) -> tuple[float, dict[str, float64]]:
        """Reward of a step that failed, and its terms: the penalty alone."""
        return self.failure, NO_REWARD | {"reward_failure": float64(self.failure)}
