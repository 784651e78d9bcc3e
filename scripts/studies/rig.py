"""Policies of the rig on its twins: triangles (thesis sec. 5.4), disturbed circles (sec. 6.1)."""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from statistics import median
from typing import Any

import numpy as np
from rich.table import Table
from scipy.linalg import expm
from scipy.optimize import brentq, minimize_scalar

from softrobot_env.control.feedforward.statics import ChainStatics
from softrobot_env.control.registry import RIG_POLICIES, make_policy
from softrobot_env.control.sensed import Sensed
from softrobot_env.evaluation.metrics import approached_metrics
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.rendering import curves, figures
from softrobot_env.rendering.curves import Curve
from softrobot_env.rendering.figures import REFERENCE, Figure, new_figure, style_of
from softrobot_env.robots import EQUIVALENT_RIG, LENGTH_SCALE, RIG
from softrobot_env.robots.twin import Twin, rig3d_twin, twin_or_ideal
from softrobot_env.sensing.reconstruction import Reconstruction
from softrobot_env.tasks import Task, make_task
from softrobot_env.thesis.envs import RigEnv
from softrobot_env.thesis.figures import TRIANGLE
from softrobot_env.thesis.rig.parameters import (
    IdentifiedParameters,
    identified,
    parameters_of,
    record,
)
from softrobot_env.thesis.rig.servo_constraints import ServoConstraints
from softrobot_env.thesis.trajectories import LapCircle
from softrobot_env.training.sensors import calibrated
from studies import lab
from studies.thesis import Row as ForceRow
from studies.truths.rig_piece import plan

# ---------------------------------------------------------------- triangles

#: Periods [s] of a lap, Tabs. 5.2 and 5.3.
SLOW, FAST = 5.0, 1.0

#: Twins of the tables, whose medians are judged; the twin of the figures, whose networks come with
#: the package.
TWINS, SHOWN = (0, 1, 2, 3, 4), 0

_POINTS, _QUICK_POINTS = 61, 16  # of Fig. 5.14


@dataclass(frozen=True)
class TriangleRow(lab.Record):
    """Laps of the triangle.

    Attributes:
        twin: Seed of the twin; None for the rig without errors.
        period: [s] of a lap.
        policy: One of `RIG_POLICIES`.
        e_mean, e_max: [m], after the approach; None where the episode failed.
        failure: What went wrong, or None.
        limited: Share of the decisions that could not be the ones wanted [1].
        policy_time_median, policy_time_p99, policy_time_max: [s] per decision.
        computing_factor: Time of the motion over that of computing its inputs [1].
        realtime_factor: The same over that of the whole simulation.
        trace: The episode after its approach, which ends at time zero.
    """

    twin: int | None
    period: float
    policy: str
    e_mean: float | None
    e_max: float | None
    failure: str | None
    limited: float = lab.quantity("%", ".1f")
    policy_time_median: float = lab.quantity("µs", ".0f", "decision")
    policy_time_p99: float = lab.quantity("µs", ".0f", "99 %")
    policy_time_max: float = lab.quantity("µs", ".0f", "longest")
    computing_factor: float = lab.quantity("x", ".0f", "inputs")
    realtime_factor: float = lab.quantity("x", ".0f", "simulation")
    trace: Rollout | None = lab.for_pictures()


def triangles(quick: bool) -> list[Any]:
    """Rig, period and policy of each episode, then points of Fig. 5.14.

    Each twin is visited first, and its networks are trained with its own seed, as for the rig
    without errors; a quick run has twin 0 alone, with what comes with the package.
    """
    twins = (SHOWN,) if quick else (None, *TWINS)
    every = [(quick, *case) for case in product(twins, (SLOW, FAST), RIG_POLICIES)]
    return [*every, _QUICK_POINTS if quick else _POINTS]


