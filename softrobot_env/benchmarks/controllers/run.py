"""What sec. 6.6 of the thesis reports about its controllers, run anew for all policies."""

from collections.abc import Iterator, Sequence

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.benchmarks.controllers import goals
from softrobot_env.benchmarks.controllers.cases import (
    PCC,
    TASKS,
    ControllerRow,
    E,
    make_case,
    measures_rates,
    run_case,
    with_ratios,
)
from softrobot_env.benchmarks.episodes import policies
from softrobot_env.core.jobs import Progress, run_jobs
from softrobot_env.evaluation.runner import Case

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

Row = ControllerRow | goals.GoalRow


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Run all policies in all settings.

    Args:
        quick: Fewer tasks and parameters.
        progress: Called with (description, done, total), or None.

    Returns:
        Rows of episodes, then goals.
    """
    jobs = [
        (job_label(setting, case), lambda s=setting, c=case: [run_case(s, c)])
        for setting, case in _cases(quick)
    ]
    found = with_ratios(run_jobs(jobs, progress))
    return [*found, *goals.rows(found)]


def job_label(setting: str, case: Case) -> str:
    """For the progress bar."""
    return f"{setting}, {case.plant}, {case.label}"


def _cases(quick: bool) -> Iterator[tuple[str, Case]]:
    """Setting and case of every episode."""
    every = policies()
    rates = [name for name in every if measures_rates(name)]
    tasks = _QUICK_TASKS if quick else TASKS
    yield from _of_policies("thesis", PCC, every, tasks)
    yield from _of_policies("mujoco", MUJOCO, every, tasks)
    yield from _of_policies("output", MUJOCO, rates, tasks[:1] if quick else tasks)
    for factor in QUICK_MODULI if quick else MODULI:
        if not quick:
            yield from _of_policies("robustness", PCC, every, [_SWING], {E: factor})
        varied = [_SWING] if quick else tasks
        yield from _of_policies("robustness", MUJOCO, every, varied, {E: factor})
    for variation in () if quick else _VARIATIONS:
        chosen = [name for name in _VARIED if name in every]
        yield from _of_policies("robustness", MUJOCO, chosen, [_SWING], variation)


def _of_policies(
    setting: str,
    plant: str,
    names: Sequence[str],
    tasks: Sequence[_Task],
    variation: dict[str, float] | None = None,
) -> Iterator[tuple[str, Case]]:
    feedback = "output" if setting == "output" else "state"
    for task, width in tasks:
        for name in names:
            yield setting, make_case(plant, name, task, width, variation, feedback)
