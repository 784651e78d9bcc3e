"""`softrobot evaluate --env virtual|real` and `softrobot robot soak`."""

import json

import pytest

from softrobot_env.cli import main
from softrobot_env.hardware.recording import read_recording

pytest.importorskip("serial", reason="needs the robot extra")
pytest.importorskip("cobs", reason="needs the robot extra")


def test_a_policy_runs_on_a_virtual_robot(tmp_path, capsys):
    out, record = tmp_path / "out", tmp_path / "links"
    command = "evaluate --tasks reach --option hold=0.2 --option radius=0.03 --policies hybrid"
    status = main(
        [*command.split(), "--env", "virtual", "--out", f"{out}", "--record", f"{record}"]
    )
    (row,) = json.loads((out / "report.json").read_text())["rows"]
    assert (row["source"], row["plant"], row["twin"]) == ("real", "virtual", 0)
    assert status == int(row["failure"] is not None)
    assert "virtual twin 0" in capsys.readouterr().out
    # The episode, and the short one before it that warms up.
    links = [read_recording(path) for path in sorted(record.iterdir())]
    assert links and all(link.complete for link in links)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("--tasks swing --env virtual", "only with tasks of the rig"),
        ("--tasks reach --env real --twin 1", "--twin"),
        ("--tasks reach --env virtual --twin none", "--twin none"),
        ("--tasks reach --env virtual --port /dev/ttyUSB0", "--port"),
        ("--tasks reach --port /dev/ttyUSB0", "--port"),
        ("--tasks reach --record links", "--record"),
    ],
)
def test_what_does_not_fit_is_refused(arguments, said, tmp_path, capsys):
    assert main(["evaluate", *arguments.split(), "--out", str(tmp_path)]) == 2
    assert said in capsys.readouterr().err


def test_no_robot_at_the_port(tmp_path, capsys):
    command = "evaluate --tasks reach --policies hybrid --env real --port /dev/no_robot"
    assert main([*command.split(), "--no-plots", "--out", str(tmp_path)]) == 1
    assert "/dev/no_robot" in capsys.readouterr().out.replace("\n", "")


def test_a_short_soak_says_what_it_measured(tmp_path):
    status = main(["robot", "soak", "--seconds", "3", "--out", str(tmp_path)])
    row, *promises = json.loads((tmp_path / "report.json").read_text())["rows"]
    assert row["steps"] == 150 and row["ticks"] > 1000
    assert row["unsafe_outputs"] == 0
    assert status == int(not all(promise["met"] for promise in promises))
