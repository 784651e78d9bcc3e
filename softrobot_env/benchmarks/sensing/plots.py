"""The figures of chapter 4, of the simulated sensors."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from softrobot_env.benchmarks.sensing.planar import PRINTED
from softrobot_env.benchmarks.sensing.rows import Row
from softrobot_env.rendering.figures import (
    BLACK,
    BLUE,
    COLOURS,
    GREEN,
    REFERENCE,
    SKY,
    VERMILLION,
    Axes,
    add_legend,
    add_notes,
    add_title,
    entry,
    label_lines,
    new_figure,
    save,
)

#: Samples of the four laps.
_CIRCLE = slice(-240, None)

#: Orders of polynomials -> colour.
_ORDERS = {1: BLUE, 3: GREEN, 5: VERMILLION}


def plot(rows: Sequence[Row], path: Path | str) -> None:
    """Draw the planar sensor, and the finger and the spatial sensor beside it, as PNG."""
    drawn = {row.figure: row.curves for row in rows if row.curves is not None}
    path = Path(path)
    share = next(row for row in rows if row.quantity.startswith("share below 2 degrees"))
    shape = next(row for row in rows if row.figure == "Fig. 4.18")
    messages = (
        f"{share.value:.0f} % of the errors are below 2 degrees where both halves bend alike "
        "(to 10 degrees)",
        f"On a bar of 48 mm the shape by {drawn['Fig. 4.16']['fits'].shape[1]} sensors has the tip "
        f"{shape.value:.2g} {shape.unit} off at most",
        _spatial_message(drawn["Fig. 4.22"]),
    )
    _planar(drawn["Figs. 4.6, 4.7"], drawn["Figs. 4.8 to 4.11"], messages[0], path)
    finger, spatial = (path.with_name(f"{path.stem}_{name}.png") for name in ("finger", "spatial"))
    _finger(drawn["Fig. 4.16"], drawn["Fig. 4.18"], messages[1], finger)
    _spatial(drawn["Fig. 4.22"], messages[2], spatial)


def _spatial_message(found: dict) -> str:
    """RMS errors of the tip on the circles."""
    told = []
    for name in ("network", "model"):
        off = found[name][_CIRCLE] - found["tips"][_CIRCLE]
        told.append(f"{1e3 * np.sqrt(np.mean(np.sum(off**2, axis=1))):.2g} mm by the {name}")
    return f"On four laps the sensor tells the tip with an rms error of {' and '.join(told)}"


def _planar(constant: dict, other: dict, message: str, path: Path) -> None:
    figure, axes = new_figure(3, 2, (9.0, 10.0))
    add_title(figure, message, "Planar curvature sensor between two servos")
    axis = axes[0, 0]
    axis.plot(constant["time"], constant["angle"], color=BLUE)
    axis.plot(constant["time"], constant["current"], color=VERMILLION)
    axis.set(xlabel="time [s]", ylabel="angle [deg], current [%]", title="as Fig. 4.6")
    _name_ends(axis, "angle", "current")
    axis = axes[0, 1]
    axis.plot(*constant["cloud"], ".", color="0.8", markersize=3)
    at = np.linspace(0, 100, 101)
    for order, colour in _ORDERS.items():
        axis.plot(at, constant["fits"][order], color=colour)
        printed = np.polynomial.Polynomial(PRINTED[order])(at)
        axis.plot(at[::10], printed[::10], "*", color=colour, markersize=7)
    axis.set(xlabel="relative current [%]", ylabel="total angle [deg]")
    axis.set_title("as Fig. 4.7: polynomials")
    orders = [(f"order {order}", colour) for order, colour in _ORDERS.items()]
    add_notes(axis, [*orders, ("stars: thesis", BLACK)])
    _other(*axes.flat[2:], other)
    save(figure, path)


def _name_ends(axis: Axes, *names: str) -> None:
    """Names of the panel's lines at their right ends."""
    lines = zip(names, axis.lines, strict=True)
    label_lines(axis, [(name, line.get_ydata()[-1], line.get_color()) for name, line in lines])


