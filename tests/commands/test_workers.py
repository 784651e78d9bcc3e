"""Evaluations with --workers: the rows of one process, also where they were stopped in between."""

import json

import pytest

from softrobot_env.cli import main
from softrobot_env.core import runs
from softrobot_env.core.runs import KEPT

#: What depends on the machine.
TIMES = {"policy_time_median", "policy_time_p99", "realtime_factor"}

CALL = (
    "evaluate --tasks step swing --step-widths 0.05 --policies feedforward lqi --duration 0.5 "
    "--no-plots --out"
)


def rows(folder):
    found = json.loads((folder / "report.json").read_text())["rows"]
    return [{name: row[name] for name in row.keys() - TIMES} for row in found]


@pytest.mark.slow
def test_rows_of_several_processes_are_those_of_one(tmp_path, monkeypatch, capsys):
    alone, shared = tmp_path / "alone", tmp_path / "shared"
    assert main([*CALL.split(), str(alone)]) == 0

    packed, arriving = [], runs._arriving

    def two_then_ctrl_c(*args):
        for found in arriving(*args):
            packed.append(found)
            yield found
            if len(packed) == 2:
                raise KeyboardInterrupt

    monkeypatch.setattr(runs, "_arriving", two_then_ctrl_c)
    assert main([*CALL.split(), str(shared), "--workers", "1"]) == 130
    assert len((shared / KEPT).read_text().splitlines()) == 1 + 2
    monkeypatch.setattr(runs, "_arriving", arriving)
    capsys.readouterr()
    assert main([*CALL.split(), str(shared), "--workers", "1"]) == 0
    assert "Took up 2 episodes" in capsys.readouterr().out
    assert rows(shared) == rows(alone)
    assert not (shared / KEPT).exists()


def test_robots_over_a_line_are_not_shared(tmp_path, capsys):
    call = "evaluate --tasks triangle --env virtual --workers 2 --out"
    assert main([*call.split(), str(tmp_path)]) == 2
    assert "--workers: only with --env sim" in capsys.readouterr().err


def test_benchmarks_that_measure_times_refuse_workers(tmp_path, capsys):
    assert main(["benchmark", "speed", "--workers", "2", "--out", str(tmp_path)]) == 2
    assert "runs one job after the other" in capsys.readouterr().err
