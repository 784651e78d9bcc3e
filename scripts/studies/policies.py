"""All policies of the arm: on the thesis' tasks (sec. 6.6), on unseen paths, on unknown robots."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import product
from statistics import median
from typing import Any, TypeVar

import numpy as np
from rich.table import Table
from rich.text import Text

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.control.registry import POLICIES, installed_policies
from softrobot_env.evaluation import report, runner
from softrobot_env.evaluation.report import task_label, variation_label
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.evaluation.runner import EpisodeRow, Outcome
from softrobot_env.rendering.curves import (
    Curve,
    draw_curvatures,
    draw_path,
    draw_shapes,
    draw_stacked,
    draw_tip,
    end_errors,
    finish,
    least_error,
    longest,
    most_input,
    policy_curves,
    typical_error,
    until,
)
from softrobot_env.rendering.figures import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    SKY,
    THESIS,
    VERMILLION,
    Axes,
    Figure,
    add_legend,
    add_title,
    entry,
    label_lines,
    new_figure,
    style_axes,
    style_of,
)
from softrobot_env.robots import ARM, centerline
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.tasks import make_task
from softrobot_env.thesis.figures import AUDIT, CONTROLLERS, FIGURES, POLICY_TIME, ROBUSTNESS
from studies.lab import (
    Column,
    Record,
    Study,
    at_most,
    for_pictures,
    groups,
    maps,
    names,
    new_table,
    of_kind,
    one,
    pivot,
    select,
    table,
    verdict,
)
from studies.pictures import label_points
from studies.quantities import QUANTITIES, both, cell, cells, number, span, with_unit

Kind = TypeVar("Kind", bound="PolicyRow")
Variation = dict[str, float]

#: Parameter that sec. 6.6.3 varies, and the thesis' plant by its name in `beams.registry`.
E, PCC = "youngs_modulus", "pcc"

_ERRORS = {"e_max": "largest error", "e_rms": "rms error"}


@dataclass(frozen=True, kw_only=True)
class PolicyRow(EpisodeRow, Record):
    """An episode.

    Attributes:
        decision_period: [s] between decisions of the policy.
        tension_max: [N], largest tension of a tendon; None after a failure.
    """

    decision_period: float
    tension_max: float | None

    @property
    def place(self) -> str:
        """The task for people."""
        return task_label({"task": self.task, "step_width": self.step_width})


def record_of(outcome: Outcome, kind: type[Kind], **own: Any) -> Kind:
    """An episode as a row; `own` are the fields that its kind adds."""
    rollout, period = outcome.rollout, outcome.decision_period
    tension = float(rollout.tendon_tension.max()) if rollout.failure is None else None
    return outcome.row(kind, decision_period=period, tension_max=tension, **own)


def policies() -> list[str]:
    """The thesis' controllers, then all others of the arm but the one that does nothing."""
    known = [*(name for name in CONTROLLERS if name in POLICIES), *POLICIES]
    return [name for name in dict.fromkeys(known) if name != "hold"]


# ---------------------------------------------------------------- the thesis' tasks

#: Task and step width [m] of everything that is run.
TASKS = (("step", 0.05), ("step", 0.1), ("step", 0.2), ("swing", None), ("lshape", None))
_SWING = ("swing", None)
_WIDTHS = (0.05, 0.1, 0.2)

#: Episodes of these policies on a step last [s] longer than the 5 s of the others: they damp
#: nothing and settle late.
_SLOW, _LONG = ("qs_nn", "feedforward", "feedforward_pi"), 25.0

#: Times [s] between which the error during a motion is taken: without the decay after a kink.
MOTION = {"swing": ((0.5, 10.0),), "lshape": ((1.0, 5.0), (6.0, 10.0))}

#: Factors on Young's modulus (sec. 6.6.3), apart from 1.
MODULI, QUICK_MODULI = (0.5, 0.75, 1.25, 1.5), (0.5,)

#: Further variations, and the policies that meet them on the swing.
_VARIATIONS = ({"density": 0.6}, {"density": 1.5}, {"damping_time": 0.5}, {"damping_time": 2.0})
_MEET = ("lqi", "lq_adaptive")

_SAMPLE = 0.01  # s, of a trace

#: Policies in Figs. 6.14 to 6.19: the thesis' controllers, and ours to compare; their tasks.
COMPARED = (*CONTROLLERS, "lq_adaptive")
_DRAWN = (("step", 0.05), _SWING, ("lshape", None))

#: Policies whose behaviour with another Young's modulus is shown, and names of their figures.
VARIED = {
    "qs_nn": "fig_6_20",
    "lqi": "fig_6_21",
    "mpc": "fig_6_22",
    "lq_adaptive": "robustness_lq_adaptive",
    "mpc_preview": "robustness_mpc_preview",
}


@dataclass(frozen=True, kw_only=True)
class ControllerRow(PolicyRow):
    """An episode.

    Attributes:
        setting: "thesis", on its plant; "mujoco", on the chain; "output", the same without
            measured rates; "robustness", with other parameters.
        feedback: What the policy measured.
        e_motion, e_motion_least: [m], largest and smallest error between the kinks of the
            reference; None for steps, and after a failure.
        trace: Every few milliseconds of an episode that a figure shows, and its last curvature.
    """

    setting: str
    feedback: str
    e_motion: float | None
    e_motion_least: float | None
    trace: Rollout | None = for_pictures()

    @property
    def modulus(self) -> float | None:
        """Factor on Young's modulus; None where something else varies."""
        return 1.0 if not self.variation else self.variation.get(E)


@dataclass(frozen=True, kw_only=True)
class VariedRow(ControllerRow):
    """An episode with another robot than the policy knows.

    Attributes:
        e_max_ratio, e_rms_ratio: Errors over those with the nominal robot [1]; None if there are
            none.
    """

    e_max_ratio: float | None
    e_rms_ratio: float | None


