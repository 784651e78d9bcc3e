"""The rows of the controller benchmark as tables that fit a report of 110 columns."""

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.controllers.cases import MOTION, TASKS, Row
from softrobot_env.benchmarks.controllers.cells import (
    METRICS,
    both,
    cell,
    new_table,
    number,
    span,
    task_name,
    verdict,
    with_unit,
)
from softrobot_env.benchmarks.controllers.goals import JUDGED
from softrobot_env.benchmarks.controllers.robustness_tables import robustness_tables
from softrobot_env.benchmarks.controllers.rows import names, one, select
from softrobot_env.evaluation.report import failures
from softrobot_env.evaluation.thesis import AUDIT, CONTROLLERS, FIGURES, POLICY_TIME, ThesisFigure

_STEP = ("rise_time", "settling_time", "overshoot", "steady_state_error")
_NUMBERS = {0.05: "6.2", 0.1: "6.3", 0.2: "6.4"}
_PLANTS = {"thesis": "PCC", "mujoco": "MuJoCo"}
_SETTINGS = {**_PLANTS, "output": "MuJoCo, output", "robustness": "MuJoCo, other E"}


def tables(rows: list[Row]) -> Group:
    """Tabs. 6.2 to 6.5 and errors beside the thesis', robustness, output feedback and goals."""
    parts = [
        *(_step_table(rows, width) for width in _NUMBERS),
        _steps(rows),
        *(_tracking(rows, task) for task in MOTION),
        _motions(rows),
        _policy_times(rows),
        *robustness_tables(rows),
        _output(rows),
        _goals(rows),
    ]
    parts = [part for part in parts if part.row_count]
    return Group(*parts, *(Text(line) for line in failures(select(rows))))


def _figure(task: str, width: float | None, controller: str | None) -> ThesisFigure | None:
    mine = (f for f in FIGURES if (f.task, f.step_width, f.controller) == (task, width, controller))
    return next(mine, None)


def _printed(policy: str, task: str, width: float | None, metric: str) -> tuple[str, str]:
    """The thesis' number and the audit's."""
    controller = CONTROLLERS.get(policy)
    figure = _figure(task, width, controller)
    thesis = None if figure is None else getattr(figure, metric)
    audit = AUDIT.get((task, width, controller), {}).get(metric)
    bound = "<" * (metric == "e_motion" and thesis is not None)
    return bound + number(thesis, metric), span(audit, metric)


def _step_table(rows: list[Row], width: float) -> Table:
    """Tab. 6.2, 6.3 or 6.4: a line per controller and quantity."""
    title = f"Tab. {_NUMBERS[width]}: step of {1e3 * width:g} mm, thesis' controllers"
    out = new_table(title, ("controller", "quantity"), ("thesis", "audit", *_PLANTS.values()))
    for policy in CONTROLLERS:
        fields = {"policy": policy, "task": "step", "step_width": width}
        ours = [one(rows, setting=setting, **fields) for setting in _PLANTS]
        if any(row is not None for row in ours):
            for metric in _STEP:
                printed = _printed(policy, "step", width, metric)
                label = " ".join(METRICS[metric][:2])
                out.add_row(policy, label, *printed, *(cell(row, metric) for row in ours))
            out.add_section()
    return out


def _steps(rows: list[Row]) -> Table:
    """All policies on all steps and both plants."""
    title = "Steps, all policies: PCC / MuJoCo"
    heads = [" ".join(METRICS[metric][:2]) for metric in (*_STEP, "e_rms", "tension_max")]
    out = new_table(title, ("step", "policy"), heads)
    for width in _NUMBERS:
        for policy in names(rows):
            fields = {"policy": policy, "task": "step", "step_width": width}
            ours = [one(rows, setting=setting, **fields) for setting in _PLANTS]
            if any(row is not None for row in ours):
                cells = (both(ours, metric) for metric in (*_STEP, "e_rms", "tension_max"))
                out.add_row(f"{1e3 * width:g} mm", policy, *cells)
        out.add_section()
    return out


