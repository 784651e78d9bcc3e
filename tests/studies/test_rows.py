"""Records say what of them is written."""

from dataclasses import dataclass

import numpy as np

from studies.lab import Record, for_pictures, groups, select


@dataclass(frozen=True)
class Run(Record):
    case: str
    error: float | None = None
    trace: np.ndarray | None = for_pictures()


def test_a_record_writes_all_but_what_is_drawn():
    assert Run("a", None, np.zeros(3)).row() == {"case": "a", "error": None}


def test_records_are_selected_and_grouped_by_their_fields():
    runs = [Run("b", 1.0), Run("a", 1.0), Run("b", 2.0)]
    assert select(runs, case="b", error=2.0) == [runs[2]]
    assert groups(runs, "case") == {("b",): [runs[0], runs[2]], ("a",): [runs[1]]}
