"""Files of every kind: damaged ones, and what a kill or a full disk leaves of those that we write.

What is cut, overwritten or edited badly is refused in a line, or read with finite content: 500
times of each kind, by a fixed seed. A write that is broken off leaves the file before it whole.
"""

import os
import resource
import shutil
import signal
import time
from dataclasses import fields, is_dataclass, replace
from functools import partial
from io import BytesIO

import numpy as np
import pytest

from softrobot_env import recordings
from softrobot_env.control.registry import make_policy
from softrobot_env.control.sensed import load_reconstruction
from softrobot_env.core.artifacts import read_arrays, read_facts
from softrobot_env.core.files import assets_dir, models_dir
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.report import write_json
from softrobot_env.evaluation.rollout import _UNMEASURED, Rollout
from softrobot_env.evaluation.run import run_episode
from softrobot_env.hardware.errors import RobotError
from softrobot_env.hardware.robot_file import read_robot_file, virtual_file, write_robot_file
from softrobot_env.hardware.transport import LoggingTransport, read_link_log
from softrobot_env.identification.fit.residual import Residual, read_residual
from softrobot_env.learned.network import Network, Scaling, initial_network
from softrobot_env.learned.reduction import ReducedModel
from softrobot_env.recordings.header import Time
from softrobot_env.robots import ARM, RIG, ROBOTS, read_gripper, read_robot, write_robot
from softrobot_env.tasks import make_task
from softrobot_env.thesis.arm.operating_points import load_gains
from softrobot_env.thesis.rig.parameters import IdentifiedParameters

_TIMES, _BROKEN_OFF = 500, 100
_MOVED = np.linspace(0.0, 1.0, 12)
SHORT_RECORDING = recordings.Recording(
    header=recordings.Header(
        commands=recordings.Commands("tension", ("a", "b"), "N", ("a", "b")),
        marker=(recordings.Marker("x", "y", "z"),),
        time=Time("t"),
        label="what",
    ),
    times=_MOVED,
    commands=np.stack([_MOVED, 1 - _MOVED], axis=1),
    markers=np.stack([_MOVED, _MOVED**2, 1 - _MOVED], axis=1)[:, None],
    labels=np.array(["go"] * 12),
    runs=np.zeros(12, dtype=int),
)
_LQI = 42  # gains a point
_TEXTS = (b"nan", b"inf", b"-1", b"1e400", b'"x"', b"[]", b"{}", b"true", b"", b"\xff", b"0")


def finite(value) -> bool:
    """Whether all floating numbers within are finite; infinity may be a limit that is none."""
    if is_dataclass(value) and not isinstance(value, type):
        return all(finite(getattr(value, field.name)) for field in fields(value))
    if isinstance(value, dict):
        return all(map(finite, value.values()))
    if isinstance(value, list | tuple | set):
        return all(map(finite, value))
    if isinstance(value, np.ndarray) and value.dtype.kind in "fc":
        return not np.isnan(value).any()
    return not (isinstance(value, float) and np.isnan(value))


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """Cut, overwritten in one to eight places, or with another value in a text."""
    how = rng.integers(3)
    if how == 0:
        return data[: rng.integers(len(data))]
    if how == 1:
        out = bytearray(data)
        for place in rng.integers(len(out), size=rng.integers(1, 9)):
            out[place] = rng.integers(256)
        return bytes(out)
    words = data.split(b" ")
    words[rng.integers(len(words))] = _TEXTS[rng.integers(len(_TEXTS))]
    return b" ".join(words)


def altered(data: bytes, rng: np.random.Generator) -> bytes:
    """A whole npz file of which one or two arrays are missing or something else."""
    arrays = dict(np.load(BytesIO(data), allow_pickle=False))
    count = min(len(arrays) - 1, rng.integers(1, 3))
    for name in map(str, rng.choice(list(arrays), size=max(count, 1), replace=False)):
        array = np.array(arrays[name])
        how = rng.integers(8)
        if how == 0 and array.dtype.kind == "f" and array.size:
            array.flat[rng.integers(array.size)] = rng.choice([np.nan, np.inf, -np.inf])
        elif how == 1:
            array = array[..., None]
        elif how == 2 and array.ndim:
            array = array[:-1]
        elif how == 3:
            array = array.astype("U9")
        elif how == 4:
            array = np.zeros(0)
        elif how == 5:
            array = np.float64(np.nan)
        elif how == 6 and array.dtype.kind in "fiu":
            array = array.astype(complex)
        elif how == 7 and len(arrays) > 1:
            arrays.pop(name, None)
            continue
        arrays[name] = array
    out = BytesIO()
    np.savez(out, **arrays)
    return out.getvalue()


def residual(path):
    features, rows = np.linspace(1, 2, 3), np.linspace(0, 1, 12).reshape(4, 3)
    Residual(features, features, features[:1], 0.5, 1.0, rows, rows).save(path)


def rollout(path):
    """The record of a short motion."""
    env = TrackingEnv(replace(make_task("swing"), duration=0.1))
    run_episode(env, make_policy("hold", ARM, env.control_period)).save(path)


def measured(path):
    """A record without what a real robot may have no sensor for."""
    found = vars(Rollout.load(path))
    return {name: value for name, value in found.items() if name not in _UNMEASURED}


def shipped(path):
    shutil.copy(models_dir() / path.name, path)


def gripper(path):
    for folder in (assets_dir() / "robots", assets_dir() / "grippers"):
        shutil.copytree(folder, path.parents[1] / folder.name)


def facts(path):
    write_json(path, [{"x": 1.5, "y": [k, 2e-3]} for k in range(300)], "softrobot x")


