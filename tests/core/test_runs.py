"""Jobs in processes: in order, begun anew where a process is killed, kept where a run stops."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from softrobot_env.core import runs
from softrobot_env.core.processes import Workers, parsed_workers, using
from softrobot_env.core.runs import KEPT, Kept, Row, case_key, for_pictures, kept_rows, run_cases


def mark_and_square(folder, number):
    (folder / f"{number}-{os.getpid()}").touch()
    return number**2


def dies_once(folder, number):
    died = folder / "died"
    if number == 1 and not died.exists():
        died.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def always_dies(number):
    os.kill(os.getpid(), signal.SIGKILL)


def test_results_are_in_the_order_of_the_jobs_and_so_is_progress(tmp_path):
    seen = []
    with using(Workers(2)):
        work = partial(mark_and_square, tmp_path)
        found = run_cases(range(4), work, progress=lambda *reported: seen.append(reported))
    assert found == [0, 1, 4, 9]
    assert [done for _, done, _ in seen] == [0, 1, 2, 3, 4]
    assert len({path.name.split("-")[1] for path in tmp_path.iterdir()}) <= 2


def test_what_a_users_file_defines_can_be_a_job():
    offset = 3
    assert run_cases([1], lambda number: offset + number, processes=1) == [4]


def test_jobs_of_a_killed_process_are_begun_anew(tmp_path):
    assert run_cases(range(4), partial(dies_once, tmp_path), processes=2) == [0, 1, 2, 3]


def test_processes_that_always_end_are_told_of():
    with pytest.raises(RuntimeError, match=r"ended 3 times.*jobs: 0"):
        run_cases([0], always_dies, processes=1)


ORPHANS = """
import os, sys, time
from pathlib import Path
from softrobot_env.core.processes import worker_processes

if __name__ == "__main__":
    with worker_processes(1) as pool:
        Path(sys.argv[1]).write_text(str(pool.submit(os.getpid).result()))
        time.sleep(60)
"""


def lives(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_workers_end_with_a_command_that_is_killed(tmp_path):
    script, reported = tmp_path / "script.py", tmp_path / "pid"
    script.write_text(ORPHANS)
    with subprocess.Popen([sys.executable, script, reported]) as command:
        while not reported.is_file() or not reported.read_text():
            time.sleep(0.05)
        command.kill()
    until = time.monotonic() + 20
    while lives(reported.read_text()) and time.monotonic() < until:
        time.sleep(0.05)
    assert not lives(reported.read_text())


# ---------------------------------------------------------------- rows that are kept


class Colour(Enum):
    RED = "red"


@dataclass(frozen=True)
class Inner:
    name: str
    values: np.ndarray


@dataclass(frozen=True)
class Result(Row):
    number: int
    square: float | None = None
    colour: Colour = Colour.RED
    kind: Literal["a", "b"] = "a"
    pair: tuple[int, str] = (1, "x")
    table: dict[str, list[float]] = field(default_factory=dict)
    inner: Inner | None = None
    picture: Any = for_pictures()  # noqa: RUF009


def measured(folder, number):
    if number == 2 and (folder / "stop").exists():
        raise ValueError("the third job fails")
    return Result(number, square=float(mark_and_square(folder, number)))


def run(folder, study="a study", processes=0, **more):
    """Rows of four cases that depend on a folder's robots, and how many of them were taken up."""
    with kept_rows(folder / KEPT, study, sorted(folder.glob("*.toml"))) as kept:
        work = partial(measured, folder)
        rows = run_cases(range(4), work, kinds=(Result,), kept=kept, processes=processes, **more)
        return rows, kept.taken


@pytest.fixture
def stopped(tmp_path):
    """A folder in which a study of a robot stopped at its third case."""
    (tmp_path / "my.toml").write_text("length = 1")
    (tmp_path / "stop").touch()
    with pytest.raises(ValueError, match="third"):
        run(tmp_path)
    (tmp_path / "stop").unlink()
    return tmp_path


def test_a_stopped_run_goes_on_where_it_was(stopped):
    rows, taken = run(stopped, processes=1)
    assert [row.square for row in rows] == [0, 1, 4, 9]
    assert taken == 2 and len(list(stopped.glob("*-*"))) == 4
    assert not (stopped / KEPT).exists()


