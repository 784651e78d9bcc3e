"""Playing one episode of a policy in an environment."""

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from softrobot_env.interfaces import Observation, Policy

if TYPE_CHECKING:
    import gymnasium


@dataclass(frozen=True)
class Moment:
    """The state of an episode at a control instant.

    Attributes:
        observation, info: As `reset` or `step` returned them.
        reward: [1] of the step that led here, zero at the start.
        policy_time: [s] spent in `predict` for that step, None at the start.
        failed: Whether that step failed.
    """

    observation: Observation
    info: dict[str, Any]
    reward: float = 0.0
    policy_time: float | None = None
    failed: bool = False


def play(
    env: "gymnasium.Env",
    policy: Policy,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
) -> Iterator[Moment]:
    """Reset, then step to the end of the episode, yielding every instant.

    A policy that says what it `requires` is shown nothing else.
    """
    observation, info = env.reset(seed=seed, options=options)
    yield Moment(observation, info)
    names = getattr(policy, "requires", None)
    state, start, over = None, np.array([True]), False
    while not over:
        seen = observation if names is None else {name: observation[name] for name in names}
        before = perf_counter()
        action, state = policy.predict(seen, state, start, True)
        policy_time = perf_counter() - before
        start = np.array([False])
        observation, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        yield Moment(observation, info, float(reward), policy_time, terminated)
