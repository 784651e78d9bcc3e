"""One episode of a policy in an environment, recorded."""

from time import perf_counter
from typing import Any

import gymnasium
import numpy as np

from softrobot_env.interfaces import Observation, Policy
from softrobot_env.rollout import Rollout

#: Observables a recorded environment has to provide.
RECORDED = ("tip_position", "reference", "curvature", "previous_action")


def run_episode(
    env: gymnasium.Env,
    policy: Policy,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
) -> Rollout:
    """Run one episode to its end.

    Args:
        env: Environment that observes at least `RECORDED` and what the policy needs.
        policy: A policy; it sees only the observables it `requires`, if it says so.
        seed, options: Passed to `reset`.

    Returns:
        The record. After a failure it ends at the last instant before it.
    """
    missing = [name for name in RECORDED if name not in env.observation_space.spaces]
    if missing:
        raise ValueError(f'recording needs the observables {missing}: pass observe="all"')
    begin = perf_counter()
    observation, info = env.reset(seed=seed, options=options)
    samples = [_sample(observation, info, 0.0)]
    policy_time: list[float] = []
    state, start, over = None, np.array([True]), False
    while not over:
        seen = _visible(observation, policy)
        before = perf_counter()
        action, state = policy.predict(seen, state, start, True)
        policy_time.append(perf_counter() - before)
        start = np.array([False])
        observation, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        if not terminated:
            samples.append(_sample(observation, info, float(reward)))
    return _rollout(samples, policy_time, perf_counter() - begin, info.get("failure"))


def _visible(observation: Observation, policy: Policy) -> Observation:
    names = getattr(policy, "requires", None)
    return observation if names is None else {name: observation[name] for name in names}


def _sample(observation: Observation, info: dict[str, Any], reward: float) -> dict[str, Any]:
    return {
        "time": info["time"],
        "reference": _in_space(observation["reference"]),
        "tip": _in_space(observation["tip_position"]),
        "action": observation["previous_action"],
        "tendon_tension": info["tendon_tension"],
        "tendon_length": info["tendon_length"],
        "curvature": observation["curvature"],
        "reward": reward,
    }


def _in_space(point: np.ndarray) -> np.ndarray:
    """(3,) from (x, z) of a planar robot, or unchanged."""
    return np.array([point[0], 0.0, point[1]]) if len(point) == 2 else point


def _rollout(
    samples: list[dict[str, Any]], policy_time: list[float], wall_time: float, failure: str | None
) -> Rollout:
    series = {name: np.array([s[name] for s in samples]) for name in samples[0]}
    return Rollout(
        **series, policy_time=np.array(policy_time), wall_time=wall_time, failure=failure
    )
