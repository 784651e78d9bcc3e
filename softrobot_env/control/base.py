"""From a controller of one robot to stable-baselines3's `predict`, single or batched."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np

from softrobot_env.interfaces import Observation


class Controller(ABC):
    """A policy written for one robot; `predict` serves one or several environments.

    Subclasses implement `start` and `act`. Nothing about an episode is kept in the object: the
    state returned by `predict` carries it (a list with one entry per environment when the
    observations are stacked).
    """

    #: Observables the policy reads.
    requires: ClassVar[tuple[str, ...]]

    @abstractmethod
    def start(self, observation: Observation) -> Any:
        """State at the beginning of an episode."""

    @abstractmethod
    def act(self, observation: Observation, state: Any) -> tuple[np.ndarray, Any]:
        """Action (n_inputs,) in [-1, 1] and next state."""

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """See `softrobot_env.interfaces.Policy`.

        Raises:
            ValueError: The observation lacks an observable in `requires`.
        """
        missing = [name for name in self.requires if name not in observation]
        if missing:
            raise ValueError(
                f"{type(self).__name__} needs the observables {', '.join(self.requires)}; add "
                f"{', '.join(missing)} to the environment's observe="
            )
        if observation[self.requires[0]].ndim == 1:
            fresh = state is None or (episode_start is not None and bool(np.any(episode_start)))
            action, state = self.act(observation, self.start(observation) if fresh else state)
            return action.astype(np.float32), state
        return self._predict_stacked(observation, state, episode_start)

    def _predict_stacked(
        self, observation: Observation, state: Any, episode_start: np.ndarray | None
    ) -> tuple[np.ndarray, list[Any]]:
        count = len(observation[self.requires[0]])
        states = [None] * count if state is None else list(state)
        starts = np.zeros(count, bool) if episode_start is None else np.asarray(episode_start)
        actions = []
        for i in range(count):
            one = {name: observation[name][i] for name in self.requires}
            fresh = states[i] is None or bool(starts[i])
            action, states[i] = self.act(one, self.start(one) if fresh else states[i])
            actions.append(action.astype(np.float32))
        return np.stack(actions), states
