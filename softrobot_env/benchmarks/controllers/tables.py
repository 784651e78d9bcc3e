"""The rows of the controller benchmark as tables that fit a report of 110 columns."""

from collections.abc import Iterator

from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.controllers.cases import (
    MOTION,
    TASKS,
    ControllerRow,
    E,
    VariedRow,
    moduli,
)
from softrobot_env.benchmarks.controllers.goals import JUDGED, GoalRow
from softrobot_env.benchmarks.controllers.run import Row
from softrobot_env.benchmarks.records import names, of_kind, one, select
from softrobot_env.evaluation.labels import task_label, variation_label
from softrobot_env.evaluation.report import failures
from softrobot_env.rendering.tables import new_table, pivot_table, verdict
from softrobot_env.thesis.figures import AUDIT, CONTROLLERS, FIGURES, POLICY_TIME, ROBUSTNESS
from studies.quantities import (
    QUANTITIES,
    both,
    cell,
    cells,
    number,
    span,
    with_unit,
)

_STEP = ("rise_time", "settling_time", "overshoot", "steady_state_error")
_NUMBERS = {0.05: "6.2", 0.1: "6.3", 0.2: "6.4"}
_PLANTS = {"thesis": "PCC", "mujoco": "MuJoCo"}
_SETTINGS = {**_PLANTS, "output": "MuJoCo, output", "robustness": "MuJoCo, other E"}
_PLANT_NAMES = {"pcc": "PCC", "mujoco": "MuJoCo"}

Rows = list[ControllerRow]


def tables(rows: list[Row]) -> Group:
    """Tabs. 6.2 to 6.5 and errors beside the thesis', robustness, output feedback and goals."""
    found = of_kind(rows, ControllerRow)
    parts = [
        *(_step_table(found, width) for width in _NUMBERS),
        _steps(found),
        *(_tracking(found, task) for task in MOTION),
        _motions(found),
        _policy_times(found),
        *_robustness(select(found, feedback="state")),
        _output(found),
        _goals(of_kind(rows, GoalRow)),
    ]
    parts = [part for part in parts if part.row_count]
    return Group(*parts, *map(Text, failures([row.row() for row in found])))


def _task(task: str, width: float | None) -> str:
    return task_label({"task": task, "step_width": width})


# ---------------------------------------------------------------- beside the thesis


def _printed(policy: str, task: str, width: float | None, metric: str) -> tuple[str, str]:
    """The thesis' number and the audit's."""
    controller = CONTROLLERS.get(policy)
    figure = one(FIGURES, task=task, step_width=width, controller=controller)
    thesis = None if figure is None else getattr(figure, metric)
    audit = AUDIT.get((task, width, controller), {}).get(metric)
    bound = "<" * (metric == "e_motion" and thesis is not None)
    return bound + number(thesis, metric), span(audit, metric)


def _on_plants(rows: Rows, policy: str, task: str, width: float | None = None) -> list | None:
    """A policy's rows on both plants, None for one that was not run; None if neither was."""
    pair = [one(rows, setting=s, policy=policy, task=task, step_width=width) for s in _PLANTS]
    return None if pair == [None, None] else pair


def _step_table(rows: Rows, width: float) -> Table:
    """Tab. 6.2, 6.3 or 6.4: a line per controller and quantity."""
    title = f"Tab. {_NUMBERS[width]}: step of {1e3 * width:g} mm, thesis' controllers"
    out = new_table(title, ("controller", "quantity"), ("thesis", "audit", *_PLANTS.values()))
    for policy in CONTROLLERS:
        pair = _on_plants(rows, policy, "step", width)
        for metric in _STEP if pair else ():
            printed = _printed(policy, "step", width, metric)
            ours = (cell(row, metric) for row in pair)
            out.add_row(policy, QUANTITIES[metric].heading, *printed, *ours)
        out.add_section()
    return out


