"""Goals for the controllers, and whether a run of the benchmark met them."""

from collections.abc import Iterator
from dataclasses import dataclass

from softrobot_env.benchmarks.controllers.cases import ControllerRow, E, VariedRow
from softrobot_env.benchmarks.records import Record, of_kind, one, select

#: Settings in which the accuracy of the best policy is judged.
JUDGED = ("mujoco", "thesis", "output")

#: Largest error of the best policy with another Young's modulus over that with the nominal one.
_RATIO = 2.0

#: Largest policy times [s] (median): the thesis' own, and a tenth of it for the MPC.
_POLICY_TIMES = {"qs_nn": 5.4e-6, "lqi": 11.2e-6, "mpc": 5e-3}

_WIDTHS = (0.05, 0.1, 0.2)


@dataclass(frozen=True)
class Goal:
    """An upper limit on a metric of the best policy; SI units.

    Attributes:
        text: For people.
        task: Name of the task.
        metric: Key of a row.
        limit: The limit.
        widths: [m], widths of the step; the largest value counts.
        strict: Whether the value has to stay below the limit.
    """

    text: str
    task: str
    metric: str
    limit: float
    widths: tuple[float | None, ...] = (None,)
    strict: bool = False


GOALS = (
    Goal("swing, largest error", "swing", "e_max", 2e-3),
    Goal("swing, rms error", "swing", "e_rms", 0.3e-3),
    Goal("L-shape, largest error", "lshape", "e_max", 0.8e-3),
    Goal("step of 50 mm, overshoot", "step", "overshoot", 0.05, (0.05,)),
    Goal("step of 50 mm, settling time", "step", "settling_time", 0.4, (0.05,)),
    Goal("step of 200 mm, overshoot", "step", "overshoot", 0.1, (0.2,)),
    Goal("step of 200 mm, settling time", "step", "settling_time", 1.0, (0.2,)),
    Goal("all steps, steady-state error", "step", "steady_state_error", 1e-4, _WIDTHS, True),
)

#: Task, step width [m] and errors whose growth with another Young's modulus is limited.
_GROWTH = (
    ("swing", None, ("e_max", "e_rms")),
    ("lshape", None, ("e_max", "e_rms")),
    *(("step", width, ("e_rms",)) for width in _WIDTHS),
)

_ERRORS = {"e_max": "largest error", "e_rms": "rms error"}


@dataclass(frozen=True)
class GoalRow(Record):
    """A goal, and what was found.

    Attributes:
        goal: For people.
        policy, setting: Of the episodes that are judged.
        metric: Field of a row, whose unit is that of value and limit.
        value: None where an episode failed or never settled.
        limit: The largest allowed.
        met: Whether it was met.
    """

    goal: str
    policy: str
    setting: str
    metric: str
    value: float | None
    limit: float
    met: bool


def rows(found: list[ControllerRow]) -> list[GoalRow]:
    """Goals and what episodes say about them; those on episodes that were not run are left out."""
    best = best_policy(found)
    out = [] if best is None else [*_accuracy(found, best), *_robustness(found, best)]
    return [*out, *_policy_times(found)]


def best_policy(found: list[ControllerRow]) -> str | None:
    """The policy with the least rms error on MuJoCo's swing; None if there is none."""
    swings = select(found, setting="mujoco", task="swing", failure=None)
    return min(swings, key=lambda row: row.e_rms).policy if swings else None


def _accuracy(found: list[ControllerRow], best: str) -> Iterator[GoalRow]:
    for goal in GOALS:
        for setting in JUDGED:
            fields = {"setting": setting, "policy": best, "task": goal.task}
            mine = [one(found, **fields, step_width=width) for width in goal.widths]
            values = [getattr(row, goal.metric) for row in mine if row is not None]
            if values:
                yield _row(
                    goal.text, best, setting, goal.metric, _worst(values), goal.limit, goal.strict
                )


def _robustness(found: list[ControllerRow], best: str) -> Iterator[GoalRow]:
    mujoco = select(found, plant="mujoco", policy=best, feedback="state")
    varied = [row for row in of_kind(mujoco, VariedRow) if list(row.variation) == [E]]
    for task, width, metrics in _GROWTH:
        mine = select(varied, task=task, step_width=width)
        label = task if width is None else f"step of {1e3 * width:g} mm"
        for metric in metrics if mine else ():
            text = f"{label}, {_ERRORS[metric]} over nominal, worst E"
            ratio = f"{metric}_ratio"
            worst = _worst([getattr(row, ratio) for row in mine])
            yield _row(text, best, "robustness", ratio, worst, _RATIO)
    if varied:
        failed = sum(row.failure is not None for row in varied)
        text = "failed episodes with another E"
        yield _row(text, best, "robustness", "failures", failed, 0)


def _policy_times(found: list[ControllerRow]) -> Iterator[GoalRow]:
    for policy, limit in _POLICY_TIMES.items():
        for setting in ("mujoco", "thesis"):
            row = one(found, setting=setting, policy=policy, task="step", step_width=0.05)
            if row is not None:
                text, time = f"policy time of {policy}", row.policy_time_median
                yield _row(text, policy, setting, "policy_time_median", time, limit)


def _worst(values: list[float | None]) -> float | None:
    """The largest; None if one is missing."""
    return None if None in values else max(values)


def _row(
    text: str,
    policy: str,
    setting: str,
    metric: str,
    value: float | None,
    limit: float,
    strict: bool = False,
) -> GoalRow:
    met = value is not None and (value < limit if strict else value <= limit)
    return GoalRow(text, policy, setting, metric, value, limit, met)
