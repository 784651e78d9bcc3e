"""Files of every kind: damaged ones, and what a kill or a full disk leaves of those that we write.

What is cut, overwritten or edited badly is refused in a line, or read with finite content
(`scripts/fuzz.py`). A write that is broken off leaves the file before it whole.
"""

import os
import resource
import signal
import time
from errno import ENOSPC

import numpy as np
import pytest

from fuzz import KINDS, Kind, run

_BROKEN_OFF = 100

#: Where a file of a kind cannot be written without.
_NEEDS = {"recording.parquet": "pyarrow", "frames": "cobs"}


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


ALL = {**KINDS, "checkpoint": Kind("checkpoint.pt", checkpoint, read_checkpoint)}


@pytest.mark.parametrize("times", [30, pytest.param(500, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ALL)
def test_damage_is_refused_in_a_line_or_leaves_finite_content(name, times, tmp_path):
    pytest.importorskip(_NEEDS.get(name, "numpy"))
    refused, faults = run(ALL[name], tmp_path, times)
    assert not faults, [(fault.case, fault.what) for fault in faults]
    # A line drops frames with a wrong checksum, as it should.
    assert refused > times / 4 or name == "frames"


def test_what_a_reader_lets_through_is_found(tmp_path):
    """NaN, an error of another kind, one without the file's name, and what does not end."""

    def fails(path):
        data = path.read_bytes()
        if data == b"sound":
            return 0.0
        what = len(data) % 4
        if what == 0:
            return np.nan
        if what == 1:
            raise KeyError(path.name)
        if what == 2:
            raise ValueError("of no file")
        return time.sleep(30)

    cut = Kind(
        "a.txt", lambda path: path.write_bytes(b"sound"), fails, (lambda *_: b"x" * next(n),)
    )
    n = iter([0, 1, 2, 3])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fuzz.LONGEST", 0.02)
        refused, faults = run(cut, tmp_path, 4)
    assert refused == 1 and [fault.case for fault in faults] == [0, 1, 2, 3]
    for fault, said in zip(faults, ("NaN", "KeyError", "without its file", "longer"), strict=True):
        assert said in fault.what


# ---------------------------------------------------------------- broken off

#: Those that are written by our writers alone.
OURS = ("network", "robot", "hardware", "facts", "checkpoint", "recording.csv", "recording.toml")
WRITERS = {
    **{kind: ALL[kind] for kind in OURS},
    "plot": Kind("plot.png", plot, read_picture),
    "video": Kind("video.gif", video, read_picture),
}
#: Those that take too long to be killed a hundred times.
MORE = {kind: ALL[kind] for kind in ("rollout", "residual", "recording.parquet")}


@pytest.mark.parametrize("kind", {**WRITERS, **MORE}.values(), ids={**WRITERS, **MORE})
def test_what_does_not_reach_the_disk_leaves_what_was_there(kind, tmp_path, monkeypatch):
    path = tmp_path / kind.file
    kind.write(path)
    before = path.stat()

    def full(_):
        raise OSError(ENOSPC, os.strerror(ENOSPC))

    monkeypatch.setattr("softrobot_env.core.files._flush", full)
    with pytest.raises(OSError, match=os.strerror(ENOSPC)):
        kind.write(path)
    kind.read(path)
    if kind is not ALL["checkpoint"]:  # the one before the newest has a file of its own
        assert (path.stat().st_ino, path.stat().st_mtime_ns) == (before.st_ino, before.st_mtime_ns)
    assert not [each for each in tmp_path.iterdir() if each.name.startswith(".")]


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
@pytest.mark.parametrize("kind", WRITERS.values(), ids=WRITERS)
def test_a_kill_loses_nothing(kind, tmp_path):
    path, write, read = tmp_path / kind.file, kind.write, kind.read
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
@pytest.mark.parametrize("kind", WRITERS.values(), ids=WRITERS)
def test_a_full_disk_loses_nothing(kind, tmp_path):
    path, write, read = tmp_path / kind.file, kind.write, kind.read
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