def _other(first: Axes, seen: Axes, off: Axes, last: Axes, other: dict) -> None:
    """As Figs. 4.8 to 4.11."""
    angles, current, error = other["cloud"]
    first.plot(other["time"], other["angles"][:, 0], color=BLUE)
    first.plot(other["time"], other["angles"][:, 1], color=GREEN)
    first.plot(other["time"], other["current"], color=VERMILLION)
    first.set(xlabel="time [s]", ylabel="angles [deg], current [%]", title="as Fig. 4.8")
    _name_ends(first, "angle 1", "angle 2", "current")
    for axis, values, title in (
        (seen, current, "as Fig. 4.9: relative current [%]"),
        (off, error, "as Fig. 4.10: error [deg]"),
    ):
        cloud = axis.scatter(*angles.T, c=values, cmap="viridis", s=5, linewidths=0)
        axis.figure.colorbar(cloud, ax=axis)
        axis.set(xlabel="angle 1 [deg]", ylabel="angle 2 [deg]", title=title)
    last.plot(other["time"], other["estimate"], color=VERMILLION)
    last.plot(other["time"], other["angle"], **REFERENCE)
    last.set(xlabel="time [s]", ylabel="total angle [deg]", title="as Fig. 4.11")
    _name_ends(last, "sensor", "reference")


def _finger(grips: dict, shape: dict, message: str, path: Path) -> None:
    series = grips["series"]
    shown = [name for name in series if name != "fingertip 60 mm"]
    figure, axes = new_figure(3, 3, (9.6, 9.4))
    add_title(figure, message, "Planar sensors in a finger of the gripper, simulated grips")
    axis, at = axes[0, 0], np.linspace(0, 100, 101)
    for k in range(3):
        for tip, marker in ((False, "."), (True, "x")):
            which = grips["at_tip"] == tip
            points = grips["relative"][which, k][::4], grips["turns"][which, k][::4]
            axis.plot(*points, marker, color=COLOURS[k], markersize=3)
        axis.plot(at, grips["fits"][:, k], color=COLOURS[k])
    axis.set(
        xlabel="relative current [%]", ylabel="turn [deg]", title="as Fig. 4.15 (x: fingertip)"
    )
    for axis, name in zip(axes.flat[1:7], shown, strict=False):
        seen, turns = series[name]
        time = np.arange(len(seen)) / 50
        for k in range(3):
            axis.plot(time, np.degrees(seen[:, k]), color=COLOURS[k])
            axis.plot(time, np.degrees(turns[:, k]), **REFERENCE)
        axis.set(xlabel="time [s]", ylabel="turn [deg]", title=name)
    axes[2, 2].set_visible(False)
    axis = axes[2, 1]
    for estimate, true in shape["shapes"]:
        axis.plot(*estimate.T, color=COLOURS[3])
        axis.plot(*true.T, **REFERENCE)
    axis.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]", title="as Fig. 4.18: 48 mm")
    parts = [entry(f"sensor {k + 1}", color=COLOURS[k]) for k in range(3)]
    true = REFERENCE | {"label": "tags; true shape"}
    add_legend(figure, [*parts, entry("shape by sensors", color=COLOURS[3]), entry(**true)])
    save(figure, path)


def _spatial(found: dict, message: str, path: Path) -> None:
    figure, axes = new_figure(1, 3, (10.5, 4.4))
    add_title(figure, message, "Spatial curvature sensor in the rig, one specimen")
    for k in range(4):
        axes[0, 0].plot(found["readings"][:60, k], ".", color=COLOURS[k])
    axes[0, 0].set(xlabel="posture", ylabel="light over straight [1]", title="as Fig. 4.22")
    for axis, name in ((axes[0, 1], "network"), (axes[0, 2], "model")):
        axis.plot(*(1e3 * found[name][_CIRCLE]).T, color=SKY, linewidth=2)
        axis.plot(*(1e3 * found["tips"][_CIRCLE]).T, **REFERENCE)
        axis.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]", title=f"tip by the {name}")
    add_legend(
        figure,
        [entry(f"fibre {k + 1}", color=COLOURS[k], marker=".", linestyle="") for k in range(4)]
        + [entry("sensor, four laps", color=SKY), entry(**REFERENCE | {"label": "true tip"})],
    )
    save(figure, path)
