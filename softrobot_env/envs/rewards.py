"""The reward of tip tracking, as named terms."""

from dataclasses import dataclass
from math import dist, exp, hypot

import numpy as np

from softrobot_env.fields import Positive, check_fields


@dataclass(frozen=True)
class TrackingReward:
    """Weights and scales of the reward terms; every term is dimensionless.

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

    def terms(self, error: float, action: list[float], previous: list[float]) -> dict[str, float]:
        """Terms of a step that succeeded.

        Args:
            error: [m], distance between tip and reference at the end of the step.
            action, previous: (n_inputs,) [1], this step's action and the one before.
        """
        size = len(action)
        return {
            "tracking": self.tracking * exp(-error / self.coarse_scale),
            "precision": self.precision * exp(-error / self.fine_scale),
            "effort": -self.effort * hypot(*action) ** 2 / size,
            "smoothness": -self.smoothness * dist(action, previous) ** 2 / size,
            "failure": 0.0,
        }

    def batch_terms(
        self, error: np.ndarray, action: np.ndarray, previous: np.ndarray
    ) -> dict[str, np.ndarray]:
        """As `terms`, for errors (n,) [m] and actions (n, n_inputs)."""
        size, change = action.shape[1], action - previous
        return {
            "tracking": self.tracking * np.exp(-error / self.coarse_scale),
            "precision": self.precision * np.exp(-error / self.fine_scale),
            "effort": action**2 @ np.full(size, -self.effort / size),
            "smoothness": change**2 @ np.full(size, -self.smoothness / size),
            "failure": np.zeros(len(error)),
        }

    def failed_terms(self) -> dict[str, float]:
        """Terms of a step that failed: the penalty alone."""
        return dict.fromkeys(("tracking", "precision", "effort", "smoothness"), 0.0) | {
            "failure": self.failure
        }
