"""What commands write: nothing of an earlier run is lost, mixed up or written by two at once."""

import re
from pathlib import Path
from subprocess import PIPE

import pytest
from support.commands import rows_in
from support.processes import python

from softrobot_env.cli import main
from softrobot_env.commands.output import claimed, new_results, progress_on, say
from softrobot_env.core.files import models_dir
from softrobot_env.rendering.tables import Column, make_table
from softrobot_env.robots import ARM, read_robot
from softrobot_env.robots.artifacts import find_artifact, training_folder

_SHORT = "evaluate --tasks lshape --policies hold --control-period 0.2 --duration 0.4 --no-plots"

#: Calls that find what they would write, and the name of it.
_TAKEN = [
    (f"{_SHORT} --out .", "report.json"),
    ("benchmark speed --quick --out .", "speed/report.json"),
    ("export --out .", "arm.xml"),
    ("train qs_nn --quick --out .", "qs_nn.npz"),
    ("inspect --robot planar_finger --workspace --out .", "workspace_planar_finger.png"),
    ("recording replay rec.csv --robot rig --out .", "report.json"),
    ("robot soak --out .", "report.json"),
    ("render --task swing --out a.gif", "a.gif"),
    ("grip --out a.gif", "a.gif"),
]

#: Calls that would write, to what follows, something they take long to compute.
_LONG = [
    ("evaluate --out", ""),
    ("evaluate --out new --record", ""),
    ("benchmark accuracy --quick --out", ""),
    ("train lqi --quick --out", ""),
    ("train ppo --quick --out new --checkpoint", ""),
    ("render --out", "a.gif"),
    ("grip --out", "a.gif"),
    ("robot record --out", "a.csv"),
    ("identify rec.csv --robot rig --out", ""),
    ("recording replay rec.csv --robot rig --out", ""),
    ("export --out", ""),
    ("robot virtual --log", "a.npz"),
]


def refused(words, capsys):
    assert main(words.split()) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.mark.parametrize(("words", "written"), _TAKEN)
def test_earlier_results_are_not_replaced(words, written, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / written
    path.parent.mkdir(exist_ok=True)
    path.write_text("mine")
    assert "--overwrite" in refused(words, capsys)
    assert path.read_text() == "mine"
    assert [found for found in tmp_path.rglob("*") if found.is_file()] == [path]


@pytest.mark.parametrize(("words", "file"), _LONG)
@pytest.mark.parametrize("place", ["file", "file/below", "/dev/full", "closed/below"])
def test_places_that_cannot_be_written_are_refused_at_once(
    words, file, place, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    Path("file").write_text("mine")
    closed = tmp_path / "closed"
    monkeypatch.setattr(  # root may write everywhere
        "softrobot_env.commands.output.os.access", lambda path, _: Path(path).resolve() != closed
    )
    closed.mkdir()
    line = refused(f"{words} {Path(place) / file}", capsys)
    assert ("nothing can be written in closed" if place.startswith("closed") else "folder") in line
    assert Path("file").read_text() == "mine"
    assert not list(closed.iterdir())


@pytest.mark.parametrize("words", ["render --task swing", "grip"])
def test_a_folder_is_not_replaced_by_a_video(words, tmp_path, capsys):
    (tmp_path / "a.gif").mkdir()
    assert "is no file" in refused(f"{words} --overwrite --out {tmp_path}/a.gif", capsys)


def test_overwriting_leaves_nothing_old_and_nothing_of_others(tmp_path):
    given = [*_SHORT.split(), "--out", str(tmp_path)]
    assert main([*given, "--save-rollouts"]) == 0
    (mine := tmp_path / "ppo.npz").write_text("mine")
    assert (tmp_path / "lshape_hold.npz").is_file()
    assert main([*given, "--overwrite", "--vary", "density=2"]) == 0
    assert not (tmp_path / "lshape_hold.npz").exists()
    assert mine.read_text() == "mine"
    (row,) = rows_in(tmp_path)
    assert row["variation"] == {"density": 2.0}


def test_what_fails_before_its_report_leaves_the_earlier_one_whole(tmp_path):
    (tmp_path / "report.json").write_text("old")
    (tmp_path / "a.png").write_text("old")
    (tmp_path / ".written").write_text("report.json\na.png\n")

    with pytest.raises(RuntimeError), new_results(tmp_path, overwrite=True):
        raise RuntimeError
    assert (tmp_path / "report.json").read_text() == (tmp_path / "a.png").read_text() == "old"


_HOLD = """
import sys
from pathlib import Path
from softrobot_env.commands.output import claimed
with claimed(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_two_runs_do_not_write_to_one_folder(tmp_path, capsys):
    with python(_HOLD, str(tmp_path), stdin=PIPE, stdout=PIPE, text=True) as holder:
        assert holder.stdout.readline() == "held\n"
        assert "another run writes to" in refused(f"{_SHORT} --out {tmp_path}", capsys)
    with claimed(tmp_path):  # what was killed holds nothing
        pass


def test_trainings_do_not_touch_what_is_shipped(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shipped = (models_dir() / "qs_nn.npz").read_bytes()
    assert main(["train", "qs_nn", "--quick"]) == 0
    assert "--ship" in capsys.readouterr().out.replace("\n", " ")
    assert (tmp_path / "out" / "qs_nn.npz").is_file()
    assert (models_dir() / "qs_nn.npz").read_bytes() == shipped
    assert find_artifact(ARM, "qs_nn") == models_dir() / "qs_nn.npz"
    assert "--overwrite" in refused("train qs_nn --quick --ship", capsys)


def test_trainings_of_ones_own_robot_go_beside_its_file(tmp_path):
    source = Path(__file__).parents[2] / "assets" / "robots" / "planar_finger.toml"
    assert training_folder(read_robot(source)) == Path("out")
    own = tmp_path / "mine.toml"
    own.write_text(source.read_text())
    assert training_folder(read_robot(own)) == tmp_path


def test_what_is_said_meanwhile_goes_above_the_bar(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_on("work", 2) as show:
        show("half", 1, 2)
        say("reported")
    assert re.search("\x1b\\[2K\n?(\x1b\\[0m)?reported", capsys.readouterr().out)


@pytest.mark.parametrize("columns", [None, "40"])
def test_lines_are_as_long_as_a_table_where_there_is_no_terminal(columns, capsys, monkeypatch):
    if columns is None:
        monkeypatch.delenv("COLUMNS", raising=False)
    else:
        monkeypatch.setenv("COLUMNS", columns)
    names = [f"quantity{k}" for k in range(12)]
    say(make_table("Wide", [Column(name, lambda row: row) for name in names], ["a value"]))
    lines = capsys.readouterr().out.splitlines()
    whole = " ".join(names)
    assert any(" ".join(line.split()) == whole for line in lines) == (columns is None)
    assert max(map(len, lines)) <= (200 if columns is None else int(columns))
