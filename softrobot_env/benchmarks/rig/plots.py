"""Figs. 5.10 to 5.14 of the thesis anew, and what goes beyond."""

from pathlib import Path

import numpy as np

from softrobot_env.benchmarks.records import of_kind, one, select
from softrobot_env.benchmarks.rig.cases import FAST, SLOW, LapsRow
from softrobot_env.benchmarks.rig.run import Row
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.rendering.curves import (
    draw,
    draw_path,
    finish,
    least_error,
    longest,
    policy_curves,
)
from softrobot_env.rendering.figures import (
    REFERENCE,
    Axes,
    Figure,
    add_title,
    new_figure,
    save,
    style_of,
)
from softrobot_env.robots import LENGTH_SCALE
from studies.thesis import Row as ForceRow

#: Name of the figure -> title, period and policies of its paths.
_PATHS = {
    "fig_5_10": ("As Fig. 5.10", SLOW, ("rig_nn", "inverse_dynamics", "hybrid")),
    "fig_5_11": ("As Fig. 5.11", FAST, ("rig_nn",)),
    "fig_5_12": ("As Fig. 5.12", FAST, ("inverse_dynamics", "hybrid")),
    "beyond": ("Beyond the thesis", FAST, ("hybrid", "hybrid_flexible", "hybrid_calibrated")),
}


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw as PNG what there are rows for.

    Args:
        rows: Rows of `benchmarks.rig.run`.
        path: A file in the folder of the figures, which have names of their own (`fig_5_10.png`).
    """
    laps = [row for row in of_kind(rows, LapsRow) if row.trace is not None]
    traces = {(row.policy, row.period): row.trace for row in laps}
    path = Path(path)
    for name, (title, period, policies) in _PATHS.items():
        mine = {p: traces[p, period] for p in policies if (p, period) in traces}
        if mine:
            text = f"{title}: triangle, a lap in {period:g} s"
            save(_tracking(mine, text), path.with_stem(name))
    pair = [traces.get((name, FAST)) for name in ("rig_nn", "hybrid")]
    if None not in pair:
        save(_parts(*pair), path.with_stem("fig_5_13"))
    forces = of_kind(rows, ForceRow)
    if forces:
        save(_forces(forces), path.with_stem("fig_5_14"))


def _tracking(traces: dict[str, Rollout], title: str) -> Figure:
    """Paths on the left, errors over time on the right."""
    figure, ((left, right),) = new_figure(1, 2, (9.5, 4.8))
    curves = policy_curves(traces)
    whole = longest(curves)
    # Two of the seven laps; the dashes of several would fill each other.
    draw_path(left, curves, whole.reference[whole.time <= whole.time[-1] * 2 / 7], "xy")
    draw(right, curves, lambda rollout: 1e3 * rollout.error)
    right.set(xlabel="time after the approach [s]", ylabel="error [mm]")
    right.set_ylim(bottom=0)
    return finish(figure, left, least_error(curves), title)


def _parts(network: Rollout, hybrid: Rollout) -> Figure:
    """Both parts of the first tendon's length: what the hybrid adds is the dynamic one."""
    figure, ((axis,),) = new_figure(1, 1, (9.0, 4.2))
    quasi_static, both = (1e3 * LENGTH_SCALE * r.action[:, 0] for r in (network, hybrid))
    curves = (
        ("quasi-static part: network", quasi_static, "rig_nn"),
        ("dynamic part: inverse dynamics", both - quasi_static, "inverse_dynamics"),
        ("hybrid", both, "hybrid"),
    )
    for label, values, policy in curves:
        axis.plot(network.time, values, **style_of(policy).curve, linewidth=1.2, label=label)
    axis.set(xlabel="time after the approach [s]", ylabel="length pulled in, $s_1$ [mm]")
    part, whole = np.ptp(both - quasi_static), np.ptp(both)
    message = (
        f"The dynamic part moves by {part:.2g} mm, the hybrid's whole length by {whole:.2g} mm"
    )
    subject = f"As Fig. 5.13: length of tendon 1, triangle, a lap in {FAST:g} s"
    return finish(figure, axis, message, subject)


def _forces(rows: list[ForceRow]) -> Figure:
    """Effective tendon force and its phase over the angular velocity."""
    figure, ((top,), (bottom,)) = new_figure(2, 1, (7.5, 5.6))
    _over_omega(top, select(rows, y_name="effective_force_N"), 1.0)
    _over_omega(bottom, select(rows, y_name="phase_rad"), 180 / np.pi)
    _mark(top, rows, "omega_of_least_force_rad_s", "least force")
    _mark(bottom, rows, "omega_of_balance_rad_s", "stiffness and inertia in balance")
    top.set(yscale="log", ylabel="effective force [N]")
    bottom.set(xlabel="angular velocity [rad/s]", ylabel="ahead of the output [deg]")
    bottom.set_yticks([0, 45, 90, 135, 180])
    least = one(rows, y_name="omega_of_least_force_rad_s")
    known = select(rows, y_name="effective_force_N")
    message = "The force over the angular velocity"
    if least is not None and known:
        force = min(row.y for row in known)
        message = f"A circle takes the least force, {force:.2g} N, at {least.y:.2g} rad/s"
    add_title(figure, message, "As Fig. 5.14: circle of 90 mm")
    return figure


def _over_omega(axis: Axes, rows: list[ForceRow], factor: float) -> None:
    points = [(row.x, factor * row.y) for row in rows]
    axis.plot(*zip(*points, strict=True), **style_of("inverse_dynamics").curve)
    axis.set_xscale("log")


def _mark(axis: Axes, rows: list[ForceRow], name: str, what: str) -> None:
    row = one(rows, y_name=name)
    if row is not None:
        axis.axvline(row.y, **REFERENCE | {"color": "0.4", "label": None})
        text = {"ha": "right", "fontsize": 9, "color": "0.4", "textcoords": "offset points"}
        place = {"xycoords": ("data", "axes fraction"), "xytext": (-5, 0)}
        axis.annotate(f"{what}: {row.y:.2g} rad/s", (row.y, 0.9), **place, **text)
