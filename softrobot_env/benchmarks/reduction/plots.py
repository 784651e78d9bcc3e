"""Figs. 3.11 to 3.18 of the thesis anew."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from softrobot_env.benchmarks.records import groups, of_kind, select
from softrobot_env.benchmarks.reduction.data import CUTOFFS, PERIOD, random_inputs
from softrobot_env.benchmarks.reduction.models import OURS, THESIS_MODEL
from softrobot_env.benchmarks.reduction.rows import OrderRow, PathRow, Row, SpectrumRow
from softrobot_env.rendering.figures import (
    COLOURS,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    add_legend,
    add_notes,
    add_panels,
    add_title,
    label_lines,
    new_figure,
    plain_ticks,
    save,
)

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
    figure, _ = new_figure(0, 0, (10.0, 10.5))
    figure.get_layout_engine().set(h_pad=0.09)  # inches
    upper, lower = figure.subfigures(2, 1, height_ratios=[1, 1.2])
    axes = add_panels(upper, 2, max(len(periods), 1), share=True)
    for line, name in zip(axes, ("rectangle", "circle"), strict=True):
        for axis, period in zip(line, periods, strict=False):
            _paths(axis, select(shown, path=name, period=period))
            axis.set(title=f"{name}, T = {period:g} s", aspect="equal")
        line[0].set_ylabel("y [mm]")
    for axis in axes[1]:
        axis.set_xlabel("x [mm]")
    reach = 1.3e3 * max((np.abs(row.measured).max() for row in shown), default=1e-3)
    axes[0][0].set(xlim=(-reach, reach), ylim=(-reach, reach))
    others = add_panels(lower, 2, 3).flat
    _decay(others[0], of_kind(rows, SpectrumRow))
    _speeds(others[1], shown, of_kind(rows, SpectrumRow))
    _orders(others[2], of_kind(rows, OrderRow))
    _excited(others[3], of_kind(rows, SpectrumRow))
    _inputs(others[4])
    others[5].set_visible(False)
    fastest = select(of_kind(rows, PathRow), model=OURS, period=min(periods, default=0))
    known = [row.mean for row in fastest if row.mean is not None]
    message = "No path is predicted"
    if known:
        message = (
            f"Models learned from motion, {OURS}, predict laps of {fastest[0].period:g} s with a "
            f"mean error of {1e3 * max(known):.2g} mm at most"
        )
    add_title(figure, message, "As Figs. 3.11 to 3.18: paths of the rig, predicted from the inputs")
    add_legend(figure, axes[0][0])
    save(figure, path)


def _paths(axis: Any, rows: list[PathRow]) -> None:
    measured = 1e3 * rows[0].measured
    axis.plot(*measured.T, color=_COLOURS["measured"], linewidth=2.5, label="measured")
    for row in rows:
        if row.predicted is not None:
            axis.plot(*(1e3 * row.predicted).T, color=_COLOURS[row.model], label=row.model)


def _decay(axis: Any, rows: list[SpectrumRow]) -> None:
    """Fig. 3.11."""
    ends = []
    for record in (row.decay_path for row in rows if row.decay_path is not None):
        time = PERIOD * np.arange(len(record))
        for k, name, colour in ((0, "x", GREEN), (1, "y", PURPLE)):
            axis.plot(time, 1e3 * record[:, k], color=colour)
            ends.append((name, 1e3 * record[-1, k], colour))
    axis.set(title="a decay", xlabel="time [s]", ylabel="tip [mm]")
    label_lines(axis, ends)


def _excited(axis: Any, rows: list[SpectrumRow]) -> None:
    """Fig. 3.12: in the grey part the drives excite."""
    known = [row.excited for row in rows if row.excited is not None]
    if not known:
        axis.set_visible(False)
        return
    time = PERIOD * np.arange(len(known[0]))
    axis.plot(time, 1e3 * known[0][:, 0], color=GREEN)
    axis.plot(time, 1e3 * known[0][:, 2], color=ORANGE)
    active = time[np.flatnonzero(np.abs(known[0][:, 2]) > 1e-9)]
    axis.axvspan(active[0], active[-1], color="0.9", linewidth=0)
    add_notes(axis, [("x of the tip", GREEN), ("first input", ORANGE), ("grey: excited", GREY)])
    axis.set(title="excited, then left alone", xlabel="time [s]", ylabel="tip, input [mm]")


def _inputs(axis: Any) -> None:
    """Fig. 3.13."""
    held, *smooth = 1e3 * random_inputs()
    time = PERIOD * np.arange(len(held))
    axis.plot(time, held, color=GREY, linewidth=1)
    notes = [("as drawn by chance", GREY)]
    for one, cutoff, colour in zip(smooth, CUTOFFS, (GREEN, PURPLE, ORANGE), strict=True):
        axis.plot(time, one, color=colour)
        notes.append((f"below {cutoff:g} Hz", colour))
    low, high = axis.get_ylim()
    axis.set_ylim(low, high + 0.35 * (high - low))  # room for the notes
    add_notes(axis, notes, "upper left")
    axis.set(title="random inputs, filtered", xlabel="time [s]", ylabel="first input [mm]")


def _speeds(axis: Any, paths: list[PathRow], rows: list[SpectrumRow]) -> None:
    """Fig. 3.18: decays are slow where the fastest path is fast."""
    fastest = min(paths, key=lambda row: row.period)
    notes = {}
    for record, label, colour in (
        (fastest.measured, f"{fastest.path}, T = {fastest.period:g} s", PURPLE),
        *((row.decay_path, "a decay", GREEN) for row in rows),
    ):
        if record is None:
            continue
        speed = np.linalg.norm(np.diff(record, axis=0), axis=1) / PERIOD
        distance = np.linalg.norm(record[1:], axis=1)
        axis.plot(1e3 * distance, speed, ".", markersize=2, color=colour)
        notes[label] = colour
    add_notes(axis, [*notes.items()], "upper left")
    axis.set(title="speed by place", xlabel="distance from the axis [mm]", ylabel="speed [m/s]")


def _orders(axis: Any, rows: list[OrderRow]) -> None:
    """Fig. 3.14."""
    if not rows:
        axis.set_visible(False)
        return
    ends = []
    for ((order,), mine), colour in zip(groups(rows, "shape_order").items(), COLOURS, strict=False):
        known = [row for row in mine if row.rms is not None]
        if known:
            points = [r.p for r in known], [1e3 * r.rms for r in known]
            axis.plot(*points, "o-", color=colour, markersize=4)
            ends.append((f"$n_w$ = {order}", points[1][-1], colour))
    axis.set(title="thesis' settings", xlabel="numbers in a delay vector, $p$", yscale="log")
    axis.set_ylabel("rms error [mm]")
    plain_ticks(axis, "y")
    label_lines(axis, ends)
