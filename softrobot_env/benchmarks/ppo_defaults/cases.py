"""Trainings with the default settings of stable-baselines3, and what they are compared with."""

from dataclasses import dataclass, field
from functools import partial
from typing import Any

import gymnasium
import numpy as np

from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.core.interfaces import Policy
from softrobot_env.training.default_ppo import train
from softrobot_env.training.vec_env import make_vec_env

#: Environments side by side. More of them make fewer updates of as many steps.
ENVIRONMENTS = 4

#: Seed of the first episode that policies are compared on; none of a training has it.
_FIRST_EPISODE = 10_000


@dataclass(frozen=True)
class Case:
    """An environment, and the error to undercut.

    Attributes:
        env_id: Of the environment.
        goal: [m], mean error, or the policy whose mean error on the same episodes it is.
        episodes: On which it counts; one where all are alike.
        options: Of the environment.
    """

    env_id: str
    goal: float | str
    episodes: int = 1
    options: dict[str, Any] = field(default_factory=dict)


CASES = {
    "ArmStep": Case("SoftRobot/ArmStep-v0", 1e-3),
    "ArmSwing": Case("SoftRobot/ArmSwing-v0", 5e-3),
    "RigReach": Case("SoftRobot/RigReach-v0", "rig_nn", 5),
    "hanging_trunk": Case(
        "SoftRobot/Track-v0", "static", 1, {"robot": "hanging_trunk", "task": "circle"}
    ),
}


def mean_error(env: gymnasium.Env, policy: Policy, episodes: int) -> float:
    """Mean error [m] of a policy over all instants of some episodes, infinite if one failed."""
    errors = []
    for k in range(episodes):
        observation, _ = env.reset(seed=_FIRST_EPISODE + k)
        state, over = None, False
        while not over:
            action, state = policy.predict(observation, state, deterministic=True)
            observation, _, failed, ended, info = env.step(action)
            errors.append(np.inf if failed else info["error"])
            over = failed or ended
    return float(np.mean(errors))


def goal_of(case: Case) -> float:
    """The mean error [m] to undercut."""
    if not isinstance(case.goal, str):
        return case.goal
    env = gymnasium.make(case.env_id, **case.options, **policy_environment(case.goal))
    return mean_error(env, make_policy(case.goal, env), case.episodes)


def train_case(case: Case, seed: int, steps: int) -> list[tuple[int, float]]:
    """Train in an environment; steps and mean error [m] from before the training to after it."""
    options = case.options | {"observe_as": "vector"}
    env = gymnasium.make(case.env_id, **options)
    training = make_vec_env(case.env_id, ENVIRONMENTS, threads=1, **options)
    return train(training, seed, steps, partial(mean_error, env, episodes=case.episodes))