def measure_triangle(case: Any) -> Any:
    """Rows of an episode, or of Fig. 5.14."""
    if isinstance(case, int):
        return force_rows(case)
    shipped, twin, period, policy = case
    task = make_task("triangle", period=period)
    rollout = run(Case(task, policy, twin=twin, identified=_identified(twin, shipped))).rollout
    errors = approached_metrics(rollout, task.trajectory)
    times, duration = rollout.policy_time, float(rollout.time[-1])
    return TriangleRow(
        twin=twin,
        period=period,
        policy=policy,
        e_mean=errors.e_mean_tracking,
        e_max=errors.e_max_tracking,
        failure=rollout.failure,
        limited=float(np.mean(rollout.policy_status != "")),
        policy_time_median=float(np.median(times)),
        policy_time_p99=float(np.percentile(times, 99)),
        policy_time_max=float(times.max()),
        computing_factor=duration / float(times.sum()),
        realtime_factor=duration / rollout.wall_time,
        trace=_after_approach(rollout, task.trajectory.approach) if twin == SHOWN else None,
    )


@cache
def _identified(twin: int | None, shipped: bool) -> IdentifiedParameters:
    if shipped:
        return IdentifiedParameters.load(RIG)
    # Another seed for each, so that what differs between twins includes the training.
    return parameters_of(identified(record(twin_or_ideal(twin)), seed=twin or 0), twin)


def _after_approach(rollout: Rollout, approach: float) -> Rollout:
    """The record after its approach [s], with times from its end on."""
    begin = int(np.searchsorted(rollout.time, approach, "right"))
    laps = rollout.slim("action").part(slice(begin, None))
    return replace(laps, time=laps.time - laps.time[:1])


# ---------------------------------------------------------------- tendon forces, Fig. 5.14

#: Radius [m] of the circle and angular velocities [1/s] of the figure.
RADIUS = 0.09
SLOWEST, FASTEST = 0.015, 63.0

_INSTANTS = 60  # per lap

#: Angular velocity [1/s] of the least force in the thesis, and of the balance of stiffness and
#: centripetal moment with its printed parameters (audit).
_THESIS, _AUDIT = 2.8, 8.6


def effective_force(servo: ServoConstraints, radius: float, omega: float) -> tuple[float, float]:
    """Mean magnitude [N] and phase [rad] of the effective tendon force (5.42) on a circle.

    Args:
        servo: Inverse model of the rig.
        radius: [m].
        omega: Angular velocity [1/s] of the steady motion.

    Returns:
        Magnitude, and how far the force is ahead of the output, from -pi to pi.

    Raises:
        OutOfReachError: The radius is out of reach.
    """
    angle = 2 * np.pi * np.arange(_INSTANTS) / _INSTANTS
    z = radius * np.exp(1j * angle)
    motion = (np.column_stack([x.real, x.imag]) for x in (z, 1j * omega * z, -(omega**2) * z))
    tension = plan(servo, *motion).tension
    force = tension @ np.exp(2j * np.pi * np.arange(3) / 3)
    return float(np.mean(np.abs(force))), float(np.angle(np.sum(force * np.conj(z))))


def least_force(servo: ServoConstraints, radius: float = RADIUS) -> float:
    """Angular velocity [1/s] of the least mean effective force on a circle."""
    found = minimize_scalar(
        lambda x: effective_force(servo, radius, np.exp(x))[0],
        bounds=np.log([SLOWEST, FASTEST]),
        method="bounded",
        options={"xatol": 1e-8},
    )
    return float(np.exp(found.x))


def balance(servo: ServoConstraints, radius: float = RADIUS) -> float:
    """Angular velocity [1/s] at which only damping is left, a quarter turn ahead of the output."""

    def ahead(x: float) -> float:
        return effective_force(servo, radius, np.exp(x))[1] - np.pi / 2

    return float(np.exp(brentq(ahead, *np.log([SLOWEST, FASTEST]), xtol=1e-10)))


