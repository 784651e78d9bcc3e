"""Fixtures shared by the environment tests."""

import gymnasium
import numpy as np
import pytest

import softrobot_env  # noqa: F401  (registers the ids)
from softrobot_env.registration import ENVIRONMENTS


@pytest.fixture(params=ENVIRONMENTS)
def env_id(request):
    """Every registered id in turn."""
    return request.param


@pytest.fixture
def make_env():
    """Factory of bare environments (no wrappers); closes what it made."""
    made = []

    def make(env_id="SoftRobot/ArmSwing-v0", **kwargs):
        env = gymnasium.make(env_id, **kwargs).unwrapped
        made.append(env)
        return env

    yield make
    for env in made:
        env.close()


@pytest.fixture
def hold_action():
    """Factory of the action that keeps the task's start input."""

    def action(env):
        return (np.array(env.task.start_input) / env.input_scale).astype(np.float32)

    return action
