"""Every law on every robot, on generic paths at shares of the robot's first frequency."""

from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from softrobot_env.benchmarks.laps import OBSERVER, ROBOTS, LapsRow, RefusedRow, laps_case, run_all
from softrobot_env.benchmarks.laws.goals import GoalRow, goal_rows, ranked_laws
from softrobot_env.benchmarks.laws.rows import FREQUENCIES, TASKS, PathRow, Prepared, prepare
from softrobot_env.benchmarks.records import of_kind, select
from softrobot_env.core.jobs import Progress, run_in_processes
from softrobot_env.evaluation.runner import Case

#: Factors on Young's modulus that the best laws of a robot meet, and how many laws they are.
MODULI, BEST = (0.75, 1.25), 3

#: Robots, tasks and frequencies, and those of a quick run.
_ALL = (ROBOTS, TASKS, FREQUENCIES)
_QUICK = (("planar_finger", "silicone_rod"), TASKS[:1], FREQUENCIES[1:2])

Row = LapsRow | RefusedRow | PathRow | GoalRow


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Run all laws that fit on all robots, and the best of each on other robots and with observers.

    Args:
        quick: Two robots, one path.
        progress: Called with (description, done, total), or None.

    Returns:
        Paths, what is refused, episodes, and goals.
    """
    with TemporaryDirectory() as folder:
        rows = _run(*(_QUICK if quick else _ALL), Path(folder), progress)
    return [_without(folder, row) for row in rows]


def _without(folder: str, row: Row) -> Row:
    """The row with robots' files named without their folder, which is gone."""
    if not isinstance(row, RefusedRow):
        return row
    return replace(row, reason=row.reason.replace(f"{folder}/", ""))


def _run(
    robots: tuple[str, ...],
    tasks: tuple[str, ...],
    frequencies: tuple[float, ...],
    folder: Path,
    progress: Progress | None,
) -> list[Row]:
    jobs = [
        (f"training and paths of {name}", partial(prepare, name, tasks, frequencies, folder))
        for name in robots
    ]
    known: dict[str, Prepared] = dict(zip(robots, run_in_processes(jobs, progress), strict=True))
    rows: list[Row] = [row for prepared in known.values() for row in prepared.rows]
    laws = [(task, law) for p in known.values() for law in p.policies for task in p.tasks]
    rows += run_all([laps_case(*law) for law in laws], progress)
    rows += _varied(known, of_kind(rows, LapsRow), progress)
    return [*rows, *goal_rows(of_kind(rows, LapsRow))]


def _varied(
    known: dict[str, Prepared], rows: list[LapsRow], progress: Progress | None
) -> list[LapsRow | RefusedRow]:
    """The best laws of each robot on softer and stiffer ones, and with an observer."""
    cases, unchanged = [], []
    best = [(name, law) for name, laws in ranked_laws(rows).items() for law in laws[:BEST]]
    for name, law in best:
        ways: list[dict[str, Any]] = [{"variation": {"youngs_modulus": f}} for f in MODULI]
        if _reads_rates(laps_case(known[name].tasks[0], law)):
            ways.append({"feedback": "output"})
        else:
            same = {"what": OBSERVER, "feedback": "output"}
            unchanged += [replace(row, **same) for row in select(rows, robot=name, policy=law)]
        cases += [laps_case(task, law, **way) for way in ways for task in known[name].tasks]
    return [*run_all(cases, progress), *unchanged]


def _reads_rates(case: Case) -> bool:
    """Whether a policy reads curvature rates, which an observer can give."""
    with closing(case.environment()) as env:
        return "curvature_rate" in getattr(case.make_policy(env.control_period), "requires", ())