def _tracking(rows: list[Row], task: str) -> Table:
    """Errors on the swing or the L-shape, all policies and both plants."""
    title = f"{task}: tip error in mm and largest tension in N, PCC / MuJoCo"
    metrics = ("e_max", "e_rms", "e_final", "tension_max")
    heads = ("max, thesis", "max, audit", *(METRICS[metric][0] for metric in metrics))
    out = new_table(title, ("policy",), heads)
    for policy in names(rows):
        pair = [one(rows, setting=s, policy=policy, task=task) for s in _PLANTS]
        if any(row is not None for row in pair):
            cells = (both(pair, metric) for metric in metrics)
            out.add_row(policy, *_printed(policy, task, None, "e_max"), *cells)
    return out


def _motions(rows: list[Row]) -> Table:
    """Smallest and largest error away from the kinks of the reference."""
    spans = "\n".join(f"{task}: {_spans(task)}" for task in MOTION)
    title = f"Smallest to largest error in mm away from the reference's kinks\n{spans}"
    out = new_table(title, ("task", "policy"), ("thesis", "audit", *_PLANTS.values()))
    for task in MOTION:
        for policy in names(select(rows, task=task)):
            pair = [one(rows, setting=s, policy=policy, task=task) for s in _PLANTS]
            cells = (_motion(row) for row in pair)
            out.add_row(task, policy, *_printed(policy, task, None, "e_motion"), *cells)
        out.add_section()
    return out


def _spans(task: str) -> str:
    return " and ".join(f"{begin:g} to {end:g} s" for begin, end in MOTION[task])


def _motion(row: Row | None) -> str:
    if row is None or row["e_motion"] is None:
        return cell(row, "e_motion")
    return span((row["e_motion_least"], row["e_motion"]), "e_motion")


def _policy_times(rows: list[Row]) -> Table:
    """Tab. 6.5."""
    title = "Tab. 6.5: policy time per decision in us, median / 99th percentile"
    shown = (("thesis", "step", 0.05), ("mujoco", "step", 0.05), ("mujoco", "swing", None))
    heads = [f"{_PLANTS[s]}\n{task_name(task, width)}" for s, task, width in shown]
    out = new_table(title, ("policy",), ("decides\nevery ms", "thesis", *heads))
    for policy in names(rows):
        mine = [one(rows, setting=s, policy=policy, task=t, step_width=w) for s, t, w in shown]
        first = next((row for row in mine if row is not None), None)
        if first is not None:
            thesis = POLICY_TIME.get(CONTROLLERS.get(policy))
            cells = ("-" if r is None else _times(r) for r in mine)
            period = f"{1e3 * first['decision_period']:g}"
            out.add_row(policy, period, number(thesis, "policy_time_median"), *cells)
    return out


def _times(row: Row) -> str:
    names = ("policy_time_median", "policy_time_p99")
    return " / ".join(number(row[name], name) for name in names)


def _output(rows: list[Row]) -> Table:
    """Policies that measure rates, with an observer in place of the rates."""
    title = "MuJoCo, tip and curvatures measured, rates observed (in brackets: rates measured)"
    metrics = ("e_max", "e_rms", "settling_time", "overshoot")
    out = new_table(title, ("task", "policy"), ("max mm", "rms mm", "settling s", "over %"))
    for task, width in TASKS:
        for row in select(rows, setting="output", task=task, step_width=width):
            nominal = one(rows, setting="mujoco", task=task, step_width=width, policy=row["policy"])
            # The largest error of a step is its width.
            shown = metrics[:2] if task != "step" else metrics[1:]
            cells = (
                f"{cell(row, name)} ({cell(nominal, name)})" if name in shown else ""
                for name in metrics
            )
            out.add_row(task_name(task, width), row["policy"], *cells)
        out.add_section()
    return out


def _goals(rows: list[Row]) -> Table:
    title = "Goals: the best policy on MuJoCo in the settings it was run in, then policy times"
    out = new_table(title, ("goal", "policy", "setting"), ("found", "limit", "met"))
    order = {name: place for place, name in enumerate((*JUDGED, "robustness"))}
    goals = [row for row in rows if "goal" in row]
    timed = "policy_time_median"
    for row in sorted(goals, key=lambda row: (row["metric"] == timed, order[row["setting"]])):
        numbers = (with_unit(row[name], row["metric"]) for name in ("value", "limit"))
        setting = _SETTINGS[row["setting"]]
        out.add_row(row["goal"], row["policy"], setting, *numbers, verdict(row["met"]))
    return out