@dataclass(frozen=True, kw_only=True)
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


def controller_cases(quick: bool) -> list[tuple]:
    """Setting, plant, policy, task, width [m] and variation of every episode."""
    every, tasks = policies(), (TASKS[0], _SWING) if quick else TASKS
    rates, nominal = [name for name in every if measures_rates(name)], {}

    def episodes(setting: str, plant: str, tasks: Any, names: Any, variation: Variation) -> list:
        pairs = product(tasks, names)
        return [(setting, plant, name, task, w, variation) for (task, w), name in pairs]

    found = episodes("thesis", PCC, tasks, every, nominal)
    found += episodes("mujoco", MUJOCO, tasks, every, nominal)
    found += episodes("output", MUJOCO, tasks[:1] if quick else tasks, rates, nominal)
    for factor in QUICK_MODULI if quick else MODULI:
        if not quick:
            found += episodes("robustness", PCC, [_SWING], every, {E: factor})
        varied = [_SWING] if quick else tasks
        found += episodes("robustness", MUJOCO, varied, every, {E: factor})
    for variation in () if quick else _VARIATIONS:
        chosen = [name for name in _MEET if name in every]
        found += episodes("robustness", MUJOCO, [_SWING], chosen, variation)
    return found


def measures_rates(policy: str) -> bool:
    """Whether a policy measures curvature rates, so that output feedback changes it."""
    case = runner.Case(make_task("swing"), policy, plant=MUJOCO, feedback="state")
    return "curvature_rate" in case.make_policy(case.environment().control_period).requires


def measure_controller(case: tuple) -> ControllerRow:
    """Run an episode of a setting."""
    setting, plant, policy, task, width, variation = case
    feedback = "output" if setting == "output" else "state"
    outcome = runner.run(
        runner.Case(
            make_task(task, width),
            policy,
            variation=variation,
            plant=plant,
            feedback=feedback,
            duration=_LONG if width is not None and policy in _SLOW else None,
        )
    )
    least, most = motion_errors(outcome.rollout, task)
    compared = policy in COMPARED and (task, width) in _DRAWN and not variation
    varied = policy in VARIED and task == "swing" and set(variation) <= {E}
    return record_of(
        outcome,
        ControllerRow,
        setting=setting,
        feedback=feedback,
        e_motion=most,
        e_motion_least=least,
        trace=_trace(outcome.rollout) if plant == PCC and (compared or varied) else None,
    )


def _trace(rollout: Rollout) -> Rollout:
    """What the figures need of it."""
    shown = rollout.thinned(_SAMPLE).slim("tendon_tension")
    return replace(shown, curvature=rollout.curvature[-1:])


def motion_errors(rollout: Rollout, task: str) -> tuple[float | None, float | None]:
    """Smallest and largest error [m] of the tip between the kinks of the reference.

    None for steps, and after a failure.
    """
    if rollout.failure is not None or task not in MOTION:
        return None, None
    inside = [(rollout.time > begin) & (rollout.time < end) for begin, end in MOTION[task]]
    error = rollout.error[np.any(inside, axis=0)]
    return float(error.min()), float(error.max())


def with_ratios(rows: list[ControllerRow]) -> list[ControllerRow]:
    """The rows, those of varied robots with ratios to the nominal one."""
    return [_with_ratio(rows, row) if row.variation else row for row in rows]


def _with_ratio(rows: list[ControllerRow], row: ControllerRow) -> VariedRow:
    kept = ("plant", "policy", "task", "step_width", "feedback")
    nominal = one(rows, **{name: getattr(row, name) for name in kept}, variation={})
    ratios: dict[str, Any] = {}
    for name in _ERRORS:
        value, base = getattr(row, name), getattr(nominal, name, None)
        ratios[f"{name}_ratio"] = None if value is None or not base else value / base
    return VariedRow(**{f.name: getattr(row, f.name) for f in fields(ControllerRow)}, **ratios)


# ---------------------------------------------------------------- goals

#: Settings in which the accuracy of the best policy is judged.
JUDGED = ("mujoco", "thesis", "output")

#: Goal, task, metric, widths [m] of the step of which the largest value counts, limit in SI units;
#: the steady-state error has to stay below.
GOALS = (
    ("swing, largest error", "swing", "e_max", (None,), 2e-3),
    ("swing, rms error", "swing", "e_rms", (None,), 0.3e-3),
    ("L-shape, largest error", "lshape", "e_max", (None,), 0.8e-3),
    ("step of 50 mm, overshoot", "step", "overshoot", (0.05,), 0.05),
    ("step of 50 mm, settling time", "step", "settling_time", (0.05,), 0.4),
    ("step of 200 mm, overshoot", "step", "overshoot", (0.2,), 0.1),
    ("step of 200 mm, settling time", "step", "settling_time", (0.2,), 1.0),
    ("all steps, steady-state error", "step", "steady_state_error", _WIDTHS, 1e-4),
)

#: Largest error of the best policy with another Young's modulus over that with the nominal one.
_RATIO = 2.0

#: Task, step width [m] and errors whose growth with another Young's modulus is limited.
_GROWTH = (
    ("swing", None, ("e_max", "e_rms")),
    ("lshape", None, ("e_max", "e_rms")),
    *(("step", width, ("e_rms",)) for width in _WIDTHS),
)

#: Largest policy times [s] (median): the thesis' own, and a tenth of it for the MPC.
_POLICY_TIMES = {"qs_nn": 5.4e-6, "lqi": 11.2e-6, "mpc": 5e-3}


