"""Policies that others made, as `interfaces.Policy`: objects with `predict`, or only with `act`."""

from typing import Any

import numpy as np

from softrobot_env.core.interfaces import Observation, Policy


class Acting:
    """A policy without a state of its own to return, from `act(observation)`.

    Its object may keep what it likes between calls: it serves one environment.

    Attributes:
        requires: Observables that it is shown, where it says so; else all.
    """

    def __init__(self, acting: Any) -> None:
        self._act = acting.act
        if hasattr(acting, "requires"):
            self.requires = tuple(acting.requires)

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """See `softrobot_env.core.interfaces.Policy`."""
        return np.asarray(self._act(observation)), state


class Model:
    """A model whose `observation_space` says which observables it knows, as stable-baselines3's.

    Attributes:
        requires: These observables.
        predict: Of the model, see `softrobot_env.core.interfaces.Policy`.
    """

    def __init__(self, model: Any) -> None:
        self.predict = model.predict
        self.requires = tuple(model.observation_space.spaces)


def is_policy(made: Any) -> bool:
    """Whether an object has `predict` or `act`."""
    return any(callable(getattr(made, name, None)) for name in ("predict", "act"))


def no_policy(made: Any) -> str:
    """What is wrong with an object that is no policy."""
    return (
        "a policy has predict(observation, state, episode_start, deterministic) or "
        f"act(observation), and {type(made).__name__!r} has neither"
    )


def as_policy(made: Any, name: str) -> Policy:
    """An object as a policy.

    Raises:
        ValueError: It has neither `predict` nor `act`, or reads a vector of it knows not what.
    """
    if not is_policy(made):
        raise ValueError(f"policy {name!r}: {no_policy(made)}")
    if not callable(getattr(made, "predict", None)):
        return Acting(made)
    known = getattr(made, "observation_space", None)
    if not hasattr(made, "requires") and len(getattr(known, "shape", None) or ()) == 1:
        raise ValueError(
            f"policy {name!r} reads one vector of {known.shape[0]} entries and does not tell of "
            "what: write it by `training.artifacts.save_vector_policy`, and give that file"
        )
    if hasattr(made, "requires") or not hasattr(known, "spaces"):
        return made
    return Model(made)
