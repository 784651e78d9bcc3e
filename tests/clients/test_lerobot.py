"""LeRobot drives our robots, its datasets hold our episodes, its policies drive in turn.

With `lerobot` 0.4.4 in the environment (`pip install -e examples/lerobot_softrobot`).
"""

import os
import pty
import subprocess
import sys
import time
from contextlib import closing, contextmanager
from dataclasses import replace
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
from lerobot_robot_softrobot import (  # noqa: E402
    SoftRobotConfig,
    SoftRobotKeys,
    SoftRobotKeysConfig,
)
from lerobot_robot_softrobot.policy import environment, trained  # noqa: E402
from lerobot_robot_softrobot.record import record  # noqa: E402

from softrobot_env.hardware.tip import listen  # noqa: E402
from softrobot_env.robots import find_robot  # noqa: E402
from softrobot_env.robots.file import write_robot  # noqa: E402

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


@contextmanager
def trunk(tmp_path):
    """The file of a trunk whose motors run virtually, and their pictures' way to it."""
    with closing(listen("127.0.0.1", 0)) as free:
        number = free.getsockname()[1]
    robot, link = find_robot(str(PLUGIN.parent / "motor_trunk.toml")), tmp_path / "motors"
    patient = {"latency_ms": 30, "watchdog_ms": 1000, "patience_ms": 2000, "port": str(link)}
    tip = {"kind": "udp", "port": number}
    write_robot(
        replace(robot, hardware=robot.hardware | patient | {"tip": tip}), tmp_path / "a.toml"
    )
    words = f"robot virtual --hardware dynamixel --robot {tmp_path}/a.toml --link {link}"
    words += f" --camera-port {number} --seconds 120"
    with subprocess.Popen([sys.executable, "-m", "softrobot_env", *words.split()]) as motors:
        try:
            end = time.monotonic() + 60
            while not link.exists():
                assert time.monotonic() < end and motors.poll() is None
                time.sleep(0.05)
            yield tmp_path / "a.toml"
        finally:
            motors.terminate()


def test_lerobots_own_recording_of_motors_by_keys(tmp_path, monkeypatch, place):
    """`lerobot-record`, of a real robot's environment over an emulated bus."""
    pytest.importorskip("dynamixel_sdk", reason="needs the robot extra")
    from lerobot.scripts import lerobot_record

    ours, theirs = pty.openpty()
    made = {"repo_id": "softrobot/hand", "root": tmp_path / "set", "single_task": "reach"}
    short = {"fps": 50, "episode_time_s": 1.5, "reset_time_s": 0, "num_episodes": 1}
    with trunk(tmp_path) as file, os.fdopen(theirs, "r") as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        monkeypatch.setattr(sys, "argv", ["lerobot-record"])
        options = {"robot": str(file), "task": "reach", "max_missed": 10_000, "oldest": 2.0}
        connect = SoftRobotKeys.connect

        def connected(keys, calibrate=True):
            connect(keys, calibrate)
            os.write(ours, b"qqww")  # all at once: the motors' speed limits them

        monkeypatch.setattr(SoftRobotKeys, "connect", connected)
        lerobot_record.record(
            lerobot_record.RecordConfig(
                robot=SoftRobotConfig(environment="SoftRobot/Real-v0", options=options, **place),
                teleop=SoftRobotKeysConfig(inputs=6, **place),
                dataset=lerobot_record.DatasetRecordConfig(
                    **made, **short, video=False, push_to_hub=False
                ),
                play_sounds=False,
            )
        )
    os.close(ours)
    recorded = LeRobotDataset("softrobot/hand", root=tmp_path / "set")
    assert recorded.num_episodes == 1 and recorded.num_frames > 20
    last = recorded[recorded.num_frames - 1]
    assert last["action"].numpy() == pytest.approx([0.1, 0.1, 0, 0, 0, 0])
    moved = last["observation.state"] - recorded[0]["observation.state"]
    assert moved.abs().max() > 1e-3


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