def controllers_derived(rows: list[ControllerRow]) -> list[Any]:
    """Ratios, and goals behind the rows."""
    found = with_ratios(rows)
    return [*found, *goal_rows(found)]


def goal_rows(found: list[ControllerRow]) -> list[GoalRow]:
    """Goals and what episodes say about them; those on episodes that were not run are left out."""
    best, out = best_policy(found), []

    def judge(
        goal: str, policy: str, setting: str, metric: str, values: list, limit: float
    ) -> None:
        own = {"goal": goal, "policy": policy, "setting": setting, "metric": metric}
        worst = None if None in values else max(values)
        strict = metric == "steady_state_error"
        out.append(at_most(GoalRow, limit, worst, strict, **own))

    for goal, task, metric, widths, limit in GOALS if best else ():
        for setting in JUDGED:
            fields_ = {"setting": setting, "policy": best, "task": task}
            mine = [one(found, **fields_, step_width=width) for width in widths]
            values = [getattr(row, metric) for row in mine if row is not None]
            if values:
                judge(goal, best, setting, metric, values, limit)
    nominal = select(of_kind(found, VariedRow), plant="mujoco", policy=best, feedback="state")
    varied = [row for row in nominal if list(row.variation) == [E]]
    for task, width, metrics in _GROWTH if varied else ():
        mine = select(varied, task=task, step_width=width)
        label = task if width is None else f"step of {1e3 * width:g} mm"
        for metric in metrics if mine else ():
            goal, ratio = f"{label}, {_ERRORS[metric]} over nominal, worst E", f"{metric}_ratio"
            judge(goal, best, "robustness", ratio, [getattr(r, ratio) for r in mine], _RATIO)
    if varied:
        failed = sum(row.failure is not None for row in varied)
        judge("failed episodes with another E", best, "robustness", "failures", [failed], 0)
    for (policy, limit), setting in product(_POLICY_TIMES.items(), ("mujoco", "thesis")):
        row = one(found, setting=setting, policy=policy, task="step", step_width=0.05)
        if row is not None:
            goal, metric = f"policy time of {policy}", "policy_time_median"
            judge(goal, policy, setting, metric, [row.policy_time_median], limit)
    return out


def best_policy(found: list[ControllerRow]) -> str | None:
    """The policy with the least rms error on MuJoCo's swing; None if there is none."""
    swings = select(found, setting="mujoco", task="swing", failure=None)
    return min(swings, key=lambda row: row.e_rms).policy if swings else None


# ---------------------------------------------------------------- tables beside the thesis

_STEP = ("rise_time", "settling_time", "overshoot", "steady_state_error")
_NUMBERS = {0.05: "6.2", 0.1: "6.3", 0.2: "6.4"}
_PLANTS = {"thesis": "PCC", "mujoco": "MuJoCo"}
_SETTINGS = {**_PLANTS, "output": "MuJoCo, output", "robustness": "MuJoCo, other E"}


def _printed(policy: str, task: str, width: float | None, metric: str) -> tuple[str, str]:
    """The thesis' number and the audit's."""
    controller = CONTROLLERS.get(policy)
    figure = one(FIGURES, task=task, step_width=width, controller=controller)
    thesis = None if figure is None else getattr(figure, metric)
    audit = AUDIT.get((task, width, controller), {}).get(metric)
    bound = "<" * (metric == "e_motion" and thesis is not None)
    return bound + number(thesis, metric), span(audit, metric)


def _pair(rows: Iterable[Any], **values: Any) -> list[Any]:
    """Rows on both plants, None for one that was not run."""
    return [one(rows, setting=setting, **values) for setting in _PLANTS]


def _step_table(rows: Sequence[Any], width: float) -> Table:
    """Tab. 6.2, 6.3 or 6.4: a line per controller and quantity."""
    title = f"Tab. {_NUMBERS[width]}: step of {1e3 * width:g} mm, thesis' controllers"
    out = new_table(title, ("controller", "quantity"), ("thesis", "audit", *_PLANTS.values()))
    found = of_kind(rows, ControllerRow)
    for policy in CONTROLLERS:
        pair = _pair(found, policy=policy, task="step", step_width=width)
        for metric in _STEP if pair != [None, None] else ():
            printed = _printed(policy, "step", width, metric)
            ours = (cell(row, metric) for row in pair)
            out.add_row(policy, QUANTITIES[metric].heading, *printed, *ours)
        out.add_section()
    return out


def _on_plants(row: Any) -> bool:
    return isinstance(row, ControllerRow) and row.setting in _PLANTS


def _both(metric: str) -> Callable:
    return lambda rows: both(_pair(rows), metric)


def _thesis_columns(metric: str, heads: tuple[str, str]) -> dict[str, Callable]:
    def printed(k: int) -> Callable:
        return lambda r: _printed(r[0].policy, r[0].task, r[0].step_width, metric)[k]

    return {head: printed(k) for k, head in enumerate(heads)}


def _tracking(task: str) -> Any:
    metrics = ("e_max", "e_rms", "e_final", "tension_max")
    return pivot(
        f"{task}: tip error in mm and largest tension in N, PCC / MuJoCo",
        ("policy",),
        _thesis_columns("e_max", ("max, thesis", "max, audit"))
        | {QUANTITIES[metric].name: _both(metric) for metric in metrics},
        where=lambda row: _on_plants(row) and row.task == task,
    )


def _motion(setting: str) -> Callable:
    """Smallest and largest error away from the kinks of the reference."""

    def shown(rows: list[ControllerRow]) -> str:
        row = one(rows, setting=setting)
        if row is None or row.e_motion is None:
            return cell(row, "e_motion")
        return span((row.e_motion_least, row.e_motion), "e_motion")

    return shown


