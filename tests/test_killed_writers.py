"""A kill or a full disk in the middle of a write leaves the file before it whole, of every kind."""

import os
import resource
import signal
import time
from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.core.artifacts import read_facts
from softrobot_env.evaluation.report import write_json
from softrobot_env.hardware.robot_file import read_robot_file, virtual_file, write_robot_file
from softrobot_env.learned.network import Network, Scaling, initial_network
from softrobot_env.recordings import read_header, read_recording
from softrobot_env.robots import ROBOTS, read_robot, write_robot

_TIMES = 100

_ENDS = Scaling(-np.ones(20), np.ones(20))
_NETWORK = initial_network((200, 200), _ENDS, _ENDS, np.random.default_rng(0))


def _write_plot(path):
    pytest.importorskip("matplotlib")
    from softrobot_env.rendering.figures import new_figure, save

    figure, axes = new_figure(1, 1, (3.0, 2.0))
    axes[0, 0].plot(np.arange(9))
    save(figure, path)


def _read_plot(path):
    from PIL import Image

    with Image.open(path) as picture:
        picture.load()


def _write_video(path):
    pytest.importorskip("imageio")
    from softrobot_env.rendering.video import write_video

    write_video(path, np.random.default_rng(0).integers(0, 255, (9, 60, 80, 3), np.uint8), 10)


def _write_checkpoint(path):
    pytest.importorskip("stable_baselines3")
    from training.test_checkpoint import FIRST

    from softrobot_env.training.checkpoint import write

    write(path.parent, replace(FIRST, best=_NETWORK))


def _read_checkpoint(path):
    from softrobot_env.training.checkpoint import read

    assert read(path.parent) is not None


def _write_recording(path):
    from test_damaged_files import SHORT_RECORDING

    from softrobot_env.recordings import write_recording

    write_recording(SHORT_RECORDING, path)


KINDS = {
    "network.npz": (lambda path: _NETWORK.save(path, {"seed": 1}), Network.load),
    "report.json": (
        lambda path: write_json(path, [{"x": 1.5, "y": k} for k in range(3000)], "softrobot x"),
        read_facts,
    ),
    "robot.toml": (lambda path: write_robot(ROBOTS["hanging_trunk"], path), read_robot),
    "rig.toml": (lambda path: write_robot_file(virtual_file(), path), read_robot_file),
    "plot.png": (_write_plot, _read_plot),
    "video.gif": (_write_video, _read_plot),
    "recording.csv": (_write_recording, read_recording),
    "recording.toml": (lambda path: _write_recording(path.with_suffix(".csv")), read_header),
    "checkpoint.pt": (_write_checkpoint, _read_checkpoint),
}


def in_a_child(work) -> int:
    """Process id of a child that works until it is killed."""
    child = os.fork()
    if child == 0:
        try:
            work()
        finally:
            os._exit(0)
    return child


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_a_kill_loses_nothing(name, tmp_path):
    write, read = KINDS[name]
    path = tmp_path / name
    write(path)
    began = time.perf_counter()
    write(path)
    took = time.perf_counter() - began
    rng = np.random.default_rng(0)

    def again():
        while True:
            write(path)

    for _ in range(_TIMES):
        child = in_a_child(again)
        time.sleep(rng.uniform(0.0, 3 * took))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        read(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_a_full_disk_loses_nothing(name, tmp_path):
    write, read = KINDS[name]
    path = tmp_path / name
    write(path)
    size, rng = path.stat().st_size, np.random.default_rng(0)

    def once():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        room = int(rng.uniform(0, size))
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # the traceback of the child
        write(path)

    for _ in range(_TIMES):
        rng.uniform()
        os.waitpid(in_a_child(once), 0)
        read(path)
        assert path.stat().st_size == size
        assert len([each for each in tmp_path.iterdir() if each.name.startswith(".")]) == 0
