"""Observations and actions of softrobot_env as LeRobot has them: one name for each number."""

import gymnasium
import numpy as np

#: What an observable's name begins with that tells of the task and not of the robot.
TASK = "reference"

#: File of a dataset with the options of the environment it was recorded in.
OPTIONS = "softrobot.json"


def observation_names(env: gymnasium.Env) -> list[str]:
    """`tip_position.0`, ... of an environment that observes a dict, in its order."""
    spaces = env.observation_space.spaces
    return [f"{name}.{i}" for name in spaces for i in range(spaces[name].shape[0])]


def action_names(env: gymnasium.Env) -> list[str]:
    """`input.0`, ..."""
    return [f"input.{i}" for i in range(env.action_space.shape[0])]


def flat(observation: dict[str, np.ndarray]) -> dict[str, float]:
    """An observation by those names."""
    return {
        f"{name}.{i}": float(value)
        for name, values in observation.items()
        for i, value in enumerate(np.ravel(values))
    }


def split(observation: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """An observation as a policy's inputs: of the robot, and of the task (float32 vectors)."""
    parts = {"observation.state": [], "observation.environment_state": []}
    for name, values in observation.items():
        key = "observation.environment_state" if name.startswith(TASK) else "observation.state"
        parts[key].append(np.ravel(values))
    return {key: np.concatenate(each).astype(np.float32) for key, each in parts.items() if each}