_SPANS = "\n".join(
    f"{task}: {' and '.join(f'{a:g} to {b:g} s' for a, b in times)}"
    for task, times in MOTION.items()
)


def _times(setting: str, task: str, width: float | None) -> Callable:
    def shown(rows: list[ControllerRow]) -> str:
        row = one(rows, setting=setting, task=task, step_width=width)
        if row is None:
            return "-"
        timed = ("policy_time_median", "policy_time_p99")
        return " / ".join(number(getattr(row, name), name) for name in timed)

    return shown


def _thesis_time(rows: list[ControllerRow]) -> str:
    return number(POLICY_TIME.get(CONTROLLERS.get(rows[0].policy)), "policy_time_median")


# ---------------------------------------------------------------- tables of other robots, goals


def moduli(rows: Iterable[ControllerRow]) -> list[float]:
    """Factors on Young's modulus that occur, 1 among them, in ascending order."""
    return sorted({1.0} | {row.modulus for row in rows if row.modulus is not None})


def _robustness(rows: Sequence[Any]) -> Iterator[Table]:
    """Errors over Young's modulus on one plant and the other, largest ratios, other parameters."""
    found = select(of_kind(rows, ControllerRow), feedback="state")
    yield _moduli(found, "pcc", *_SWING)
    for place in (*TASKS[3:], *TASKS[:3]):
        yield _moduli(found, "mujoco", *place)
    varied = of_kind(found, VariedRow)
    order = [task_label({"task": task, "step_width": width}) for task, width in TASKS]
    yield from pivot(
        "MuJoCo: largest error with another Young's modulus over the nominal one (max / rms)",
        ("policy",),
        {place: partial(_largest, place) for place in order},
        where=lambda row: row.plant == "mujoco" and list(row.variation) == [E],
    )(varied)
    yield from table(
        "Swing on MuJoCo with another density or damping time (beyond the thesis)",
        "policy",
        Column("variation", lambda row: variation_label(row.row())),
        Column("max mm", lambda row: cell(row, "e_max"), ">"),
        Column("rms mm", lambda row: cell(row, "e_rms"), ">"),
        Column("max over nominal", lambda row: number(row.e_max_ratio, "e_max_ratio"), ">"),
        Column("rms over nominal", lambda row: number(row.e_rms_ratio, "e_rms_ratio"), ">"),
        where={"setting": "robustness", "modulus": None},
    )(varied)


def _moduli(rows: list[ControllerRow], plant: str, task: str, width: float | None) -> Table:
    """A line per policy, a column per factor on Young's modulus, with what the thesis says."""
    metrics, stroke, what = ("e_max", "e_rms"), " / ", "max / rms mm"
    if width is not None:
        metrics, stroke = ("e_rms", "settling_time", "overshoot"), "/"
        what = "rms mm/settling s/over %"
    mine = select(rows, plant=plant, task=task, step_width=width)
    factors = moduli(mine)
    label = task_label({"task": task, "step_width": width})
    title = f"{label} on {'PCC' if plant == PCC else 'MuJoCo'} with another Young's modulus: {what}"
    out = new_table(title, ("policy",), [f"E x {factor:g}" for factor in factors])
    for policy in names(mine) if len(factors) > 1 else ():
        found = [one(mine, policy=policy, modulus=factor) for factor in factors]
        out.add_row(policy, *(cells(row, metrics, stroke) for row in found))
        if plant == PCC and policy in CONTROLLERS:
            said = ROBUSTNESS[CONTROLLERS[policy]]
            out.add_row("  thesis", *(said.get(factor, "-") for factor in factors))
    return out


def _largest(place: str, rows: list[VariedRow]) -> str:
    rows = select(rows, place=place)
    if not rows or any(row.failure is not None for row in rows):
        return "failed" if rows else "-"
    parts = []
    for name in ("e_max_ratio", "e_rms_ratio"):
        known = [getattr(row, name) for row in rows]
        parts.append(number(max((v for v in known if v is not None), default=None), name))
    return " / ".join(parts if rows[0].task != "step" else parts[1:])


def _output(rows: Sequence[Any]) -> Table:
    """Policies that measure rates, with an observer in place of the rates."""
    title = "MuJoCo, tip and curvatures measured, rates observed (in brackets: rates measured)"
    metrics = ("e_max", "e_rms", "settling_time", "overshoot")
    out = new_table(title, ("task", "policy"), ("max mm", "rms mm", "settling s", "over %"))
    found = of_kind(rows, ControllerRow)
    for (place,), mine in groups(select(found, setting="output"), "place").items():
        for row in mine:
            nominal = one(found, setting="mujoco", place=place, policy=row.policy)
            # The largest error of a step is its width.
            shown = metrics[:2] if row.task != "step" else metrics[1:]
            pairs = (f"{cell(row, name)} ({cell(nominal, name)})" for name in metrics)
            texts = (p if n in shown else "" for n, p in zip(metrics, pairs, strict=True))
            out.add_row(place, row.policy, *texts)
        out.add_section()
    return out


def _goals(rows: Sequence[Any]) -> Table:
    title = "Goals: the best policy on MuJoCo in the settings it was run in, then policy times"
    out = new_table(title, ("goal", "policy", "setting"), ("found", "limit", "met"))
    order = {name: place for place, name in enumerate((*JUDGED, "robustness"))}
    timed = "policy_time_median"
    goals = of_kind(rows, GoalRow)
    for row in sorted(goals, key=lambda row: (row.metric == timed, order[row.setting])):
        numbers = (with_unit(value, row.metric) for value in (row.value, row.limit))
        out.add_row(row.goal, row.policy, _SETTINGS[row.setting], *numbers, verdict(row.met))
    return out


