"""LeRobot drives our robots, its datasets hold our episodes, its policies drive in turn.

With `lerobot` 0.4.4 in the environment (`pip install -e examples/lerobot_softrobot`).
"""

import os
import pty
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lerobot")

PLUGIN = Path(__file__).resolve().parents[2] / "examples" / "lerobot_softrobot"
sys.path.insert(0, str(PLUGIN))

import gymnasium  # noqa: E402
from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: E402
from lerobot.datasets.utils import build_dataset_frame, hw_to_dataset_features  # noqa: E402
from lerobot.robots import make_robot_from_config  # noqa: E402
from lerobot.teleoperators import make_teleoperator_from_config  # noqa: E402
from lerobot_robot_softrobot import SoftRobotConfig, SoftRobotKeysConfig  # noqa: E402
from lerobot_robot_softrobot.policy import environment, trained  # noqa: E402
from lerobot_robot_softrobot.record import record  # noqa: E402

ENV = "SoftRobot/ArmSwing-v0"


@pytest.fixture
def place(tmp_path):
    return {"calibration_dir": tmp_path / "calibration", "id": "one"}


def test_the_robot_has_lerobots_shape_and_the_environments_motion(place):
    robot = make_robot_from_config(SoftRobotConfig(environment=ENV, **place))
    assert not robot.is_connected and robot.is_calibrated
    with pytest.raises(RuntimeError, match="not connected"):
        robot.get_observation()
    env = gymnasium.make(ENV)
    with robot:
        seen, _ = env.reset()
        for k in range(5):
            action = np.full(env.action_space.shape, 0.1 * k, np.float32)
            sent = robot.send_action(dict.fromkeys(robot.action_features, 0.1 * k))
            seen, *_ = env.step(action)
            assert list(sent.values()) == pytest.approx(action)
            found = robot.get_observation()
            assert list(found) == list(robot.observation_features)
            assert list(found.values()) == pytest.approx(np.concatenate([*seen.values()]))
        with pytest.raises(ValueError, match="is missing"):
            robot.send_action({})
    assert not robot.is_connected and robot.fps == 1 / env.unwrapped.control_period


def test_frames_are_those_of_lerobots_datasets(place, tmp_path):
    robot = make_robot_from_config(SoftRobotConfig(environment=ENV, **place))
    seen = hw_to_dataset_features(robot.observation_features, "observation", use_video=False)
    columns = seen | hw_to_dataset_features(robot.action_features, "action", use_video=False)
    dataset = LeRobotDataset.create(
        "softrobot/test", round(robot.fps), columns, tmp_path / "set", use_videos=False
    )
    with robot:
        for _ in range(4):
            observation = build_dataset_frame(columns, robot.get_observation(), "observation")
            sent = robot.send_action(dict.fromkeys(robot.action_features, 0.2))
            action = build_dataset_frame(columns, sent, "action")
            dataset.add_frame(observation | action | {"task": "swing"})
    dataset.save_episode()
    dataset.finalize()
    again = LeRobotDataset("softrobot/test", root=tmp_path / "set")
    assert again.num_episodes == 1 and again.num_frames == 4
    assert again[3]["action"].numpy() == pytest.approx(0.2)


def test_keys_of_a_terminal_are_inputs(place, monkeypatch):
    ours, theirs = pty.openpty()
    keys = make_teleoperator_from_config(SoftRobotKeysConfig(inputs=2, step=0.25, **place))
    with os.fdopen(theirs, "r") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        with keys:
            assert keys.get_action() == {"input.0": 0.0, "input.1": 0.0}
            os.write(ours, b"qqsxz\xff")
            assert keys.get_action() == {"input.0": 0.5, "input.1": -0.25}
            os.write(ours, b"qqqqqq")
            assert keys.get_action() == {"input.0": 1.0, "input.1": -0.25}
            os.write(ours, b" ")
            assert keys.get_action() == {"input.0": 0.0, "input.1": 0.0}
        assert not keys.is_connected
    os.close(ours)
    with pytest.raises(ValueError, match="inputs must be from 1 to 10"):
        make_teleoperator_from_config(SoftRobotKeysConfig(inputs=11, **place))


@pytest.mark.slow
def test_a_policy_trained_there_plays_here(tmp_path, monkeypatch):
    """It learns a little of the expert: far better than nothing, with so little training."""
    dataset = record(ENV, "lq_adaptive", 4, tmp_path / "set", noise=0.2)
    assert dataset.num_episodes == 4
    command = [sys.executable, "-m", "lerobot.scripts.lerobot_train"]
    command += ["--dataset.repo_id=softrobot/set", f"--dataset.root={tmp_path / 'set'}"]
    command += ["--policy.type=act", "--policy.device=cpu", "--policy.push_to_hub=false"]
    command += ["--policy.chunk_size=10", "--policy.n_action_steps=1", "--policy.dim_model=64"]
    command += ["--policy.n_heads=4", "--policy.dim_feedforward=128", "--policy.use_vae=false"]
    command += ["--batch_size=32", "--steps=400", "--num_workers=0", "--wandb.enable=false"]
    command += [f"--output_dir={tmp_path / 'train'}", "--policy.optimizer_lr=1e-3"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    folder = tmp_path / "train" / "checkpoints" / "last" / "pretrained_model"
    monkeypatch.setenv("LEROBOT_POLICY", str(folder))
    options = environment(None)
    learned, nothing = mean_error(trained(None, 0.0), options), mean_error(None, options)
    assert learned < 0.5 * nothing


def mean_error(policy, options):
    """Mean distance [m] to the reference over an episode."""
    env = gymnasium.make(ENV, **options)
    observation, info = env.reset(seed=99)
    found, start, over = [], True, False
    while not over:
        if policy is None:
            action = np.zeros(env.action_space.shape, np.float32)
        else:
            action, _ = policy.predict(observation, None, np.array([start]), True)
        observation, _, terminated, truncated, info = env.step(action)
        found.append(info["error"])
        start, over = False, terminated or truncated
    return np.mean(found)
