"""Pictures of a study are drawn of its files alone, and files that are damaged are refused."""

import gzip
import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from softrobot_env.cli import main
from softrobot_env.core.artifacts import read_tree, write_tree
from softrobot_env.core.runs import Record, for_pictures
from softrobot_env.core.studies import BENCHMARKS
from softrobot_env.evaluation import stored
from softrobot_env.evaluation.rollout import Rollout
from studies.lab import Study, groups, select

RESULTS = Path(__file__).resolve().parents[2] / "docs" / "results"


@dataclass(frozen=True)
class Run(Record):
    case: str
    error: float | None
    sizes: tuple[int, ...] = ()
    trace: Rollout | None = for_pictures()  # noqa: RUF009


@dataclass(frozen=True)
class Other(Record):
    what: str
    value: float


@dataclass(frozen=True)
class Further(Run):
    ratio: float = 1.0


def rollout() -> Rollout:
    time = np.linspace(0, 1, 50)
    tip = np.stack([np.sin(9 * time), 0 * time, time], axis=1) / 3
    few = {name: np.zeros((50, 2)) for name in ("action", "tendon_tension", "tendon_length")}
    decisions = {"policy_time": np.ones(49), "policy_status": np.full(49, "late")}
    return Rollout(
        time, tip, tip + 1e-3, curvature=tip, reward=time, wall_time=1, **few, **decisions
    )


KINDS = (Run, Other)


def test_a_record_writes_all_but_what_is_for_pictures():
    assert Run("a", None, trace=rollout()).row() == {"case": "a", "error": None, "sizes": ()}


def test_records_are_selected_and_grouped_by_their_fields():
    runs = [Run("b", 1.0), Run("a", 1.0), Run("b", 2.0)]
    assert select(runs, case="b", error=2.0) == [runs[2]]
    assert groups(runs, "case") == {("b",): [runs[0], runs[2]], ("a",): [runs[1]]}


def run(quick: bool, progress=None) -> list[Run | Other]:
    trace = rollout().slim("action")
    return [Run("a", 1e-3, (1, 2), trace), Other("b", 2.0), Further("c", None, ratio=0.5)]


def plot(records):
    from softrobot_env.rendering.figures import new_figure

    figure, ((axis,),) = new_figure(1, 1, (3, 2))
    trace = records[0].trace
    axis.plot(trace.time, trace.error)
    axis.plot(trace.tip)
    return figure


@pytest.fixture
def study(monkeypatch):
    """A study of seconds in the place of another."""
    benchmark = Study(KINDS, stages=lambda lab: run(lab.quick), plots={"{}": plot})
    monkeypatch.setitem(BENCHMARKS.registered(), "laws", lambda: benchmark)


def refused(words, capsys) -> str:
    assert main([str(word) for word in words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_redrawn_tables_and_pictures_are_the_same_byte_by_byte(study, tmp_path):
    pytest.importorskip("matplotlib")
    given = ["benchmark", "laws", "--out", str(tmp_path)]
    assert main(given) == 0
    made = [tmp_path / "laws" / name for name in ("laws.png", "report.md")]
    before, listed = [p.read_bytes() for p in made], (tmp_path / "laws" / ".written").read_text()
    assert "drawn.npz" in listed
    for path in made:
        path.unlink()
    report = (tmp_path / "laws" / "report.json").read_bytes()
    assert main([*given, "--redraw"]) == 0
    assert [path.read_bytes() for path in made] == before
    assert (tmp_path / "laws" / "report.json").read_bytes() == report
    assert (tmp_path / "laws" / ".written").read_text() == listed


def test_records_come_back_as_they_were(tmp_path):
    made = run(True)
    stored.write(tmp_path, made, "softrobot benchmark")
    found = stored.read(tmp_path, KINDS)
    assert [type(record) for record in found] == [Run, Other, Further]
    assert [record.row() for record in found] == [record.row() for record in made]
    assert found[0].sizes == (1, 2)
    trace = found[0].trace
    np.testing.assert_allclose(trace.tip, made[0].trace.tip, atol=1e-7)
    assert trace.action.shape == (50, 2) and trace.curvature.shape == (50, 0)
    assert found[2].trace is None


def test_a_tree_comes_back_with_equal_arrays_once(tmp_path):
    one = np.linspace(0, 1, 1000)
    tree = {
        1: [one, (one.copy(), None, "a")],
        "b": {"c": np.arange(3), "d": True, "e": np.float64(2)},
    }
    write_tree(tmp_path / "a.npz", tree)
    found = read_tree(tmp_path / "a.npz")
    assert isinstance(found[1][1], tuple) and found[1][1][1:] == (None, "a")
    np.testing.assert_array_equal(found[1][0], one.astype(np.float32))
    assert (
        found["b"]["c"].tolist() == [0, 1, 2] and found["b"]["d"] is True and found["b"]["e"] == 2
    )
    assert len(np.load(tmp_path / "a.npz").files) == 3
    with pytest.raises(TypeError, match="object"):
        write_tree(tmp_path / "a.npz", [object()])


def changed(path, **others):
    path.write_text(json.dumps(json.loads(path.read_text()) | others))


def with_value(path, value):
    first, second, *rest = json.loads(path.read_text())["rows"]
    changed(path, rows=[first, second | {"value": value}, *rest])


def packed(path):
    path.with_name("report.json.gz").write_bytes(gzip.compress(path.read_bytes())[:50])
    path.unlink()


#: What a damaged or foreign report is called, and what is done to its file.
DAMAGED = {
    "cut": ("report.json is no report, or damaged", lambda p: p.write_text(p.read_text()[:-40])),
    "rows": ("report.json is no report, or damaged", lambda p: changed(p, rows=[])),
    "foreign": (
        "row 1 is none of this benchmark",
        lambda p: shutil.copy(RESULTS / "sections" / "report.json", p),
    ),
    "type": ("row 2 is damaged: 'much' is no float", lambda p: with_value(p, "much")),
    "other": ("drawn.npz belongs to another report", lambda p: with_value(p, 3.0)),
    "packed": ("report.json.gz is no report, or damaged", packed),
    "drawn": (
        "drawn.npz is no npz file of arrays, or damaged",
        lambda p: p.with_name("drawn.npz").write_bytes(b"PK"),
    ),
    "arrays": (
        "drawn.npz is not what pictures need",
        lambda p: write_tree(p.with_name("drawn.npz"), [1, 2]),
    ),
    "none": ("report.json: there is no such report", lambda p: p.unlink()),
}


@pytest.mark.parametrize(("reported", "damage"), DAMAGED.values(), ids=DAMAGED)
def test_damaged_and_foreign_files_are_refused_in_a_line(reported, damage, study, tmp_path, capsys):
    stored.write(tmp_path / "laws", run(True), "softrobot benchmark laws")
    damage(tmp_path / "laws" / "report.json")
    assert reported in refused(["benchmark", "laws", "--out", tmp_path, "--redraw"], capsys)


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (["laws", "--quick"], "--quick measures anew, --redraw measures nothing"),
        (["scenes", "--count", "3"], "--count measures anew"),
    ],
)
def test_what_measures_does_not_redraw(words, reported, tmp_path, capsys):
    assert reported in refused(["benchmark", *words, "--redraw", "--out", tmp_path], capsys)