def _failed(rows: Sequence[Any]) -> list[Text]:
    return [*map(Text, report.failures([row.row() for row in of_kind(rows, ControllerRow)]))]


# ---------------------------------------------------------------- pictures

#: Colours of factors on Young's modulus: warm where the robot is softer than known.
_MODULI = {0.5: VERMILLION, 0.75: ORANGE, 1.0: GREEN, 1.25: SKY, 1.5: BLUE}

#: [s] of a step response that is shown from near, and as a whole.
_STEP_WINDOWS = (1.0, 5.0)


def _pictures(rows: Sequence[Any]) -> dict[str, Figure]:
    """Figs. 6.14 to 6.22 of the thesis anew, those that there are episodes for."""
    found = of_kind(rows, ControllerRow)
    swing, lshape = (_compared(found, task) for task in ("swing", "lshape"))
    step = _compared(found, "step", 0.05)
    wanted = [
        ("fig_6_14", _step_picture, step, "step of 50 mm, PCC plant"),
        ("fig_6_15", _tracked, swing, "swing, PCC plant"),
        ("fig_6_16", _inputs, swing, "swing, PCC plant"),
        ("fig_6_17", _arms, swing, "the arm at the end of the swing, PCC plant"),
        ("fig_6_18", _plane, lshape, "L-shape, PCC plant"),
        ("fig_6_19", _inputs, lshape, "L-shape, PCC plant"),
    ]
    out = {
        name: draw(curves, f"As Fig. {name[4:].replace('_', '.')}: {text}")
        for name, draw, curves, text in wanted
        if curves
    }
    for policy, name in VARIED.items():
        curves = _varied(found, policy)
        title = "As Figs. 6.20 to 6.22"
        if policy in CONTROLLERS:
            title = f"As Fig. {name[4:].replace('_', '.')}"
        if len(curves) > 1:
            text = f"{title}: swing of {policy} with another Young's modulus, PCC plant"
            out[name] = _tracked(curves, text, _sensitive(curves))
    return out


def _compared(rows: list[ControllerRow], task: str, width: float | None = None) -> list[Curve]:
    mine = select(rows, setting="thesis", task=task, step_width=width)
    return policy_curves({row.policy: row.trace for row in mine if row.policy in COMPARED})


def _varied(rows: list[ControllerRow], policy: str) -> list[Curve]:
    mine = select(rows, plant=PCC, task="swing", policy=policy, feedback="state")
    found = {factor: one(mine, modulus=factor) for factor in moduli(mine)}
    return [
        Curve(variation_label(row.row()) or "nominal E", row.trace, {"color": _MODULI[factor]})
        for factor, row in found.items()
        if row is not None
    ]


def _sensitive(curves: list[Curve]) -> str:
    """A message of the most sensitive case."""
    errors = {curve.name: 1e3 * typical_error(curve.rollout) for curve in curves}
    least, most = (f(errors, key=errors.__getitem__) for f in (min, max))
    text = "failed" if np.isinf(errors[most]) else f"{errors[most]:.3g} mm"
    return f"The rms error goes from {errors[least]:.3g} mm ({least}) to {text} ({most})"


def _step_picture(curves: list[Curve], title: str) -> Figure:
    figure, axes = new_figure(2, 2, (9.5, 6))
    for column, end in enumerate(_STEP_WINDOWS):
        draw_tip(axes[:, column], curves, shown=until(end))
    return finish(figure, axes[0, 0], least_error(curves), title)


def _tracked(curves: list[Curve], title: str, message: str = "") -> Figure:
    figure, axes = new_figure(3, 1, (8, 8))
    draw_tip(axes[:, 0], curves)
    return finish(figure, axes[0, 0], message or least_error(curves), title)


def _inputs(curves: list[Curve], title: str) -> Figure:
    pairs = TendonMap(ARM)
    figure, axes = new_figure(pairs.n_inputs, 1, (8, 7.5))
    labels = [f"$u_{pair + 1}$ [N]" for pair in range(pairs.n_inputs)]
    draw_stacked(axes[:, 0], curves, lambda r: pairs.reduced(r.tendon_tension), labels)
    name, most = most_input(curves, lambda r: pairs.reduced(r.tendon_tension))
    message = f"{name} pulls most, up to {most:.3g} N"
    return finish(figure, axes[0, 0], message, f"{title}; negative: lower tendon")


def _arms(curves: list[Curve], title: str) -> Figure:
    figure, ((left, right),) = new_figure(1, 2, (9.5, 4.6))
    draw_shapes(left, curves, [centerline(ARM, c.rollout.curvature[-1]) for c in curves])
    draw_path(left, [], longest(curves).reference)
    draw_curvatures(right, curves, ARM)
    message = end_errors(curves)
    return finish(figure, left, message[0].upper() + message[1:], title)


def _plane(curves: list[Curve], title: str) -> Figure:
    """Tip and error over time on the left, the path in the plane on the right."""
    figure, axes = new_figure(3, 2, (10, 7.6))
    draw_tip(axes[:, 0], curves)
    grid = axes[0, 1].get_gridspec()
    for axis in axes[:, 1]:
        axis.remove()
    path = figure.add_subplot(grid[:, 1])
    style_axes(path)
    draw_path(path, curves, longest(curves).reference)
    return finish(figure, axes[0, 0], least_error(curves), title)


