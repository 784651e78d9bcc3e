"""Every entry of every registry loads, and nothing else loads by name."""

import os
import shlex
from pathlib import Path

import gymnasium
import pytest
from gymnasium.envs.registration import registry as ids
from support.processes import finished

from softrobot_env import registration
from softrobot_env.beams.registry import MUJOCO, PLANTS, BeamPlant
from softrobot_env.cli import build_parser
from softrobot_env.commands.registry import COMMANDS, loaded
from softrobot_env.commands.robot.command import COMMANDS as ROBOT_COMMANDS
from softrobot_env.control import registry
from softrobot_env.core.registry import load
from softrobot_env.robots import ARM, ROBOTS, RobotParams
from softrobot_env.tasks import ALL_TASKS, RIG_TASKS, make_task

ROOT = Path(__file__).resolve().parents[1]

# ---------------------------------------------------------------- entries


def test_robots_have_their_names():
    assert {name: robot.name for name, robot in ROBOTS.items()} == {name: name for name in ROBOTS}
    assert all(isinstance(robot, RobotParams) for robot in ROBOTS.values())


def test_tasks_are_made_by_their_names():
    assert {name: make_task(name).name for name in ALL_TASKS} == {n: n for n in ALL_TASKS}
    assert {name: make().name for name, make in RIG_TASKS.items()} == {n: n for n in RIG_TASKS}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow if n == "ancf" else ()) for n in PLANTS]
)
def test_plants_are_built(name):
    if name == MUJOCO:
        assert name == PLANTS[0]
    else:
        model = BeamPlant(name)(ARM)
        at_rest = model.measure(model.rest(), 0 * model.rest())
        assert at_rest.tip_position == pytest.approx([0.0, ARM.length])


@pytest.mark.parametrize(
    "name", registry.POLICIES | registry.RIG_POLICIES | registry.REDUCED_POLICIES
)
def test_policies_take_the_options_that_are_told_of_them(name):
    """`tests/control/test_policy_contract.py` makes and runs each."""
    spec = registry.find_policy(name, registry.home_robot(name))
    assert callable(load(spec.make))
    assert all(spec.takes(option) for option in spec.options)


@pytest.mark.parametrize(
    ("prefix", "name", "command"),
    [("", name, command) for name, command in COMMANDS.items()]
    + [("robot ", name, command) for name, command in ROBOT_COMMANDS.items()],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_commands_parse_their_own_examples(prefix, name, command):
    module = loaded(command[0])
    examples = [shlex.split(line, comments=True) for line in module.EXAMPLE.splitlines()]
    assert examples and all(examples)
    for program, *words in examples:
        assert program == "softrobot" and " ".join(words).startswith(prefix + name)
        run = build_parser().parse_args(words).run
        assert callable(run) and getattr(module, "run", run) == run


# ---------------------------------------------------------------- environments

EVERY_ID = registration.ENVIRONMENTS | registration.RIG_ENVIRONMENTS


FRESH = f"""
import gymnasium
module = "softrobot_env:"
for env_id in {list(EVERY_ID)}:
    env = gymnasium.make(module + env_id)
    module = ""
    env.reset(seed=0)
    print(env.spec.id, env.unwrapped.task.name)
"""


def test_make_in_a_fresh_interpreter():
    """By the name of the module, which loads it, and then without."""
    alone = {"cwd": ROOT.anchor, "env": os.environ | {"PYTHONPATH": str(ROOT)}}
    done = finished("-W", "error", "-c", FRESH, **alone)
    assert done.returncode == 0, done.stderr
    assert dict(line.split() for line in done.stdout.splitlines()) == EVERY_ID


def test_registering_again_changes_nothing():
    before = dict(ids)
    registration.register_envs()
    assert dict(ids) == before
    assert all(ids[i] is before[i] for i in EVERY_ID)


def test_ids_stand_for_tasks_one_to_one():
    assert sorted(registration.ENVIRONMENTS.values()) == sorted(ALL_TASKS)
    assert sorted(registration.RIG_ENVIRONMENTS.values()) == sorted(RIG_TASKS)


@pytest.mark.parametrize(("env_id", "task"), EVERY_ID.items())
def test_spec_round_trip(env_id, task):
    env = gymnasium.make(env_id, control_period=0.025)
    again = gymnasium.make(env.spec)
    assert again.unwrapped.task.name == task
    assert again.unwrapped.control_period == 0.025
