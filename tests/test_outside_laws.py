"""One file of at most 60 lines adds what it adds, in single and in vector environments."""

import subprocess
import sys
from pathlib import Path

import pytest

OUTSIDE = Path(__file__).parent / "outside" / "laws"

#: What is added -> the environment's arguments, and the policy that acts in it.
ADDED = {
    "policy": ({"robot": "planar_finger", "task": "circle"}, "proportional"),
    "robot": ({"robot": "worm", "task": "figure_eight"}, "feedforward_pi"),
    "task": ({"robot": "planar_finger", "task": "to_and_fro"}, "static"),
}

RUN = """
import sys
import gymnasium, numpy as np
import softrobot_env
from softrobot_env.control.registry import make_policy, policy_environment
sys.path.insert(0, {folder!r})
import {module}
{module}.register()
options = {options!r} | policy_environment({policy!r}, {options!r}["robot"])
env = gymnasium.make("SoftRobot/Track-v0", **options)
many = gymnasium.make_vec("SoftRobot/Track-v0", num_envs=2, **options)
policy = make_policy({policy!r}, env)
observation, _ = env.reset(seed=0)
stacked, _ = many.reset(seed=0)
state = None
for _ in range(5):
    action, state = policy.predict(observation, state)
    observation, reward, terminated, *_ = env.step(action)
    stacked, rewards, ended, *_ = many.step(np.stack([action, action]))
    assert np.isfinite(reward) and not terminated and not ended.any()
assert np.abs(stacked["tip_position"] - observation["tip_position"]).max() < 1e-9
print(env.unwrapped.task.name, env.unwrapped.task.robot.name)
"""


@pytest.mark.parametrize("module", ADDED)
def test_one_file_adds_it(module):
    assert len((OUTSIDE / f"{module}.py").read_text().splitlines()) <= 60
    options, policy = ADDED[module]
    code = RUN.format(folder=str(OUTSIDE), module=module, options=options, policy=policy)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [options["task"], options["robot"]]