def _error_against_time(rows: Sequence[Any]) -> Figure | None:
    """Rms and largest error over the median policy time; the thesis gives the largest only."""
    rows = [row for row in rows if _on_plants(row) and row.task == "swing" and not row.failure]
    if not rows:
        return None
    figure, ((left, right),) = new_figure(1, 2, (10, 5.2))
    for axis, (metric, text) in zip((left, right), reversed(_ERRORS.items()), strict=True):
        for row in rows:
            axis.plot(*_point(row, metric), **_marker(style_of(row.policy).colour, row.setting))
        axis.set(xscale="log", yscale="log", ylabel=f"{text} on the swing [mm]")
        axis.set_xlabel("policy time per decision, median [µs]")
    of_controller = {controller: policy for policy, controller in CONTROLLERS.items()}
    for printed in select(FIGURES, task="swing"):
        colour = style_of(of_controller[printed.controller]).colour
        place = 1e6 * POLICY_TIME[printed.controller], 1e3 * printed.e_max
        right.plot(*place, **THESIS | {"color": colour, "markeredgecolor": "black"})
    labels = {"mujoco": "MuJoCo", "thesis": "PCC plant"}
    told = [entry(label, **_marker(GREY, setting)) for setting, label in labels.items()]
    best = min(select(rows, setting="mujoco") or rows, key=lambda row: row.e_rms)
    add_title(
        figure,
        f"{best.policy} errs least on the swing, {1e3 * best.e_rms:.2g} mm rms for "
        f"{float(f'{1e6 * best.policy_time_median:.2g}'):g} µs a decision",
        "All policies: error against the time of a decision",
    )
    label = "thesis (colour: its controller)"
    add_legend(figure, [*told, entry(**THESIS | {"label": label, "color": GREY})])
    for axis, metric in zip((left, right), reversed(_ERRORS), strict=True):
        label_points(axis, [_labelled(rows, name, metric) for name in names(rows)])
    return figure


def _point(row: ControllerRow, metric: str) -> tuple[float, float]:
    return 1e6 * row.policy_time_median, 1e3 * getattr(row, metric)


def _labelled(rows: list[ControllerRow], policy: str, metric: str) -> tuple:
    """Name, places [µs, mm] and colour of a policy's points."""
    places = [_point(row, metric) for row in select(rows, policy=policy)]
    return policy, places, style_of(policy).colour


def _marker(colour: str, setting: str) -> dict[str, str | float]:
    face = colour if setting == "mujoco" else "white"
    style = {"marker": "o", "linestyle": "none", "markersize": 7}
    return {"color": colour, "markerfacecolor": face, **style}


_STEP_COLUMNS = (*_STEP, "e_rms", "tension_max")

CONTROLLER_STUDY = Study(
    kinds=(ControllerRow, GoalRow),
    cases=controller_cases,
    measure=measure_controller,
    label=lambda case: ", ".join(str(part) for part in case if part),
    derive=controllers_derived,
    alone=True,
    tables=[
        *(partial(_step_table, width=width) for width in _NUMBERS),
        pivot(
            "Steps, all policies: PCC / MuJoCo",
            ("step_width", "policy"),
            {QUANTITIES[metric].heading: _both(metric) for metric in _STEP_COLUMNS},
            where=lambda row: _on_plants(row) and row.task == "step",
            headings=("step", "policy"),
            show=lambda value: value if isinstance(value, str) else f"{1e3 * value:g} mm",
            sections=True,
        ),
        *(_tracking(task) for task in MOTION),
        pivot(
            f"Smallest to largest error in mm away from the reference's kinks\n{_SPANS}",
            ("task", "policy"),
            _thesis_columns("e_motion", ("thesis", "audit"))
            | {name: _motion(setting) for setting, name in _PLANTS.items()},
            where=lambda row: _on_plants(row) and row.task in MOTION,
            sections=True,
        ),
        pivot(
            "Tab. 6.5: policy time per decision in µs, median / 99th percentile",
            ("policy",),
            {
                "decides\nevery ms": lambda rows: f"{1e3 * rows[0].decision_period:g}",
                "thesis": _thesis_time,
                "PCC\nstep 50 mm": _times("thesis", "step", 0.05),
                "MuJoCo\nstep 50 mm": _times("mujoco", "step", 0.05),
                "MuJoCo\nswing": _times("mujoco", "swing", None),
            },
            where=_on_plants,
        ),
        _robustness,
        _output,
        _goals,
        _failed,
    ],
    plots={"{}": _pictures, "error_against_time": _error_against_time},
)

# ---------------------------------------------------------------- unseen paths, unknown robots

#: Largest speeds [m/s] of the references that no policy has met.
SPEEDS = {
    "circle": (0.05, 0.1, 0.2, 0.4),
    "figure_eight": (0.05, 0.1, 0.2, 0.4),
    "random": (0.1, 0.2, 0.4),
}
SEEDS = (0, 1, 2, 3, 4)

#: Task and step width [m] of the disturbed robots.
DISTURBED_TASKS = (_SWING, ("lshape", None), ("step", 0.05))

#: Duration [s] of a step, in which the slow policies settle too.
STEP_DURATION = 10.0

#: What the reset option `vary` gets, in the groups of the tables. A tendon radius acts as a tension
#: gain does on the lever arms of channels, and is left out.
PARAMETERS: tuple[Variation, ...] = (*({E: factor} for factor in MODULI), *_VARIATIONS)
DISTURBANCES: tuple[Variation, ...] = (
    {"tension_gain": 0.9},
    {"tension_gain": 1.1},
    {"tendon_friction": 0.5},
    {"tendon_friction": 1.0},
    {"delay": 0.01},
    {"delay": 0.02},
    {"sensor_noise": 1.0},
    {"sensor_noise": 3.0},
)
NOMINAL: Variation = {}

_QUICK_SPEED, _QUICK_SEEDS = 0.2, (0, 1)
_QUICK_VARIATIONS: dict[str, tuple[Variation, ...]] = {
    "swing": (NOMINAL, {E: 0.5}),
    "step": (NOMINAL, {"delay": 0.02}),
}


