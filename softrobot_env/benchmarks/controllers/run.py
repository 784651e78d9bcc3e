"""What sec. 6.6 of the thesis reports about its controllers, run anew for all policies."""

from collections.abc import Iterator, Sequence

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.benchmarks.controllers import goals as controllers_goals
from softrobot_env.benchmarks.controllers.cases import (
    PCC,
    TASKS,
    Case,
    Row,
    measures_rates,
    policies,
    run_case,
)
from softrobot_env.benchmarks.controllers.rows import E, with_ratios
from softrobot_env.benchmarks.jobs import Job, Progress, run_jobs

#: The thesis' plant; MuJoCo's chain; the same without measured rates; other parameters.
SETTINGS = ("thesis", "mujoco", "output", "robustness")

#: Factors on Young's modulus (sec. 6.6.3), apart from 1.
MODULI, QUICK_MODULI = (0.5, 0.75, 1.25, 1.5), (0.5,)

#: Policies that meet further variations on the swing, and these.
_VARIED = ("lqi", "lq_adaptive")
_VARIATIONS = (
    {"density": 0.6},
    {"density": 1.5},
    {"damping_time": 0.5},
    {"damping_time": 2.0},
)

_SWING = ("swing", None)
_QUICK_TASKS = (("step", 0.05), _SWING)

_Task = tuple[str, float | None]


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Run all policies in all settings.

    Args:
        quick: Fewer tasks and parameters.
        progress: Called with (description, done, total), or None.

    Returns:
        Rows of `evaluation.report.make_row` with setting (one of `SETTINGS`), feedback,
        decision_period [s], e_motion, e_motion_least [m] and tension_max [N] (see
        `controllers_cases.extra_metrics`), e_max_ratio and e_rms_ratio to the nominal robot where
        the robot is varied, and, on the thesis' plant, a trace for the figures. Goals come last,
        see `controllers_goals.rows`.
    """
    found = run_jobs([_job(case) for case in _cases(quick)], progress)
    found = with_ratios(found)
    return [*found, *controllers_goals.rows(found)]


def _job(case: Case) -> Job:
    return case.label, lambda: [run_case(case)]


def _cases(quick: bool) -> Iterator[Case]:
    names = policies()
    rates = [name for name in names if measures_rates(name)]
    tasks = _QUICK_TASKS if quick else TASKS
    yield from _nominal("thesis", PCC, names, tasks)
    yield from _nominal("mujoco", MUJOCO, names, tasks)
    yield from _nominal("output", MUJOCO, rates, tasks[:1] if quick else tasks)
    yield from _robustness(quick, names, tasks)


def _nominal(
    setting: str, plant: str, names: Sequence[str], tasks: Sequence[_Task]
) -> Iterator[Case]:
    feedback = "output" if setting == "output" else "state"
    for task, width in tasks:
        for name in names:
            yield Case(setting, plant, name, task, width, feedback=feedback)


def _robustness(quick: bool, names: Sequence[str], tasks: Sequence[_Task]) -> Iterator[Case]:
    for factor in QUICK_MODULI if quick else MODULI:
        if not quick:
            yield from _varied(PCC, names, [_SWING], {E: factor})
        yield from _varied(MUJOCO, names, [_SWING] if quick else tasks, {E: factor})
    for variation in () if quick else _VARIATIONS:
        yield from _varied(MUJOCO, [n for n in _VARIED if n in names], [_SWING], variation)


def _varied(
    plant: str, names: Sequence[str], tasks: Sequence[_Task], variation: dict[str, float]
) -> Iterator[Case]:
    for task, width in tasks:
        for name in names:
            yield Case("robustness", plant, name, task, width, variation)
