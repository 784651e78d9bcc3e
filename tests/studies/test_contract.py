"""What every study is held to: its committed report is read and drawn, it runs quickly."""

import ast
import json
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from softrobot_env.cli import main
from softrobot_env.core import registry, runs
from softrobot_env.core.runs import packed, unpacked
from softrobot_env.core.studies import BENCHMARKS, measured
from softrobot_env.evaluation import stored

ROOT = Path(__file__).resolve().parents[2]
RESULTS, STUDIES = ROOT / "docs" / "results", ROOT / "scripts" / "studies"

#: Extra package that a study cannot do without.
NEEDS = dict.fromkeys(("learning", "ppo_defaults"), "stable_baselines3") | {"tips": "cv2"}


@pytest.mark.parametrize("name", [name for name in BENCHMARKS if name != "speed"])
def test_the_committed_report_is_read_and_shown(name):
    """Its rows are those of the study today, tables can be made, and pictures have what they need.

    That of speed is of several runs on several machines.
    """
    study, folder = BENCHMARKS[name](), RESULTS / name
    assert measured(name) and set(study.options) <= {"count", "seed"}
    records = stored.read(folder, study.kinds)
    firsts = {type(record): record for record in reversed(records)}.values()
    kept = json.loads(json.dumps([packed(record) for record in firsts], default=runs._plain))
    assert [unpacked(one, study.kinds).row() for one in kept] == [r.row() for r in firsts]
    rows = stored._rows(next(folder.glob("report.json*")))
    assert [json.loads(json.dumps(record.row())) for record in records] == rows
    needed = any(set(vars(record)) - set(record.written()) for record in records)
    assert needed == any(record.shown() for record in records)
    page = Console(record=True, width=110, file=StringIO())
    page.print(study.show(records))
    assert len(page.export_text().splitlines()) > 10


@pytest.mark.slow
@pytest.mark.parametrize("name", BENCHMARKS)
def test_the_pictures_of_the_committed_report_are_drawn(name, tmp_path):
    pytest.importorskip("matplotlib")
    study, folder = BENCHMARKS[name](), RESULTS / name
    if study.draw is not None:
        study.draw(stored.read(folder, study.kinds), tmp_path / f"{name}.png")
    drawn = {path.name for path in tmp_path.iterdir()}
    assert drawn == {path.name for path in folder.glob("*.png")}


# Policies that learn drive a robot at random: that its motion may be off is reported, no fault.
@pytest.mark.filterwarnings("default::softrobot_env.scene.timestep.TimestepWarning")
@pytest.mark.slow
@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_quick_run_measures_writes_and_draws(name, tmp_path, monkeypatch, capsys):
    pytest.importorskip("matplotlib")
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    monkeypatch.chdir(tmp_path)  # some keep finished trainings below the working directory
    assert main(["benchmark", name, "--quick", "--out", str(tmp_path / "out")]) == 0
    out = tmp_path / "out" / name
    rows = json.loads((out / "report.json").read_text())["rows"]
    assert rows and all(isinstance(row, dict) for row in rows)
    text = (out / "report.md").read_text()
    assert text.startswith(f"# Benchmark: {name}") and len(text.splitlines()) > 10
    assert "\u2026" not in text  # nothing is cut short
    drawn = BENCHMARKS[name]().draw is not None
    pictures = list(out.glob("*.png"))
    assert bool(pictures) == drawn and all(path.stat().st_size > 1000 for path in pictures)
    assert f"to {out}" in capsys.readouterr().out.replace("\n", "")
    if drawn:
        before = {path: path.read_bytes() for path in pictures}
        assert main(["benchmark", name, "--redraw", "--out", str(tmp_path / "out")]) == 0
        assert {path: path.read_bytes() for path in out.glob("*.png")} == before


@pytest.mark.parametrize("path", sorted(STUDIES.rglob("*.py")), ids=lambda path: path.stem)
def test_no_constant_of_a_study_is_set_twice(path):
    """The later value would hold in functions above it, too."""
    body = ast.parse(path.read_text()).body
    targets = [target for node in body if isinstance(node, ast.Assign) for target in node.targets]
    names = [n.id for target in targets for n in ast.walk(target) if type(n) is ast.Name]
    assert sorted(set(names)) == sorted(names)


def test_the_wheel_alone_says_where_studies_are(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(registry, "_entry_points", lambda *_: [])
    monkeypatch.setattr(registry, "_called", set())
    monkeypatch.setattr(BENCHMARKS, "_own", {})
    assert main(["benchmark", "controllers", "--out", str(tmp_path)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "'controllers'" in line and "scripts/studies of its repository" in line
