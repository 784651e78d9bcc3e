"""Environments are found by id, in a fresh interpreter too."""

import os
import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest
from gymnasium.envs.registration import registry

from softrobot_env.registration import ENVIRONMENTS, RIG_ENVIRONMENTS, register_envs
from softrobot_env.tasks import ALL_TASKS, RIG_TASKS

EVERY_ID = ENVIRONMENTS | RIG_ENVIRONMENTS

ROOT = Path(__file__).resolve().parents[1]


def run(code: str) -> str:
    """Output of a fresh interpreter that finds the package and nothing imported yet."""
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        cwd=ROOT.anchor,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


@pytest.mark.parametrize("prefix", ["import softrobot_env", ""], ids=["imported", "by module name"])
def test_make_in_a_fresh_interpreter(prefix):
    module = "" if prefix else "softrobot_env:"
    tasks = run(
        f"""
import gymnasium
{prefix}
for env_id in {list(EVERY_ID)}:
    env = gymnasium.make("{module}" + env_id)
    env.reset(seed=0)
    print(env.spec.id, env.unwrapped.task.name)
"""
    )
    assert dict(line.split() for line in tasks.splitlines()) == EVERY_ID


def test_registering_again_changes_nothing():
    before = dict(registry)
    register_envs()
    assert dict(registry) == before
    assert all(registry[i] is before[i] for i in EVERY_ID)


def test_ids_stand_for_tasks_one_to_one():
    assert sorted(ENVIRONMENTS.values()) == sorted(ALL_TASKS)
    assert sorted(RIG_ENVIRONMENTS.values()) == sorted(RIG_TASKS)


@pytest.mark.parametrize(("env_id", "task"), EVERY_ID.items())
def test_spec_round_trip(env_id, task):
    env = gymnasium.make(env_id, control_period=0.025)
    again = gymnasium.make(env.spec)
    assert again.unwrapped.task.name == task
    assert again.unwrapped.control_period == 0.025