@dataclass(frozen=True, kw_only=True)
class GeneralRow(PolicyRow):
    """An episode.

    Attributes:
        part: "unseen", paths that no policy has met, or "disturbed", the thesis' tasks on robots
            that no policy knows.
        speed: [m/s], the largest of an unseen reference.
        path_seed: Of a random path.
        seed: Of the episode.
    """

    part: str
    speed: float | None
    path_seed: int | None
    seed: int = 0

    @property
    def heading(self) -> str:
        """What differs between the columns of a table."""
        if self.part == "unseen":
            return f"{_SHORT[self.task]}\n{self.speed:g} m/s"
        return variation_name(self.variation).replace(" ", "\n", 1)


_SHORT = {"circle": "circle", "figure_eight": "eight", "random": "random"}


def variation_name(variation: Variation) -> str:
    """A variation for people."""
    return variation_label({"variation": variation}) or "nominal"


def general_cases(quick: bool) -> list[tuple]:
    """Policy, task, and speed and seed of a path, or step width and variation."""
    every = [name for name in policies() if name in installed_policies()]
    found: list[tuple] = []
    for task, speeds in SPEEDS.items():
        seeds = (None,) if task != "random" else _QUICK_SEEDS if quick else SEEDS
        paths = product((_QUICK_SPEED,) if quick else speeds, seeds)
        found += [(name, task, *path) for path in paths for name in every]
    for task, width in DISTURBED_TASKS:
        variations = (NOMINAL, *PARAMETERS, *DISTURBANCES)
        for variation in _QUICK_VARIATIONS.get(task, ()) if quick else variations:
            found += [(name, task, width, variation) for name in every]
    return found


def measure_general(case: tuple) -> GeneralRow:
    """Run an episode."""
    policy, task, first, second = case
    if task in SPEEDS:
        options = {"speed": first} | ({} if second is None else {"seed": second})
        wanted = runner.Case(make_task(task, **options), policy)
        own = {"part": "unseen", "speed": first, "path_seed": second}
    else:
        duration = None if first is None else STEP_DURATION
        wanted = runner.Case(make_task(task, first), policy, second, duration=duration)
        own = {"part": "disturbed", "speed": None, "path_seed": None}
    return record_of(runner.run(wanted), GeneralRow, **own)


_STEP_METRICS = {"overshoot": "overshoot in %", "settling_time": "settling time in s"}
_MM = {metric: f"{text} in mm" for metric, text in _ERRORS.items()}
_GROUPS = {
    "a robot of other parameters": (NOMINAL, *PARAMETERS),
    "disturbed drives and sensors": (NOMINAL, *DISTURBANCES),
}


def _general_tables(rows: list[GeneralRow]) -> Iterator[Table]:
    for metric, text in _MM.items():
        yield from pivot(
            f"Unseen references: {text}",
            ("policy",),
            "heading",
            partial(_general_cell, metric),
            where=lambda row: row.part == "unseen" and row.task != "random",
        )(rows)
    columns = {
        f"{name}\n{speed:g} m/s": lambda rows, m=m, v=speed: _general_cell(m, select(rows, speed=v))
        for m, name in (("e_max", "max"), ("e_rms", "rms"))
        for speed in SPEEDS["random"]
    }
    title = "Random paths: median / worst of the seeds, errors in mm"
    yield from pivot(title, ("policy",), columns, where={"task": "random"})(rows)
    for task, width in DISTURBED_TASKS:
        title = {"swing": "Swing", "lshape": "L-shape", "step": "Step of 50 mm"}[task]
        for metric, text in (_MM if width is None else _STEP_METRICS).items():
            for group, variations in _GROUPS.items():
                mine = [r for r in select(rows, task=task) if r.variation in variations]
                if any(row.variation for row in mine):
                    name = f"{title} on {group}: {text}"
                    shown = partial(_general_cell, metric)
                    yield from pivot(name, ("policy",), "heading", shown)(mine)


def _general_cell(metric: str, rows: Sequence[GeneralRow]) -> str:
    """A value, or median and worst of several seeds; how many failed if any did."""
    if len(rows) <= 1:
        return cell(rows[0] if rows else None, metric)
    failed = sum(row.failure is not None for row in rows)
    if failed:
        return f"{failed} of {len(rows)} failed"
    values = [getattr(row, metric) for row in rows]
    return f"{number(median(values), metric)} / {number(max(values), metric)}"


# ---------------------------------------------------------------- error against speed

#: Policies in the figure, those that err least; the tables have all.
_MOST = 6

_PATH_TITLES = {
    "circle": "circle of 40 mm",
    "figure_eight": "figure eight, 200 x 60 mm",
    "random": "random paths, bars to the worst",
}


def _speeds(rows: Sequence[Any]) -> Figure | None:
    rows = select(rows, part="unseen")
    if not rows:
        return None
    figure, axes = new_figure(len(_ERRORS), len(SPEEDS), (10.5, 7.2))
    every, best = names(rows), _ranked(rows)[:_MOST]
    for row_of_axes, (metric, text) in zip(axes, _ERRORS.items(), strict=True):
        for axis, speeds in zip(row_of_axes, SPEEDS.values(), strict=True):
            if axis is not row_of_axes[0]:
                axis.sharey(row_of_axes[0])
            axis.set(xscale="log", yscale="log", xlim=(speeds[0] / 1.2, speeds[-1] * 1.2))
            axis.set_xticks(speeds, [f"{speed:g}" for speed in speeds])
            axis.set_xticks([], minor=True)
        ends: list = []
        for axis, task in zip(row_of_axes, SPEEDS, strict=True):
            found = [_line(axis, select(rows, task=task, policy=name), metric) for name in best]
            ends = [end for end in found if end is not None]
        label_lines(row_of_axes[-1], ends)
        row_of_axes[0].set_ylabel(f"{text} [mm]")
    for above, below, task in zip(axes[0], axes[-1], SPEEDS, strict=True):
        above.set_title(_PATH_TITLES[task], fontsize=10)
        below.set_xlabel("speed of the reference [m/s]")
    errors = [row.e_max for row in select(rows, policy=best[0]) if row.failure is None]
    message = "On paths that no policy has met all failed"
    if errors:
        message = f"On paths that no policy has met {best[0]} errs least, by "
        message += f"{1e3 * max(errors):.2g} mm at most"
    some = f"The {len(best)} of {len(every)} policies that err least"
    add_title(figure, message, f"{some}; crosses at the top: failed")
    return figure