def network(path):
    ends = Scaling(-np.ones(20), np.ones(20))
    made = initial_network((200, 200), ends, ends, np.random.default_rng(0))
    made.save(path, {"seed": 1})


def plot(path):
    pytest.importorskip("matplotlib")
    from softrobot_env.rendering.figures import new_figure, save

    figure, axes = new_figure(1, 1, (3.0, 2.0))
    axes[0, 0].plot(np.arange(9))
    save(figure, path)


def video(path):
    pytest.importorskip("imageio")
    from softrobot_env.rendering.video import write_video

    write_video(path, np.random.default_rng(0).integers(0, 255, (9, 60, 80, 3), np.uint8), 10)


def read_picture(path):
    from PIL import Image

    with Image.open(path) as picture:
        picture.load()


def checkpoint(path):
    pytest.importorskip("torch")
    pytest.importorskip("stable_baselines3")
    from training.test_checkpoint import FIRST

    from softrobot_env.training.checkpoint import write

    write(path.parent, FIRST)


def read_checkpoint(path):
    from softrobot_env.training.checkpoint import read

    found = read(path.parent)
    return [tensor.numpy() for tensor in found.learner["weights"].values()], found.curve


def link(path):
    """A recorded link: a header and a few records."""
    transport = LoggingTransport(Quiet(), path, iter(range(99)).__next__)
    for k in range(8):
        transport.write(bytes(range(k + 3)))
    transport.close()


def recording(path):
    """Tensions and tips of a short motion, and their header."""
    if path.suffix == ".parquet":
        pytest.importorskip("pyarrow")
    table = path.with_suffix(".csv") if path.suffix == ".toml" else path
    recordings.write_recording(SHORT_RECORDING, table)


class Quiet:
    """A transport that takes all and says nothing."""

    def write(self, data):
        pass

    def close(self):
        pass


#: Name of a file, what writes it, and what reads it.
KINDS = {
    "network": ("network.npz", network, Network.load),
    "gains": ("lqi.npz", shipped, lambda path: load_gains(path, ARM, "lqi", _LQI)),
    "identified": ("rig_nn.npz", shipped, partial(IdentifiedParameters.load, RIG)),
    "rollout": ("a.npz", rollout, measured),
    "link": ("a.link", link, read_link_log),
    "robot": ("robot.toml", partial(write_robot, ROBOTS["hanging_trunk"]), read_robot),
    "gripper": ("grippers/gripper.toml", gripper, read_gripper),
    "hardware": ("rig.toml", partial(write_robot_file, virtual_file()), read_robot_file),
    "facts": ("a.json", facts, read_facts),
    "checkpoint": ("checkpoint.pt", checkpoint, read_checkpoint),
    "reduced": ("ssm.npz", shipped, lambda path: ReducedModel.read(read_arrays(path))),
    "sensors": ("sensors.npz", shipped, partial(load_reconstruction, RIG)),
    "residual": ("residual.npz", residual, read_residual),
    "recording.csv": ("a.csv", recording, recordings.read_recording),
    "recording.parquet": ("a.parquet", recording, recordings.read_recording),
    "recording.toml": ("a.toml", recording, recordings.read_header),
}


ARRAYS = ("network", "gains", "identified", "rollout", "reduced", "sensors", "residual")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "how"), [*((kind, damaged) for kind in KINDS), *((kind, altered) for kind in ARRAYS)]
)
def test_damage_is_refused_in_a_line_or_leaves_finite_content(kind, how, tmp_path):
    name, write, read = KINDS[kind]
    path, rng = tmp_path / name, np.random.default_rng(1)
    write(path)
    data = path.read_bytes()
    assert finite(read(path))
    refused = 0
    for _ in range(_TIMES):
        path.write_bytes(how(data, rng))
        try:
            found = read(path)
        except (ValueError, OSError, RobotError) as error:
            refused += 1
            assert "\n" not in str(error) and path.name in str(error), error
        else:
            assert finite(found), path.read_bytes()[:400]
    assert refused > _TIMES / 4


# ---------------------------------------------------------------- broken off

#: Those that are written by our writers alone.
OURS = ("network", "robot", "hardware", "facts", "checkpoint", "recording.csv", "recording.toml")
WRITERS = {
    **{kind: KINDS[kind] for kind in OURS},
    "plot": ("plot.png", plot, read_picture),
    "video": ("video.gif", video, read_picture),
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
@pytest.mark.parametrize(("name", "write", "read"), WRITERS.values(), ids=WRITERS)
def test_a_kill_loses_nothing(name, write, read, tmp_path):
    path = tmp_path / name
    write(path)
    began = time.perf_counter()
    write(path)
    took = time.perf_counter() - began
    rng = np.random.default_rng(0)

    def again():
        while True:
            write(path)

    for _ in range(_BROKEN_OFF):
        child = in_a_child(again)
        time.sleep(rng.uniform(0.0, 3 * took))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        read(path)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "write", "read"), WRITERS.values(), ids=WRITERS)
def test_a_full_disk_loses_nothing(name, write, read, tmp_path):
    path = tmp_path / name
    write(path)
    size, rng = path.stat().st_size, np.random.default_rng(0)

    def once():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        room = int(rng.uniform(0, size))
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # the traceback of the child
        write(path)

    for _ in range(_BROKEN_OFF):
        rng.uniform()
        os.waitpid(in_a_child(once), 0)
        read(path)
        assert path.stat().st_size == size
        assert len([each for each in tmp_path.iterdir() if each.name.startswith(".")]) == 0