def _steps(rows: Rows) -> Table:
    """All policies on all steps and both plants."""
    metrics = (*_STEP, "e_rms", "tension_max")
    heads = [QUANTITIES[metric].heading for metric in metrics]
    out = new_table("Steps, all policies: PCC / MuJoCo", ("step", "policy"), heads)
    for width in _NUMBERS:
        for policy in names(rows):
            if pair := _on_plants(rows, policy, "step", width):
                out.add_row(f"{1e3 * width:g} mm", policy, *(both(pair, m) for m in metrics))
        out.add_section()
    return out


def _tracking(rows: Rows, task: str) -> Table:
    """Errors on the swing or the L-shape, all policies and both plants."""
    title = f"{task}: tip error in mm and largest tension in N, PCC / MuJoCo"
    metrics = ("e_max", "e_rms", "e_final", "tension_max")
    heads = ("max, thesis", "max, audit", *(QUANTITIES[metric].name for metric in metrics))
    out = new_table(title, ("policy",), heads)
    for policy in names(rows):
        if pair := _on_plants(rows, policy, task):
            printed = _printed(policy, task, None, "e_max")
            out.add_row(policy, *printed, *(both(pair, metric) for metric in metrics))
    return out


def _motions(rows: Rows) -> Table:
    """Smallest and largest error away from the kinks of the reference."""
    told = {t: " and ".join(f"{a:g} to {b:g} s" for a, b in times) for t, times in MOTION.items()}
    spans = "\n".join(f"{task}: {text}" for task, text in told.items())
    title = f"Smallest to largest error in mm away from the reference's kinks\n{spans}"
    out = new_table(title, ("task", "policy"), ("thesis", "audit", *_PLANTS.values()))
    for task in MOTION:
        for policy in names(select(rows, task=task)):
            pair = _on_plants(rows, policy, task) or (None, None)
            out.add_row(
                task, policy, *_printed(policy, task, None, "e_motion"), *map(_motion, pair)
            )
        out.add_section()
    return out


def _motion(row: ControllerRow | None) -> str:
    if row is None or row.e_motion is None:
        return cell(row, "e_motion")
    return span((row.e_motion_least, row.e_motion), "e_motion")


def _policy_times(rows: Rows) -> Table:
    """Tab. 6.5."""
    title = "Tab. 6.5: policy time per decision in µs, median / 99th percentile"
    shown = (("thesis", "step", 0.05), ("mujoco", "step", 0.05), ("mujoco", "swing", None))
    heads = [f"{_PLANTS[s]}\n{_task(task, width)}" for s, task, width in shown]
    out = new_table(title, ("policy",), ("decides\nevery ms", "thesis", *heads))
    for policy in names(rows):
        mine = [one(rows, setting=s, policy=policy, task=t, step_width=w) for s, t, w in shown]
        first = next((row for row in mine if row is not None), None)
        if first is not None:
            thesis = number(POLICY_TIME.get(CONTROLLERS.get(policy)), "policy_time_median")
            out.add_row(policy, f"{1e3 * first.decision_period:g}", thesis, *map(_times, mine))
    return out


def _times(row: ControllerRow | None) -> str:
    if row is None:
        return "-"
    times = ("policy_time_median", "policy_time_p99")
    return " / ".join(number(getattr(row, name), name) for name in times)


# ---------------------------------------------------------------- robots of other parameters


def _robustness(rows: Rows) -> Iterator[Table]:
    """Errors over Young's modulus, largest ratios to the nominal ones, other parameters."""
    yield _moduli(rows, "pcc", "swing", None)
    for task, width in (*TASKS[3:], *TASKS[:3]):
        yield _moduli(rows, "mujoco", task, width)
    varied = of_kind(rows, VariedRow)
    yield _ratios([row for row in select(varied, plant="mujoco") if list(row.variation) == [E]])
    yield _others(select(varied, setting="robustness", modulus=None))


