"""Protocols shared by environments, controllers and learned policies."""

from typing import Any, Protocol

import numpy as np

Observation = dict[str, np.ndarray]


class Policy(Protocol):
    """A policy with the signature of stable-baselines3's `predict`.

    Integrators, warm starts and held actions live in the returned state, so that policies can
    be swapped, shared between environments and used by stable-baselines3's tools.
    """

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Choose actions.

        Args:
            observation: Arrays by name, either of one environment or stacked along a first
                axis for several.
            state: What the previous call returned, None at first.
            episode_start: (n_envs,) bool, where an episode has just begun.
            deterministic: Ignored by policies without randomness.

        Returns:
            Action (n_inputs,) or (n_envs, n_inputs) in [-1, 1], and the next state.
        """