def force_rows(count: int) -> list[ForceRow]:
    """Rows of Fig. 5.14: force and phase over so many speeds, least force and balance."""
    servo, what = ServoConstraints(RIG), (f"circle of {1e3 * RADIUS:g} mm", "pcc", 1)
    rows = []
    for omega in np.geomspace(SLOWEST, FASTEST, count):
        force, phase = effective_force(servo, RADIUS, omega)
        x = ("omega_rad_s", omega)
        rows.append(ForceRow("5.14a", *what, "effective_force_N", force, *x))
        rows.append(ForceRow("5.14b", *what, "phase_rad", phase, *x))
    note = "damping puts it below the balance; 2.8 does not follow from the printed parameters"
    least, name = least_force(servo), "omega_of_least_force_rad_s"
    rows.append(ForceRow("5.14a", *what, name, least, thesis=_THESIS, note=note))
    even, name = balance(servo), "omega_of_balance_rad_s"
    rows.append(ForceRow("5.14b", *what, name, even, audit=_AUDIT))
    return rows


# ---------------------------------------------------------------- tables of the triangles


def rig_name(row: Any) -> str:
    """The rig of a row for people."""
    return "without errors" if row.twin is None else f"twin {row.twin}"


def _over_twins(name: str) -> Callable[[list[TriangleRow]], str]:
    """Of all twins, by a field of their rows."""

    def said(rows: list[TriangleRow]) -> str:
        values = [getattr(row, name) for row in rows if row.twin is not None]
        return "failed" if None in values else lab.spread(values, ".1f", "mm")

    return said


def _both(pair: Sequence[float | None] | None) -> str:
    return "-" if pair is None else " / ".join(lab.number(value, ".1f", "mm") for value in pair)


def _ideal(rows: list[TriangleRow]) -> str:
    row = lab.one(rows, twin=None)
    return _both(None if row is None else (row.e_mean, row.e_max))


# ---------------------------------------------------------------- pictures of the triangles

#: Name of the figure -> title, period and policies of its paths.
_PATHS = {
    "fig_5_10": ("As Fig. 5.10", SLOW, ("rig_nn", "inverse_dynamics", "hybrid")),
    "fig_5_11": ("As Fig. 5.11", FAST, ("rig_nn",)),
    "fig_5_12": ("As Fig. 5.12", FAST, ("inverse_dynamics", "hybrid")),
    "beyond": ("Beyond the thesis", FAST, ("hybrid", "hybrid_flexible", "hybrid_calibrated")),
}


def _pictures(rows: list[Any]) -> dict[str, Figure]:
    laps = [row for row in lab.of_kind(rows, TriangleRow) if row.trace is not None]
    traces, out = {(row.policy, row.period): row.trace for row in laps}, {}
    for name, (title, period, policies) in _PATHS.items():
        mine = {p: traces[p, period] for p in policies if (p, period) in traces}
        if mine:
            out[name] = _tracking(mine, f"{title}: triangle, a lap in {period:g} s")
    pair = [traces.get((name, FAST)) for name in ("rig_nn", "hybrid")]
    if None not in pair:
        out["fig_5_13"] = _parts(*pair)
    forces = lab.of_kind(rows, ForceRow)
    return out | ({"fig_5_14": _forces(forces)} if forces else {})


def _tracking(traces: dict[str, Rollout], title: str) -> Figure:
    """Paths on the left, errors over time on the right."""
    figure, ((left, right),) = new_figure(1, 2, (9.5, 4.8))
    drawn = curves.policy_curves(traces)
    whole = curves.longest(drawn)
    # Two of the seven laps; the dashes of several would fill each other.
    two = whole.reference[whole.time <= whole.time[-1] * 2 / 7]
    curves.draw_path(left, drawn, two, "xy")
    curves.draw(right, drawn, lambda rollout: 1e3 * rollout.error)
    right.set(xlabel="time after the approach [s]", ylabel="error [mm]")
    right.set_ylim(bottom=0)
    return figures.finish(figure, left, curves.least_error(drawn), title)


