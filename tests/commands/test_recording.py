"""Recordings on the command line: recorded, checked, replayed, and what is refused."""

import json
from importlib.util import find_spec

import numpy as np
import pytest
from support.commands import called, evaluated, rows_in
from support.recorded_rods import real_recording

from softrobot_env.core.files import assets_dir
from softrobot_env.recordings import read_header, read_recording, write_header
from softrobot_env.robots import ROBOTS, write_robot

FINGER = "robot record --robot planar_finger --kinds pulls --levels 1 --rest 0.3"


@pytest.fixture
def pulls(tmp_path, capsys):
    """A recording of a finger whose tendons are pulled in turn."""
    path = tmp_path / "pulls.csv"
    assert called(FINGER, "--static --out", path) == 0
    said = capsys.readouterr().out
    assert "up to 0.5, 0.5, 0.5, 0.5 of full scale" in said and "Wrote 8 rows" in said
    return path


def test_a_robot_is_recorded_checked_and_replayed(pulls, tmp_path, capsys):
    assert called("recording check", pulls, "--robot planar_finger") == 0
    said = capsys.readouterr().out
    assert "at rest in every row" in said and "pull_input1+ (2)" in said and "Look" not in said
    out = tmp_path / "out"
    plots = "" if find_spec("matplotlib") else "--no-plots"
    assert called("recording replay", pulls, "--robot planar_finger", plots, "--out", out) == 0
    whole, *patterns = rows_in(out)
    assert (whole["pattern"], whole["rows"], whole["failed"]) == ("all", 8, 0)
    assert [row["pattern"] for row in patterns] == [f"pull_input{k}{s}" for k in "12" for s in "+-"]
    # It was at rest when it was recorded, and the same chain is at rest in the replay.
    assert 0 <= whole["mean"] <= whole["rms"] <= whole["max"] < 1e-4
    assert "pull_input1+" in (out / "report.md").read_text()
    if not plots:
        names = {path.name for path in out.glob("*.png")}
        assert names == {f"replay_{name}.png" for name in ("error", "markers", "patterns")}


def test_noise_is_that_of_seed_0_unless_another_is_given(tmp_path):
    words = "robot record --kinds pulls --levels 1 --rest 0.1"
    seeds = {"a": "", "b": "--seed 0", "c": "--seed 1"}
    for name, seed in seeds.items():
        assert called(words, seed, "--out", tmp_path / f"{name}.csv") == 0
    first, same, other = (read_recording(tmp_path / f"{name}.csv").markers for name in seeds)
    np.testing.assert_array_equal(first, same)
    assert not np.array_equal(first, other)


def test_the_header_beside_an_identified_robot_counts(pulls, tmp_path, capsys):
    """What an identification writes is enough to replay another table of the same columns."""
    found = tmp_path / "found"
    found.mkdir()
    write_robot(ROBOTS["planar_finger"], found / "robot.toml")
    write_header(read_header(pulls.with_suffix(".toml")), found / "recording.toml")
    pulls.with_suffix(".toml").unlink()
    replay = ("recording replay", pulls, "--no-plots --out", tmp_path, "--robot")
    assert called(*replay, "planar_finger") == 2
    assert "has no header" in capsys.readouterr().err
    assert called(*replay, found / "robot.toml") == 0
    assert "Header: " in (said := capsys.readouterr().out) and "recording.toml" in said


def test_what_is_evaluated_is_recorded(tmp_path):
    words = "--tasks swing --policies hold lqi --duration 0.1 --no-plots --record"
    evaluated(tmp_path, words, tmp_path / "rec")
    names = {path.name for path in (tmp_path / "rec").iterdir()}
    assert names == {f"swing_{name}.{end}" for name in ("hold", "lqi") for end in ("csv", "toml")}
    recording = read_recording(tmp_path / "rec" / "swing_hold.csv")
    assert len(recording.times) == 11 and recording.kind == "tension"


@pytest.mark.slow
@pytest.mark.realtime(late=0.9)
def test_a_virtual_robot_is_recorded_over_its_serial_line(tmp_path):
    """Its twin, replayed without the serial line and the clock, errs by the camera's noise."""
    pytest.importorskip("serial", reason="needs the robot extra")
    from support.patience import patient_commands

    path = tmp_path / "virtual.csv"
    words = "robot record --env virtual --twin 3 --levels 1 --rest 0.3 --duration 3 --out"
    with patient_commands():
        assert called(words, path) == 0
    words = "--robot rig --twin 3 --no-plots --out"
    assert called("recording replay", path, words, tmp_path) == 0
    whole, *_ = rows_in(tmp_path)
    # 0.3 mm in each of x and y, of which the tip filter takes some; the rest is the clock's.
    assert whole["rms"] < 1.5 * 2**0.5 * 0.3e-3


@pytest.mark.slow
def test_a_long_static_recording_is_replayed_in_seconds(tmp_path):
    path = real_recording("ftdcr_v4/train.csv")
    header = tmp_path / "h.toml"
    names = json.dumps([tendon.name for tendon in ROBOTS["ftdcr_v4"].tendons])
    text = (assets_dir() / "recordings" / "ftdcr_v4.toml").read_text()
    header.write_text(text.replace("[commands]\n", f"[commands]\ntendons = {names}\n"))
    words = ("--robot ftdcr_v4 --no-plots --header", header, "--out", tmp_path)
    assert called("recording replay", path, *words) == 0
    whole, *_ = rows_in(tmp_path)
    assert (whole["rows"], whole["failed"]) == (1620, 0)
    assert whole["cpu_time"] < 30  # some 5 s on an idle core; busy ones share their caches
