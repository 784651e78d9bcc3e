"""Every law on every robot, on generic paths at shares of the robot's first frequency."""

from functools import partial

from softrobot_env.benchmarks.jobs import Progress, run_in_processes
from softrobot_env.benchmarks.laps import ROBOTS, LapsRow, RefusedRow, nominal, run_all
from softrobot_env.benchmarks.laws.goals import GoalRow, best_laws, goal_rows
from softrobot_env.benchmarks.laws.rows import FREQUENCIES, TASKS, PathRow, Prepared, prepare
from softrobot_env.benchmarks.records import of_kind
from softrobot_env.evaluation.runner import Case

#: Factors on Young's modulus that the best law of a robot meets.
MODULI = (0.75, 1.25)

#: Robots, tasks and frequencies, and those of a quick run.
_ALL = (ROBOTS, TASKS, FREQUENCIES)
_QUICK = (("planar_finger", "silicone_rod"), TASKS[:1], FREQUENCIES[1:2])

Row = LapsRow | RefusedRow | PathRow | GoalRow


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Run all laws that fit on all robots, and the best of each on other robots and feedback.

    Args:
        quick: Two robots, one path.
        progress: Called with (description, done, total), or None.

    Returns:
        Paths, what is refused, episodes, and goals.
    """
    robots, *paths = _QUICK if quick else _ALL
    jobs = [(f"paths of {name}", partial(prepare, name, *paths)) for name in robots]
    known: dict[str, Prepared] = dict(zip(robots, run_in_processes(jobs, progress), strict=True))
    rows: list[Row] = [row for prepared in known.values() for row in prepared.rows]
    rows += run_all([case for prepared in known.values() for case in _nominal(prepared)], progress)
    best = best_laws(of_kind(rows, LapsRow))
    varied = [case for name, law in best.items() for case in _varied(known[name], law)]
    rows += run_all(varied, progress)
    return [*rows, *goal_rows(of_kind(rows, LapsRow))]


def _nominal(prepared: Prepared) -> list[Case]:
    return [
        Case(task, law, **nominal(task.robot))
        for law in prepared.policies
        for task in prepared.tasks
    ]


def _varied(prepared: Prepared, law: str) -> list[Case]:
    """A law on other robots, and with an observer."""
    ways = [{"variation": {"youngs_modulus": factor}} for factor in MODULI]
    ways.append({"feedback": "output"})
    return [
        Case(task, law, **way, **nominal(task.robot)) for way in ways for task in prepared.tasks
    ]