def _parts(network: Rollout, hybrid: Rollout) -> Figure:
    """Both parts of the first tendon's length: what the hybrid adds is the dynamic one."""
    figure, ((axis,),) = new_figure(1, 1, (9.0, 4.2))
    quasi_static, both = (1e3 * LENGTH_SCALE * r.action[:, 0] for r in (network, hybrid))
    for label, values, policy in (
        ("quasi-static part: network", quasi_static, "rig_nn"),
        ("dynamic part: inverse dynamics", both - quasi_static, "inverse_dynamics"),
        ("hybrid", both, "hybrid"),
    ):
        axis.plot(network.time, values, **style_of(policy).curve, linewidth=1.2, label=label)
    axis.set(xlabel="time after the approach [s]", ylabel="length pulled in, $s_1$ [mm]")
    part, whole = np.ptp(both - quasi_static), np.ptp(both)
    message = (
        f"The dynamic part moves by {part:.2g} mm, the hybrid's whole length by {whole:.2g} mm"
    )
    subject = f"As Fig. 5.13: length of tendon 1, triangle, a lap in {FAST:g} s"
    return figures.finish(figure, axis, message, subject)


def _forces(rows: list[ForceRow]) -> Figure:
    """Effective tendon force and its phase over the angular velocity."""
    figure, axes = new_figure(2, 1, (7.5, 5.6))
    marked = "effective_force_N", "phase_rad", "omega_of_least_force_rad_s"
    force, phase, (least,) = (lab.select(rows, y_name=name) for name in marked)
    (even,) = lab.select(rows, y_name="omega_of_balance_rad_s")
    top, bottom = axes[:, 0]
    for axis, mine, factor, mark, what in (
        (top, force, 1.0, least.y, "least force"),
        (bottom, phase, 180 / np.pi, even.y, "stiffness and inertia in balance"),
    ):
        points = [row.x for row in mine], [factor * row.y for row in mine]
        axis.plot(*points, **style_of("inverse_dynamics").curve)
        axis.set_xscale("log")
        axis.axvline(mark, **REFERENCE | {"color": "0.4", "label": None})
        text = {"ha": "right", "fontsize": 9, "color": "0.4", "textcoords": "offset points"}
        place = {"xycoords": ("data", "axes fraction"), "xytext": (-5, 0)}
        axis.annotate(f"{what}: {mark:.2g} rad/s", (mark, 0.9), **place, **text)
    top.set(yscale="log", ylabel="effective force [N]")
    bottom.set(xlabel="angular velocity [rad/s]", ylabel="ahead of the output [deg]")
    bottom.set_yticks([0, 45, 90, 135, 180])
    small = min(row.y for row in force)
    message = f"A circle takes the least force, {small:.2g} N, at {least.y:.2g} rad/s"
    figures.add_title(figure, message, "As Fig. 5.14: circle of 90 mm")
    return figure


RIG_STUDY = lab.Study(
    kinds=(TriangleRow, ForceRow),
    cases=triangles,
    measure=measure_triangle,
    alone=True,
    tables=[
        lab.pivot(
            "Triangle, T = {period} s (Tabs. 5.2 and 5.3), mean / largest error in mm\n"
            "after the approach; twins: median (range)",
            ("policy",),
            {
                "thesis": lambda rows: _both(TRIANGLE.get((rows[0].policy, rows[0].period))),
                "no errors": _ideal,
                "twins, mean": _over_twins("e_mean"),
                "twins, largest": _over_twins("e_max"),
            },
            of=TriangleRow,
            per=("period",),
        ),
        lab.pivot(
            "Computing: time per decision, median of the episodes (least to largest)",
            ("policy",),
            ("policy_time_median", "policy_time_p99", "policy_time_max"),
            of=TriangleRow,
        ),
        lab.pivot(
            "Inputs alone and simulation in times real time, share of limited decisions: the same",
            ("policy",),
            ("computing_factor", "realtime_factor", "limited"),
            of=TriangleRow,
        ),
        lab.table(
            "Fig. 5.14: circle of 90 mm, angular velocity in rad/s (audit: docs/thesis_audit.md)",
            lab.Column("what", lambda row: row.y_name.removesuffix("_rad_s").replace("_", " ")),
            lab.Column("found", "y", ".3g"),
            lab.Column("thesis", form="g"),
            lab.Column("audit", form="g"),
            of=ForceRow,
            where=lambda row: row.x is None,
        ),
        lab.failures(lab.Column("rig", rig_name), "period", "policy", of=TriangleRow),
    ],
    plots={"{}": _pictures},
)

# ---------------------------------------------------------------- disturbed circles