def _moduli(rows: Rows, plant: str, task: str, width: float | None) -> Table:
    """A line per policy, a column per factor on Young's modulus."""
    metrics, stroke, what = ("e_max", "e_rms"), " / ", "max / rms mm"
    if width is not None:
        metrics, stroke = ("e_rms", "settling_time", "overshoot"), "/"
        what = "rms mm/settling s/over %"
    place = f"{_task(task, width)} on {_PLANT_NAMES[plant]}"
    mine = select(rows, plant=plant, task=task, step_width=width)
    factors = moduli(mine)
    heads = [f"E x {factor:g}" for factor in factors]
    out = new_table(f"{place} with another Young's modulus: {what}", ("policy",), heads)
    for policy in names(mine) if len(factors) > 1 else ():
        found = [one(mine, policy=policy, modulus=factor) for factor in factors]
        out.add_row(policy, *(cells(row, metrics, stroke) for row in found))
        if plant == "pcc" and policy in CONTROLLERS:
            said = ROBUSTNESS[CONTROLLERS[policy]]
            out.add_row("  thesis", *(said.get(factor, "-") for factor in factors))
    return out


def _ratios(varied: list[VariedRow]) -> Table:
    """Largest ratio to the nominal error over Young's modulus, by policy and task."""
    return pivot_table(
        "MuJoCo: largest error with another Young's modulus over the nominal one (max / rms)",
        "policy",
        names(varied),
        {_task(*task): task for task in TASKS},
        lambda policy, task: _largest(
            select(varied, policy=policy, task=task[0], step_width=task[1])
        ),
    )


def _largest(rows: list[VariedRow]) -> str:
    if not rows:
        return "-"
    if any(row.failure is not None for row in rows):
        return "failed"
    parts = []
    for name in ("e_max_ratio", "e_rms_ratio"):
        known = [getattr(row, name) for row in rows]
        parts.append(number(max((v for v in known if v is not None), default=None), name))
    return " / ".join(parts if rows[0].task != "step" else parts[1:])


def _others(varied: list[VariedRow]) -> Table:
    """Density and damping, beyond the thesis."""
    title = "Swing on MuJoCo with another density or damping time (beyond the thesis)"
    heads = ("max mm", "rms mm", "max over nominal", "rms over nominal")
    out = new_table(title, ("policy", "variation"), heads)
    for row in varied:
        ratios = (number(getattr(row, name), name) for name in ("e_max_ratio", "e_rms_ratio"))
        errors = (cell(row, name) for name in ("e_max", "e_rms"))
        out.add_row(row.policy, variation_label(row.row()), *errors, *ratios)
    return out


# ---------------------------------------------------------------- output feedback and goals


def _output(rows: Rows) -> Table:
    """Policies that measure rates, with an observer in place of the rates."""
    title = "MuJoCo, tip and curvatures measured, rates observed (in brackets: rates measured)"
    metrics = ("e_max", "e_rms", "settling_time", "overshoot")
    out = new_table(title, ("task", "policy"), ("max mm", "rms mm", "settling s", "over %"))
    for task, width in TASKS:
        for row in select(rows, setting="output", task=task, step_width=width):
            nominal = one(rows, setting="mujoco", task=task, step_width=width, policy=row.policy)
            # The largest error of a step is its width.
            shown = metrics[:2] if task != "step" else metrics[1:]
            pairs = (
                f"{cell(row, name)} ({cell(nominal, name)})" if name in shown else ""
                for name in metrics
            )
            out.add_row(_task(task, width), row.policy, *pairs)
        out.add_section()
    return out


def _goals(goals: list[GoalRow]) -> Table:
    title = "Goals: the best policy on MuJoCo in the settings it was run in, then policy times"
    out = new_table(title, ("goal", "policy", "setting"), ("found", "limit", "met"))
    order = {name: place for place, name in enumerate((*JUDGED, "robustness"))}
    timed = "policy_time_median"
    for row in sorted(goals, key=lambda row: (row.metric == timed, order[row.setting])):
        numbers = (with_unit(value, row.metric) for value in (row.value, row.limit))
        out.add_row(row.goal, row.policy, _SETTINGS[row.setting], *numbers, verdict(row.met))
    return out
