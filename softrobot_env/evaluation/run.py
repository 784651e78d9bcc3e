"""One episode of a policy in an environment, recorded."""

from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from softrobot_env.episode import Moment, play
from softrobot_env.interfaces import Policy
from softrobot_env.rollout import Rollout

if TYPE_CHECKING:
    import gymnasium

#: Observables a recorded environment has to provide.
RECORDED = ("tip_position", "reference", "curvature", "previous_action")


def run_episode(
    env: "gymnasium.Env",
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

    Raises:
        ValueError: The environment does not provide what is recorded.
    """
    missing = [name for name in RECORDED if name not in env.observation_space.spaces]
    if missing:
        raise ValueError(f'recording needs the observables {missing}: pass observe="all"')
    begin = perf_counter()
    moments = list(play(env, policy, seed, options))
    wall_time = perf_counter() - begin
    decisions = [moment for moment in moments if moment.policy_time is not None]
    samples = [_sample(moment) for moment in moments if not moment.failed]
    return Rollout(
        **{name: np.array([s[name] for s in samples]) for name in samples[0]},
        policy_time=np.array([m.policy_time for m in decisions]),
        policy_status=np.array([m.status or "" for m in decisions]),
        wall_time=wall_time,
        failure=moments[-1].info.get("failure"),
    )


def warm_up(env: "gymnasium.Env", policy: Policy) -> None:
    """Run one step, so that no policy time includes what happens on a first call only."""
    for _ in play(env, policy, options={"duration": env.unwrapped.control_period}):
        pass


def _sample(moment: Moment) -> dict[str, Any]:
    observation, info = moment.observation, moment.info
    return {
        "time": info["time"],
        "reference": _in_space(observation["reference"]),
        "tip": _in_space(observation["tip_position"]),
        "action": observation["previous_action"],
        "tendon_tension": info["tendon_tension"],
        "tendon_length": info["tendon_length"],
        "curvature": observation["curvature"],
        "reward": moment.reward,
    }


def _in_space(point: np.ndarray) -> np.ndarray:
    """(3,) from (x, z) of a planar robot, or unchanged."""
    return np.array([point[0], 0.0, point[1]]) if len(point) == 2 else point