#: [s], how late the tip is seen: camera, link and servos (80 to 120 ms, inferred).
LATE = 0.1

#: Servo offsets [m] of the first tendon. The thesis names 2 mm; what its feedforward errs by takes
#: about 7 on a rig of its stiffness (audit).
_OFFSETS = {"offset 2 mm": 2e-3, "offset 7 mm": 7e-3}

#: [kg] at the head. The thesis does not tell its weight. With 26 g its PI loop errs here as is
#: printed (twin 0, whose parameters it knows); no weight gives all three printed errors at once.
_WEIGHTS = {"weight 26 g": 0.026, "weight 40 g": 0.04}

#: Names of all disturbances, "" for none.
DISTURBANCES = ("", *_OFFSETS, *_WEIGHTS)

#: Policies of sec. 6.1, and ours; those that feed the tip back.
THESIS, OURS = ("rig_nn", "rig_nn_p", "rig_nn_pi"), ("hybrid_calibrated", "hybrid_feedback")
_FED_BACK = ("rig_nn_pi", "hybrid_feedback")

#: Names of the paths, and what sees the tip.
LAP, LAPS = "a lap at 50 mm/s", "laps of 1 s"
CAMERA, SENSOR = "camera", "curvature sensor"

#: Seeds of the disturbed twins; networks and parameters that policies know are those of the first.
#: How fast feedback learns was chosen without the others.
DISTURBED = (0, 4, 5)

#: The thesis' RMS errors [m] by policy, of the first offset and of its weight.
PRINTED = {
    ("rig_nn", "offset 2 mm"): 31.3e-3,
    ("rig_nn_p", "offset 2 mm"): 26.9e-3,
    ("rig_nn_pi", "offset 2 mm"): 3.1e-3,
    ("rig_nn", "weight 26 g"): 39.2e-3,
    ("rig_nn_p", "weight 26 g"): 30.6e-3,
    ("rig_nn_pi", "weight 26 g"): 7.9e-3,
}

_SAMPLE = 0.02  # s, of a trace

#: Laps of a second: [m], laps, and [s] to speed up and to slow down.
_FAST = {"radius": 0.12, "speed": 2 * np.pi * 0.12, "laps": 6, "ramp": 2.0}


@dataclass(frozen=True)
class CircleRow(lab.Record):
    """A circle.

    Attributes:
        path: `LAP`, the thesis', or `LAPS`.
        seen_by: `CAMERA` or `SENSOR`, what tells the policy of the tip, late.
        policy: Its name.
        twin: Seed of the twin.
        disturbance: One of `DISTURBANCES`.
        rms, mean, largest: Error [m] of the tip over the lap, or the laps at full speed; None where
            the episode failed.
        last: RMS error [m] of the last lap at full speed, when policies that learn have learned.
        thesis: The RMS error [m] that the thesis prints, or None.
        failure: What went wrong, or None.
        trace: The episode, if a picture shows it.
    """

    path: str
    seen_by: str
    policy: str
    twin: int
    disturbance: str
    rms: float | None
    mean: float | None
    largest: float | None
    last: float | None
    thesis: float | None
    failure: str | None
    trace: Rollout | None = lab.for_pictures()


def circles(quick: bool) -> list[Any]:
    """Path, sensor, policy, twin and disturbance of each circle, and None for the gains."""
    twins = DISTURBED[:1] if quick else DISTURBED
    known = (THESIS[-1], OURS[-1]) if quick else THESIS + OURS
    what = DISTURBANCES[1:2] if quick else DISTURBANCES
    found = [*product((LAP,), (CAMERA,), known, twins, what)]
    found += product((LAP,), (SENSOR,), _FED_BACK, twins, what)
    if not quick:
        found += product((LAPS,), (CAMERA,), OURS, twins, what)
        found += product((LAPS,), (SENSOR,), OURS[-1:], twins, what)
    return [*found, None]


