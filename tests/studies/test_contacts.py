"""The judge of the contact study is judged."""

import numpy as np
import pytest

from softrobot_env.evaluation.models.runs import Verdict
from studies import contacts
from studies.contacts import CASES, Run, judged

HERE = Run(np.zeros((3, 1, 3)))


@pytest.mark.parametrize(
    ("own", "error", "known", "verdict"),
    [
        (HERE, 0.005, 1e-5, Verdict.ACCURATE),
        (HERE, 0.03, 1e-5, Verdict.INACCURATE),
        (HERE, 0.3, 1e-5, Verdict.WRONG),
        (HERE, float("nan"), 1e-5, Verdict.WRONG),
        (Run(HERE.places, warning="long"), 0.3, 1e-5, Verdict.WARNED),
        (Run(why="diverged"), None, 1e-5, Verdict.REPORTED),
        (HERE, 0.005, 0.004, Verdict.UNJUDGED),
        (HERE, None, None, Verdict.UNJUDGED),
    ],
)
def test_verdicts_say_how_a_run_ended(own, error, known, verdict):
    assert contacts._verdict(own, error, known, 1.0) == verdict


@pytest.mark.slow
def test_a_rule_that_is_not_kept_is_found_out(monkeypatch):
    """Many times the rule's timestep is far off, and not warned of it would be wrong."""
    monkeypatch.setattr(contacts, "_REFINED", (2, 4))
    (cell,) = judged("arm sweeps into post", 1.0, 0.0, (64,))
    assert cell.verdict == Verdict.WARNED and cell.error_share > 0.05
    assert contacts._verdict(Run(HERE.places), cell.error, cell.uncertainty, 0.5) == Verdict.WRONG


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_every_case_touches_what_it_shall(name):
    case = CASES[name]()
    with np.errstate(all="raise"):
        run = contacts._run(case, case.build(1e5, 0.3))
    assert run.places is not None and run.most_touches
