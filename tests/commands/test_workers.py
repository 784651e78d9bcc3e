"""Evaluations with --workers and studies: their rows, also where they were stopped in between."""

from dataclasses import dataclass
from functools import partial

import pytest
from support.commands import TIMES, called, rows_in, stopped_after

from softrobot_env.core.runs import KEPT, Row
from softrobot_env.core.studies import BENCHMARKS

CALL = (
    "evaluate --tasks step swing --step-widths 0.05 --policies feedforward lqi --duration 0.5 "
    "--no-plots --out"
)


@pytest.mark.slow
def test_rows_of_several_processes_are_those_of_one(tmp_path, capsys):
    alone, shared = tmp_path / "alone", tmp_path / "shared"
    assert called(CALL, alone) == 0
    stopped_after(2, CALL, shared, "--workers 1")
    assert len((shared / KEPT).read_text().splitlines()) == 1 + 2
    capsys.readouterr()
    assert called(CALL, shared, "--workers 1") == 0
    assert "Took up 2 episodes" in capsys.readouterr().out
    assert rows_in(shared, TIMES) == rows_in(alone, TIMES)
    assert not (shared / KEPT).exists()


@dataclass(frozen=True)
class Square(Row):
    number: int
    square: float


def measured(folder, case):
    if case["number"] == 2 and (folder / "stop").exists():
        raise ValueError("the third case fails")
    return Square(case["number"], float(case["number"] ** 2))


def test_a_study_that_was_stopped_goes_on(tmp_path, monkeypatch, capsys):
    from studies.lab import Study, grid, table

    study = Study(
        kinds=(Square,),
        cases=grid(number=range(4)),
        measure=partial(measured, tmp_path),
        tables=[table("Squares", "number", "square")],
        alone=True,
    )
    monkeypatch.setattr(BENCHMARKS, "_own", {**BENCHMARKS._own, "squares": lambda: study})
    (tmp_path / "stop").touch()
    call = ("benchmark squares --out", tmp_path)
    assert called(*call) == 2
    assert len((tmp_path / "squares" / KEPT).read_text().splitlines()) == 1 + 2
    (tmp_path / "stop").unlink()
    assert called(*call) == 0
    assert "Took up 2 cases" in capsys.readouterr().out
    assert [row["square"] for row in rows_in(tmp_path / "squares")] == [0, 1, 4, 9]
    assert not (tmp_path / "squares" / KEPT).exists()