def measure_circle(case: tuple[str, str, str, int, str] | None) -> Any:
    """The row of a circle, or rows of gains."""
    if case is None:
        return gain_rows()
    path, seen_by, policy, twin, disturbance = case
    task = make_task("rig_circle")
    if path == LAPS:
        circle = LapCircle(**_FAST)
        task = replace(task, trajectory=circle, duration=circle.end_time)
    rollout, run_ = _rollout(task, seen_by, policy, twin, disturbance), task.trajectory
    begin, end = run_.lap_time
    on_lap = (rollout.time >= begin + run_.ramp) & (rollout.time <= end - run_.ramp)
    error, failed = rollout.error[on_lap], rollout.failure is not None
    lap = 2 * np.pi * run_.radius / run_.speed
    last = rollout.error[on_lap & (rollout.time >= end - run_.ramp - lap)]
    pictured = twin == SHOWN and path == LAP and (seen_by == CAMERA or policy == OURS[-1])
    return CircleRow(
        *case,
        rms=None if failed else float(np.sqrt(np.mean(error**2))),
        mean=None if failed else float(error.mean()),
        largest=None if failed else float(error.max()),
        last=None if failed else float(np.sqrt(np.mean(last**2))),
        thesis=PRINTED.get((policy, disturbance)) if path == LAP else None,
        failure=rollout.failure,
        trace=rollout.thinned(_SAMPLE).slim() if pictured else None,
    )


def _rollout(task: Task, seen_by: str, policy: str, twin: int, disturbance: str) -> Rollout:
    built = disturbed(twin, disturbance)
    case = Case(task, policy, scene={"twin": built})
    if seen_by == CAMERA:
        return run(case).rollout
    # The rig's curvature sensor in place of the camera, calibrated once, undisturbed, then alone.
    sensors = tuple(replace(sensor, delay=LATE) for sensor in built.robot.sensors)
    late = replace(built, robot=replace(built.robot, sensors=sensors))
    with closing(RigEnv(task, twin=late, observe=("all", "sensors"))) as env:
        known = make_policy(policy, RIG, env.control_period, tip_delay=LATE)
        return run(case, env, Sensed(known, _calibration(twin), env.control_period)).rollout


@cache
def _calibration(seed: int) -> Reconstruction:
    """The sensor of an undisturbed twin."""
    return calibrated(RIG, seed, disturbed(seed, ""))


def disturbed(seed: int, disturbance: str) -> Twin:
    """A twin whose tip is seen late, with one of `DISTURBANCES`."""
    twin = replace(rig3d_twin(seed), camera_delay=LATE)
    first, *others = twin.servo_offset
    head = twin.robot.head
    heavier = replace(head, mass=head.mass + _WEIGHTS.get(disturbance, 0.0))
    return replace(
        twin,
        robot=replace(twin.robot, head=heavier),
        servo_offset=(first + _OFFSETS.get(disturbance, 0.0), *others),
    )


# ---------------------------------------------------------------- gains by the first mode

#: [s] between two decisions.
_PERIOD = 0.02

#: Ratio of the gains K_I / K_P [1/s] of the thesis' (0.2, 1), and the gains for which it tells what
#: happens.
RATIO, THESIS_GAINS = 5.0, ((0.2, 1.0), (0.3, 2.0))


@dataclass(frozen=True)
class GainRow(lab.Record):
    """A pair of gains.

    Attributes:
        proportional: K_P [1].
        integral: K_I [1/s].
        radius: Largest magnitude of the loop's eigenvalues, for a control period [1]; above 1 it is
            unstable.
        decay: [s], time in which what rings longest falls to 1 / e; None if it does not.
        limit: Whether these are the largest stable gains of the thesis' ratio.
    """

    proportional: float = lab.quantity(form=".2f", label="K_P")
    integral: float = lab.quantity(form=".2f", label="K_I 1/s")
    radius: float
    decay: float | None = lab.quantity(form=".2f", label="rings for s")
    limit: bool


def gain_rows() -> list[GainRow]:
    """The thesis' gains, and the largest stable ones in the same ratio."""
    least = brentq(lambda k: spectral_radius(k, RATIO * k) - 1, 0.01, 10.0, xtol=1e-14)
    pairs = [(*gains, False) for gains in THESIS_GAINS] + [(least, RATIO * least, True)]
    return [_gain_row(*pair) for pair in pairs]


