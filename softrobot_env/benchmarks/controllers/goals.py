"""Goals for the controllers, and whether a run of the benchmark met them."""

from collections.abc import Iterator
from dataclasses import dataclass

from softrobot_env.benchmarks.controllers.cases import Row
from softrobot_env.benchmarks.controllers.rows import E, one, select

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


def rows(found: list[Row]) -> list[Row]:
    """Goals and what rows of the benchmark say about them.

    Returns:
        Rows with goal, policy, setting, metric (its unit is that of rows), value, limit and met;
        value is None where an episode failed or never settled. Goals on episodes that were not
        run are left out.
    """
    best = best_policy(found)
    out = [] if best is None else [*_accuracy(found, best), *_robustness(found, best)]
    return [*out, *_policy_times(found)]


def best_policy(found: list[Row]) -> str | None:
    """The policy with the least rms error on MuJoCo's swing; None if there is none."""
    swings = select(found, setting="mujoco", task="swing", failure=None)
    return min(swings, key=lambda row: row["e_rms"])["policy"] if swings else None


def _accuracy(found: list[Row], best: str) -> Iterator[Row]:
    for goal in GOALS:
        for setting in JUDGED:
            fields = {"setting": setting, "policy": best, "task": goal.task}
            mine = [one(found, **fields, step_width=width) for width in goal.widths]
            values = [row[goal.metric] for row in mine if row is not None]
            if values:
                fields = {"goal": goal.text, "metric": goal.metric, "limit": goal.limit}
                yield _row(best, setting, _worst(values), strict=goal.strict, **fields)


def _robustness(found: list[Row], best: str) -> Iterator[Row]:
    mujoco = select(found, plant="mujoco", policy=best, feedback="state")
    varied = [row for row in mujoco if list(row["variation"]) == [E]]
    for task, width, metrics in _GROWTH:
        mine = select(varied, task=task, step_width=width)
        label = task if width is None else f"step of {1e3 * width:g} mm"
        for metric in metrics if mine else ():
            text = f"{label}, {_ERRORS[metric]} over nominal, worst E"
            worst = _worst([row[f"{metric}_ratio"] for row in mine])
            fields = {"goal": text, "metric": f"{metric}_ratio", "limit": _RATIO}
            yield _row(best, "robustness", worst, **fields)
    if varied:
        failed = sum(row["failure"] is not None for row in varied)
        fields = {"goal": "failed episodes with another E", "metric": "failures", "limit": 0}
        yield _row(best, "robustness", failed, **fields)


def _policy_times(found: list[Row]) -> Iterator[Row]:
    for policy, limit in _POLICY_TIMES.items():
        for setting in ("mujoco", "thesis"):
            row = one(found, setting=setting, policy=policy, task="step", step_width=0.05)
            if row is not None:
                metric = "policy_time_median"
                fields = {"goal": f"policy time of {policy}", "metric": metric, "limit": limit}
                yield _row(policy, setting, row[metric], **fields)


def _worst(values: list[float | None]) -> float | None:
    """The largest; None if one is missing."""
    return None if None in values else max(values)


def _row(
    policy: str,
    setting: str,
    value: float | None,
    goal: str,
    metric: str,
    limit: float,
    strict: bool = False,
) -> Row:
    met = value is not None and (value < limit if strict else value <= limit)
    row = {"goal": goal, "policy": policy, "setting": setting, "metric": metric}
    return row | {"value": value, "limit": limit, "met": met}