def _ranked(rows: list[GeneralRow]) -> list[str]:
    """Policies, first without failures, then by the median of their errors."""
    order = {}
    for (policy,), mine in groups(rows, "policy").items():
        errors = [row.e_max for row in mine if row.failure is None]
        order[policy] = len(mine) - len(errors), median(errors or [np.inf])
    return sorted(order, key=order.__getitem__)


def _line(axis: Axes, rows: list[GeneralRow], metric: str) -> tuple[str, float, str] | None:
    """Median over the seeds at each speed, with a bar to the worst; a cross where any failed.

    Returns the name, height and colour of its right end.
    """
    if not rows:
        return None
    policy, style = rows[0].policy, style_of(rows[0].policy)
    speeds = sorted({row.speed for row in rows})
    values = [_values(select(rows, speed=speed), metric) for speed in speeds]
    middle = np.array([median(v) if v else np.nan for v in values])
    worst = np.array([max(v, default=np.nan) for v in values])
    bars = [np.zeros(len(speeds)), worst - middle]
    line = {"markersize": 5, "capsize": 2, "linewidth": 1.2, "elinewidth": 0.7}
    axis.errorbar(speeds, middle, bars, label=policy, **(style.curve | style.points), **line)
    for speed in (s for s, v in zip(speeds, values, strict=True) if not v):
        axis.plot(speed, 0.99, "x", color=style.colour, transform=axis.get_xaxis_transform())
    known = [median(v) for v in values if v]
    return (policy, known[-1], style.colour) if known else None


def _values(rows: list[GeneralRow], metric: str) -> list[float]:
    """Errors [mm]; none if any run failed."""
    if any(row.failure is not None for row in rows):
        return []
    return [1e3 * getattr(row, metric) for row in rows]


# ---------------------------------------------------------------- map of disturbed robots

#: Panels of the map: task -> metric, title, factor from SI, smallest and largest of the colours.
_PANELS: Mapping[str, tuple[str, str, float, tuple[float, float]]] = {
    "swing": ("e_max", "swing, largest error [mm]", 1e3, (0.3, 300.0)),
    "lshape": ("e_max", "L-shape, largest error [mm]", 1e3, (0.3, 300.0)),
    "step": ("overshoot", "step of 50 mm, overshoot [%]", 1e2, (1.0, 100.0)),
}


def _map(rows: Sequence[Any]) -> Figure | None:
    rows = select(rows, part="disturbed")
    if not rows:
        return None
    tasks = groups(rows, "task")
    variations = len(groups(rows, "heading"))
    figure, axes = new_figure(len(tasks), 1, (1.6 + 0.58 * variations, 1.3 + 3.0 * len(tasks)))
    for axis, ((task,), mine) in zip(axes.flat, tasks.items(), strict=True):
        metric, title, factor, colours = _PANELS[task]

        def shown(policy: str, heading: str, mine: list = mine, m: str = metric, f: float = factor):  # noqa: ANN202
            row = one(mine, policy=policy, heading=heading)
            value = None if row is None else getattr(row, m)
            if value is None:
                return None, "-" if row is None or row.failure is None else "failed"
            digits = sum(f * value < size for size in (1.0, 10.0))
            return f * value, f"{f * value:.{digits}f}"

        headings = [heading for (heading,) in groups(mine, "heading")]
        maps(axis, names(mine), headings, shown, colours)
        axis.set_title(title, fontsize=10, loc="left")
    worst = {policy: _worst(select(rows, policy=policy)) for policy in names(rows)}
    least = min(worst, key=worst.__getitem__)
    add_title(
        figure,
        f"On disturbed robots {least} errs least in its worst case, {1e3 * worst[least]:.2g} mm on "
        "swing and L-shape",
        "Robots, drives and sensors that no policy knows: light errs little, dark much",
    )
    return figure


def _worst(rows: list[GeneralRow]) -> float:
    """Largest error [m] over swing and L-shape; infinite if it failed anywhere."""
    mine = [row for row in rows if row.task != "step"]
    if not mine or any(row.failure is not None for row in mine):
        return np.inf
    return max(row.e_max for row in mine)


GENERALIZATION = Study(
    kinds=(GeneralRow,),
    cases=general_cases,
    measure=measure_general,
    label=lambda case: ", ".join(str(part) for part in case if part),
    tables=[
        _general_tables,
        table(
            "Failed",
            "policy",
            Column("task", lambda row: task_label(row.row())),
            Column("variation", lambda row: variation_name(row.variation)),
            "failure",
            where=lambda row: row.failure is not None,
        ),
    ],
    note="Episodes start at rest under the inputs that hold the arm's closed statics on the "
    "reference. The chain's tip is then some tenths of a millimetre off, 0.32 mm in the unseen "
    "tasks, which bounds the largest error from below. An overshoot has no value, and a dash, "
    "where the tip did not come nearer to the target in the end. Policy times in the report are "
    "those of cores that are all busy.",
    plots={"{}": _speeds, "{}_disturbed": _map},
)