def left(proportional: float, integral: float, rate: float) -> float:
    """Share [1] that feedback leaves of an error that turns with a `rate` [rad/s], in the long run.

    By the first mode alone, as `gain_rows`; held actions act half a period late.
    """
    frequency, damping_time = ChainStatics(EQUIVALENT_RIG).first_mode()
    if rate == 0:
        return 1 / (1 + proportional) if integral == 0 else 0.0
    s = 1j * rate
    plant = 1 / (1 + damping_time * s + (s / frequency) ** 2)
    late = np.exp(-s * (LATE + _PERIOD / 2))
    return float(abs(1 / (1 + (proportional + integral / s) * plant * late)))


def _gain_row(proportional: float, integral: float, limit: bool) -> GainRow:
    radius = spectral_radius(proportional, integral)
    decay = -_PERIOD / np.log(radius) if radius < 1 and not limit else None
    return GainRow(proportional, integral, radius, decay, limit)


def spectral_radius(proportional: float, integral: float, seen_late: float = LATE) -> float:
    """Of the states place, rate, places on the way to the controller, integral."""
    frequency, damping_time = ChainStatics(EQUIVALENT_RIG).first_mode()
    period, late = _PERIOD, round(seen_late / _PERIOD)
    square = frequency**2
    rates = np.array([[0, 1, 0], [-square, -damping_time * square, square], [0, 0, 0]])
    held = expm(period * rates)
    n = 3 + late
    loop = np.zeros((n, n))
    seen, total = 1 + late, n - 1
    loop[:2, :2] = held[:2, :2]
    loop[2, 0] = 1.0
    loop[3 : 2 + late, 2 : 1 + late] = np.eye(late - 1)
    loop[total, total], loop[total, seen] = 1.0, -period
    change = np.zeros(n)
    change[seen] = -proportional - integral * period
    change[total] = integral
    loop[:2] += np.outer(held[:2, 2], change)
    return float(np.abs(np.linalg.eigvals(loop)).max())


# ---------------------------------------------------------------- tables and picture of circles


def _circle_errors(title: str, name: str, **where: Any) -> lab.TableMaker:
    """RMS errors by disturbance: twin 0, median of the others, and the thesis'."""

    def cell(rows: list[CircleRow]) -> str:
        values = [getattr(row, name) for row in rows]
        if None in values:
            return "failed"
        first, *others = (1e3 * value for value in values)
        text = f"{first:.2g}" + (f" / {median(others):.2g}" if others else "")
        return text if rows[0].thesis is None else f"{text} ({1e3 * rows[0].thesis:.1f})"

    return lab.pivot(
        f"Circle of 120 mm, {title}, tip by the {{seen_by}}: RMS error in mm of twin 0 / median "
        "of the others (thesis)",
        ("policy",),
        "disturbance",
        cell,
        of=CircleRow,
        where=where,
        per=("path", "seen_by"),
        heading=_disturbance,
    )


def _disturbance(name: str) -> str:
    """The thesis' figures beside a weight are of one that it does not tell."""
    of_unknown = name in _WEIGHTS and any(what == name for _, what in PRINTED)
    return f"{name} (thesis: not told)" if of_unknown else name or "undisturbed"


def _shares(rows: list[Any]) -> Table:
    """What P and PI leave of the error of the network alone, here and in the thesis."""
    heads = ("here", "thesis", "first mode: still", "turning once a lap")
    mine = lab.select(lab.of_kind(rows, CircleRow), path=LAP, seen_by=CAMERA)
    circle, (alone, *fed_back) = make_task("rig_circle").trajectory, THESIS
    gains = dict(zip(fed_back, ((THESIS_GAINS[0][0], 0.0), THESIS_GAINS[0]), strict=True))
    title = f"Share of the error of {alone} that is left, %"
    out = lab.new_table(title, ("policy", "disturbance"), heads)
    for policy, what in (key for key in PRINTED if key[0] in gains):
        pair = [lab.one(mine, policy=name, disturbance=what) for name in (policy, alone)]
        errors = [None if row is None else row.rms for row in pair]
        shares = [
            None if None in errors else errors[0] / errors[1],
            PRINTED[policy, what] / PRINTED[alone, what],
            *(left(*gains[policy], rate) for rate in (0.0, circle.speed / circle.radius)),
        ]
        out.add_row(policy, what, *(lab.number(share, ".0f", "%") for share in shares))
    return out


