"""Figs. 3.11 to 3.18 of the thesis anew."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from softrobot_env.benchmarks.records import groups, of_kind, select
from softrobot_env.benchmarks.reduction.data import CUTOFFS, PERIOD, random_inputs
from softrobot_env.benchmarks.reduction.models import OURS, THESIS_MODEL
from softrobot_env.benchmarks.reduction.rows import OrderRow, PathRow, Row, SpectrumRow
from softrobot_env.rendering.figures import add_legend, add_title, new_figure, save

_COLOURS = {"measured": "0.6", THESIS_MODEL: "#D55E00", OURS: "#0072B2"}


def plot(rows: Sequence[Row], path: Path | str) -> None:
    """Draw measured and predicted paths by speed, a decay, speeds, and Fig. 3.14.

    Args:
        rows: Rows of `benchmarks.reduction.run`.
        path: The PNG.
    """
    shown = [row for row in of_kind(rows, PathRow) if row.measured is not None]
    shown = [row for row in shown if row.model in _COLOURS]
    periods = [p for (p,) in groups(shown, "period")]
    figure, axes = new_figure(3, max(len(periods), 3), (2.7 * max(len(periods), 3), 9.0))
    for line, name in zip(axes, ("rectangle", "circle"), strict=False):
        for axis, period in zip(line, periods, strict=False):
            _paths(axis, select(shown, path=name, period=period))
            axis.set(title=f"{name}, T = {period:g} s", aspect="equal", xlabel="x [mm]")
        line[0].set_ylabel("y [mm]")
    _decay(axes[2][0], of_kind(rows, SpectrumRow))
    _speeds(axes[2][1], shown, of_kind(rows, SpectrumRow))
    _orders(axes[2][2], of_kind(rows, OrderRow))
    if len(axes[2]) > 4:
        _excited(axes[2][3], of_kind(rows, SpectrumRow))
        _inputs(axes[2][4])
    for axis in [*axes[2][5:], *(one for line in axes[:2] for one in line[len(periods) :])]:
        axis.set_visible(False)
    fastest = select(of_kind(rows, PathRow), model=OURS, period=min(periods, default=0))
    known = [row.mean for row in fastest if row.mean is not None]
    message = "No path is predicted"
    if known:
        message = (
            f"Models learned from motion predict laps of {fastest[0].period:g} s with a mean error "
            f"of {1e3 * max(known):.2g} mm at most ({OURS})"
        )
    add_title(figure, message, "As Figs. 3.11 to 3.18: paths of the rig, predicted from the inputs")
    add_legend(figure, axes[0][0])
    save(figure, path)


def _paths(axis: Any, rows: list[PathRow]) -> None:
    measured = 1e3 * rows[0].measured
    axis.plot(*measured.T, color=_COLOURS["measured"], linewidth=2.5, label="measured")
    reach = 1.3 * np.abs(measured).max()
    for row in rows:
        if row.predicted is not None:
            axis.plot(*(1e3 * row.predicted).T, color=_COLOURS[row.model], label=row.model)
    axis.set(xlim=(-reach, reach), ylim=(-reach, reach))


def _decay(axis: Any, rows: list[SpectrumRow]) -> None:
    """Fig. 3.11."""
    for record in (row.decay_path for row in rows if row.decay_path is not None):
        time = PERIOD * np.arange(len(record))
        axis.plot(time, 1e3 * record[:, 0], color=_COLOURS[OURS])
        axis.plot(time, 1e3 * record[:, 1], color=_COLOURS[THESIS_MODEL])
    axis.set(title="a decay: x, y", xlabel="time [s]", ylabel="tip [mm]")


def _excited(axis: Any, rows: list[SpectrumRow]) -> None:
    """Fig. 3.12: in the grey part the drives excite."""
    known = [row.excited for row in rows if row.excited is not None]
    if not known:
        axis.set_visible(False)
        return
    time = PERIOD * np.arange(len(known[0]))
    axis.plot(time, 1e3 * known[0][:, 0], color=_COLOURS[OURS], label="x of the tip")
    axis.plot(time, 1e3 * known[0][:, 2], color=_COLOURS[THESIS_MODEL], label="first input")
    active = time[np.flatnonzero(np.abs(known[0][:, 2]) > 1e-9)]
    axis.axvspan(active[0], active[-1], color="0.9", linewidth=0)
    axis.legend(frameon=False, fontsize="small")
    axis.set(title="excited, then left alone", xlabel="time [s]", ylabel="tip, input [mm]")


def _inputs(axis: Any) -> None:
    """Fig. 3.13."""
    held, *smooth = 1e3 * random_inputs()
    time = PERIOD * np.arange(len(held))
    axis.plot(time, held, color=_COLOURS["measured"], linewidth=1, label="drawn")
    for one, cutoff, colour in zip(smooth, CUTOFFS, ("#0072B2", "#009E73", "#D55E00"), strict=True):
        axis.plot(time, one, color=colour, label=f"{cutoff:g} Hz")
    axis.legend(frameon=False, fontsize="small", ncols=2)
    axis.set(title="random inputs, filtered", xlabel="time [s]", ylabel="first input [mm]")


def _speeds(axis: Any, paths: list[PathRow], rows: list[SpectrumRow]) -> None:
    """Fig. 3.18: decays are slow where the fastest path is fast."""
    fastest = min(paths, key=lambda row: row.period)
    for record, label, colour in (
        (fastest.measured, f"{fastest.path}, T = {fastest.period:g} s", _COLOURS["measured"]),
        *((row.decay_path, "a decay", _COLOURS[OURS]) for row in rows),
    ):
        if record is None:
            continue
        speed = np.linalg.norm(np.diff(record, axis=0), axis=1) / PERIOD
        distance = np.linalg.norm(record[1:], axis=1)
        axis.plot(1e3 * distance, speed, ".", markersize=2, color=colour, label=label)
    axis.legend(frameon=False, fontsize="small")
    axis.set(title="speed by place", xlabel="distance from the axis [mm]", ylabel="speed [m/s]")


def _orders(axis: Any, rows: list[OrderRow]) -> None:
    """Fig. 3.14."""
    if not rows:
        axis.set_visible(False)
        return
    for (order,), mine in groups(rows, "shape_order").items():
        known = [row for row in mine if row.rms is not None]
        axis.plot([r.p for r in known], [1e3 * r.rms for r in known], "o-", label=f"n_w = {order}")
    axis.legend(frameon=False, fontsize="small")
    axis.set(title="thesis' settings", xlabel="p", ylabel="RMS error [mm]", yscale="log")