def test_rows_are_read_as_they_were_written(tmp_path):
    values = np.array([[0.1, np.nan], [1e-300, -np.inf]])
    texts, empty = np.array(["", "late"]), np.empty((0, 3))
    rows = [
        Result(3, 1 / 3, Colour.RED, "b", (2, "y"), {"a": [0.1]}, Inner("z", values), texts),
        Result(np.int64(4), np.float64(2.5), picture=[{"x": empty}]),
    ]
    Kept(tmp_path / KEPT, "a study").add("one", rows)
    found = Kept(tmp_path / KEPT, "a study").rows("one", [Inner, Result])
    assert [row.row() | {"inner": None} for row in found] == [
        r.row() | {"inner": None} for r in rows
    ]
    assert type(found[1].number) is int and found[0].inner.name == "z"
    for back, array in ((found[0].inner.values, values), (found[0].picture, texts)):
        assert np.array_equal(back, array, equal_nan=array.dtype.kind == "f")
        assert back.dtype == array.dtype


@pytest.mark.parametrize(
    "change",
    ["study", "version", "file", "content of a file", "sources"],
    ids=lambda change: f"another {change}",
)
def test_rows_of_something_else_are_not_taken_up(change, stopped, monkeypatch):
    match change:
        case "version":
            monkeypatch.setattr(runs, "__version__", "0.0.1")
        case "sources":
            monkeypatch.setattr(runs, "_own_files", lambda: (stopped / "my.toml",))
        case "file":
            (stopped / "other.toml").touch()
        case "content of a file":
            (stopped / "my.toml").write_text("length = 2")
    assert run(stopped, study="another" if change == "study" else "a study")[1] == 0


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[:-5],  # cut short by a kill
        lambda text: text.replace('"square": 1.0', '"square": "much"'),
        lambda text: text.replace('"square": 1.0', '"cube": 1.0'),
        lambda text: text.replace('"": "Result"', '"": "Path"'),
        lambda text: "x" + text,
        lambda text: "",
    ],
)
def test_a_line_that_is_damaged_is_measured_anew(damage, stopped):
    kept = stopped / KEPT
    kept.write_text(damage(kept.read_text()))
    rows, taken = run(stopped)
    assert [row.square for row in rows] == [0, 1, 4, 9] and taken < 2


def test_rows_are_kept_until_what_they_are_for_is_written(tmp_path):
    with pytest.raises(OSError, match="full"), kept_rows(tmp_path / KEPT, "a study") as kept:
        run_cases(range(4), partial(measured, tmp_path), kept=kept, processes=0)
        raise OSError("the disk is full")
    assert run(tmp_path)[1] == 4


def test_a_study_has_a_name_until_it_is_done(tmp_path):
    with kept_rows(tmp_path / KEPT, "a study") as kept:
        name = kept.name
        assert Kept(tmp_path / KEPT, "a study").name == name
    assert Kept(tmp_path / KEPT, "a study").name != name


def test_what_arrives_is_made_into_rows_here(tmp_path):
    rows, _ = run(tmp_path, arrived=lambda case, row: replace(row, number=case + 10))
    assert [row.number for row in rows] == [10, 11, 12, 13]


def test_cases_are_told_apart_by_their_fields():
    assert case_key({"a": 1, "b": 2}) == case_key({"b": 2, "a": 1}) != case_key({"a": 1, "b": 3})
    assert case_key(Inner("x", np.ones(2))) == case_key(Inner("x", np.ones(2)))
    assert case_key(Result(1)) != case_key(Result(2))


def test_progress_of_cases_here_is_told_before_each(stopped):
    seen = []
    run(stopped, progress=lambda *reported: seen.append(reported))
    assert seen == [("2", 2, 4), ("3", 3, 4), ("done", 4, 4)]


# ---------------------------------------------------------------- workers


@pytest.mark.parametrize("text", ["0", "-1", "two", "ray:", "", "²"])
def test_workers_that_are_none_are_refused(text):
    with pytest.raises(ValueError, match="ray:ADDRESS"):
        parsed_workers(text)


def test_workers_are_numbers_or_addresses():
    assert parsed_workers("3") == Workers(3)
    assert parsed_workers("ray") == Workers(ray="local")
    assert parsed_workers("ray:127.0.0.1:6379") == Workers(ray="127.0.0.1:6379")