#: [mm], at the lower end of the axes of errors.
_LEAST_ERROR = 0.05


def _circle_picture(rows: list[Any]) -> Figure:
    """Figs. 6.3 and 6.4: paths of the tip, and errors over time, a column for each disturbance."""
    laps = [row for row in lab.of_kind(rows, CircleRow) if row.trace is not None]
    cases = lab.groups(laps, "disturbance")
    figure, _ = new_figure(0, 0, (max(2.1 * len(cases), 5.0), 5.6))
    figure.get_layout_engine().set(h_pad=0.09)  # inches
    parts = figure.subfigures(2, 1, height_ratios=[1, 1.05])
    axes = [figures.add_panels(part, 1, len(cases), share=True)[0] for part in parts]
    for above, below, ((name,), mine) in zip(*axes, cases.items(), strict=True):
        drawn = _circle_curves(mine)
        curves.draw_path(above, drawn, drawn[0].rollout.reference, "xy")
        curves.draw(below, drawn, lambda rollout: 1e3 * rollout.error)
        above.set(title=name or "undisturbed", ylabel="")
        below.set(xlabel="time [s]", yscale="log")
    axes[1][0].set_ylim(bottom=_LEAST_ERROR)
    axes[0][0].set_ylabel("y [mm]")
    axes[1][0].set_ylabel("error [mm]")
    worst = {}
    for (policy,), mine in lab.groups(lab.select(laps, seen_by=CAMERA), "policy").items():
        errors = [row.rms for row in mine]
        worst[policy] = np.inf if None in errors else max(errors)
    best = min(worst, key=worst.__getitem__)
    figures.add_title(
        figure,
        f"{best} errs least when disturbed, {1e3 * worst[best]:.2g} mm rms at most",
        "A circle with a disturbance of the rig, as Figs. 6.3 and 6.4; tips are seen by the camera "
        "unless a sensor is named",
    )
    figures.add_legend(figure, axes[0][0])
    return figure


def _circle_curves(rows: list[CircleRow]) -> list[Curve]:
    """A policy with a sensor is plotted as with the camera, dotted."""
    seen = curves.policy_curves({row.policy: row.trace for row in lab.select(rows, seen_by=CAMERA)})
    known = {curve.name: curve.line for curve in seen}
    return seen + [
        Curve(f"{row.policy}, {row.seen_by}", row.trace, known[row.policy] | {"linestyle": ":"})
        for row in lab.select(rows, seen_by=SENSOR)
    ]


FEEDBACK = lab.Study(
    kinds=(CircleRow, GainRow),
    cases=circles,
    measure=measure_circle,
    tables=[
        _circle_errors("{path}", "rms"),
        _circle_errors("the last of {path}", "last", path=LAPS),
        _shares,
        lab.table(
            "P and PI feedback by the first mode alone: what is stable",
            "proportional",
            "integral",
            "decay",
            lab.Column("", lambda row: "largest stable in this ratio" if row.limit else "thesis"),
            of=GainRow,
        ),
        lab.failures("policy", "disturbance", of=CircleRow),
    ],
    note=f"The tip is seen {1e3 * LATE:g} ms late, by a camera or a curvature sensor with the "
    "errors of the twin; the sensor is calibrated by 120 postures at rest. Policies know the "
    "parameters of twin 0 and no disturbance. An offset of 7 mm is what makes the thesis' "
    "feedforward err as printed; its weight is not given: 26 g make its PI loop err as printed. "
    "Shares are those of twin 0. Most of an offset's error stays where it is; a weight's turns "
    "with the reference, and an integral lags behind: of that the thesis prints less left than a "
    "loop of its gains around the first mode leaves at its speed.",
    plots={"{}": _circle_picture},
)
