"""Playing one episode of a policy in an environment."""

from collections.abc import Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import gymnasium
import numpy as np

from softrobot_env.interfaces import Observation, Policy


@dataclass(frozen=True)
class Moment:
    """The state of an episode at a control instant.

    Attributes:
        observation, info: As `reset` or `step` returned them.
        reward: [1] of the step that led here, zero at the start.
        policy_time: [s] spent in `predict` for that step; None at the start, and while a policy
            that decides less often only holds its action (and an observer may go on).
        status: Why the policy's action was not the one it wanted, or None.
        failed: Whether that step failed.
    """

    observation: Observation
    info: dict[str, Any]
    reward: float = 0.0
    policy_time: float | None = None
    status: str | None = None
    failed: bool = False


def play(
    env: gymnasium.Env,
    policy: Policy,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
) -> Iterator[Moment]:
    """Reset, then step to the end of the episode, yielding every instant.

    A policy that says what it `requires` is shown nothing else.
    """
    observation, info = env.reset(seed=seed, options=options)
    yield Moment(observation, info)
    names, hold = getattr(policy, "requires", None), getattr(policy, "hold", 1)
    state, start, over, count = None, np.array([True]), False, 0
    while not over:
        seen = observation if names is None else {name: observation[name] for name in names}
        before = perf_counter()
        action, state = policy.predict(seen, state, start, True)
        policy_time = perf_counter() - before
        start = np.array([False])
        observation, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        decided = policy_time if count % hold == 0 else None
        status = getattr(state, "status", None)
        yield Moment(observation, info, float(reward), decided, status, terminated)
        count += 1
