"""The judge of the contact study is judged, and what it reads is drawn."""

import numpy as np
import pytest
from rich.console import Console

from softrobot_env.benchmarks.contacts import judge as judging
from softrobot_env.benchmarks.contacts.cases import CASES
from softrobot_env.benchmarks.contacts.exact import check
from softrobot_env.benchmarks.contacts.judge import Run, judged
from softrobot_env.benchmarks.contacts.plots import plot
from softrobot_env.benchmarks.contacts.tables import tables
from softrobot_env.benchmarks.verdicts import Verdict

HERE = Run(1e-3, np.zeros((3, 1, 3)))


@pytest.mark.parametrize(
    ("own", "error", "known", "verdict"),
    [
        (HERE, 0.005, 1e-5, Verdict.ACCURATE),
        (HERE, 0.03, 1e-5, Verdict.INACCURATE),
        (HERE, 0.3, 1e-5, Verdict.WRONG),
        (HERE, float("nan"), 1e-5, Verdict.WRONG),
        (Run(1e-3, HERE.places, warning="long"), 0.3, 1e-5, Verdict.WARNED),
        (Run(1e-3, why="diverged"), None, 1e-5, Verdict.REPORTED),
        (HERE, 0.005, 0.004, Verdict.UNJUDGED),
        (HERE, None, None, Verdict.UNJUDGED),
    ],
)
def test_verdicts_say_how_a_run_ended(own, error, known, verdict):
    assert judging._verdict(own, error, known, 1.0) == verdict
    assert verdict in Verdict


@pytest.mark.slow
def test_a_rule_that_is_not_kept_is_found_out(monkeypatch):
    """Many times the rule's timestep is far off, and not warned of it would be wrong."""
    monkeypatch.setattr(judging, "_REFINED", (2, 4))
    (cell,) = judged("arm sweeps into post", 1.0, 0.0, (64,))
    assert cell.verdict == Verdict.WARNED and cell.error_share > 0.05
    silent = Run(cell.timestep, HERE.places)
    assert judging._verdict(silent, cell.error, cell.uncertainty, 0.5) == Verdict.WRONG


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_every_case_touches_what_it_shall(name):
    case = CASES[name]()
    with np.errstate(all="raise"):
        run = judging._run(case, case.build(1e5, 0.3))
    assert run.places is not None and run.most_touches


def test_cells_and_checks_are_shown_and_drawn(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(judging, "_REFINED", (1, 2))
    rows = [*judged("arm pushes ball", 1.0, 0.0, (1,)), *check("rod on post", 6, repeats=1)]
    page = Console(record=True, width=110)
    page.print(tables(rows))
    assert "arm pushes ball" in page.export_text()
    plot(rows, tmp_path / "contacts.png")
    assert (tmp_path / "contacts.png").stat().st_size > 1000
    assert all(set(row.row()) for row in rows)
