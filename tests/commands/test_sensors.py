"""`--feedback sensors`: calibration, evaluation by it, and what is refused."""

import json
from dataclasses import replace

import pytest

from softrobot_env.cli import main
from softrobot_env.robots import ROBOTS, Sensor, write_robot


@pytest.fixture
def finger(tmp_path):
    """The file of a finger with tags on both of its pieces."""
    robot = ROBOTS["planar_finger"]
    half = robot.length / 2
    tags = (Sensor("a", "tags", 0.0, half, 1), Sensor("b", "tags", half, robot.length, 1))
    write_robot(replace(robot, name="felt", sensors=tags), tmp_path / "felt.toml")
    return tmp_path / "felt.toml"


def evaluate(out, *words):
    return main(["evaluate", *map(str, words), "--no-plots", "--out", str(out)])


def test_the_rig_is_driven_by_its_sensor_alone(tmp_path):
    words = ["--tasks", "triangle", "--policies", "rig_nn_pi", "--feedback", "sensors"]
    assert evaluate(tmp_path, *words, "--duration", "2") == 0
    (row,) = json.loads((tmp_path / "report.json").read_text())["rows"]
    assert row["feedback"] == "sensors" and row["failure"] is None


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ("--tasks triangle --policies rig_nn_pi --twin 3", "--twin 3 --out DIR` and give it by"),
        ("--tasks swing --policies lqi", "robot 'arm' carries none; give it [[sensor]] tables"),
        ("--tasks triangle --policies rig_nn_pi --sensors no.npz", "No such file"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(words, reason, tmp_path, capsys):
    assert evaluate(tmp_path, *words.split(), "--feedback", "sensors") == 2
    told = capsys.readouterr().err
    assert reason in told and told.count("\n") == 1


def test_a_calibration_alone_is_refused(tmp_path, capsys):
    words = "--tasks triangle --policies rig_nn_pi --sensors a.npz"
    assert evaluate(tmp_path, *words.split()) == 2
    assert "--sensors: only with --feedback sensors" in capsys.readouterr().err


@pytest.mark.slow
def test_any_robot_is_calibrated_and_driven_by_its_sensors(finger, tmp_path, capsys):
    words = ["--robot", finger, "--tasks", "circle", "--policies", "chain_dynamics_pi"]
    words += ["--feedback", "sensors"]
    assert evaluate(tmp_path / "out", *words) == 2
    assert f"softrobot train sensors --robot {finger}" in capsys.readouterr().err
    assert main(["train", "sensors", "--robot", str(finger), "--quick"]) == 0
    assert (finger.parent / "felt.sensors.npz").is_file()
    assert evaluate(tmp_path / "out", *words) == 0
    (row,) = json.loads((tmp_path / "out" / "report.json").read_text())["rows"]
    assert row["failure"] is None and row["e_mean"] < 1e-3


@pytest.mark.slow
def test_sensors_that_tell_no_side_are_refused(finger, capsys):
    robot = ROBOTS["planar_finger"]
    planar = (Sensor("a", "planar", 0.0, robot.length),)
    write_robot(replace(robot, name="felt", sensors=planar), finger)
    assert main(["train", "sensors", "--robot", str(finger), "--quick"]) == 2
    assert "do not tell where its tip is" in capsys.readouterr().err
