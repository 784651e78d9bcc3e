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
    VERMILLION,
    Axes,
    add_legend,
    entry,
    new_figure,
    save,
)


def plot(rows: Sequence[Row], path: Path | str) -> None:
    """Draw the planar sensor, and the finger and the spatial sensor beside it, as PNG."""
    drawn = {row.figure: row.curves for row in rows if row.curves is not None}
    path = Path(path)
    _planar(drawn["Figs. 4.6, 4.7"], drawn["Figs. 4.8 to 4.11"], path)
    _finger(drawn["Fig. 4.16"], drawn["Fig. 4.18"], path.with_name(f"{path.stem}_finger.png"))
    _spatial(drawn["Fig. 4.22"], path.with_name(f"{path.stem}_spatial.png"))


def _planar(constant: dict, other: dict, path: Path) -> None:
    figure, axes = new_figure(2, 3, (13.0, 7.4))
    figure.suptitle("Planar curvature sensor between two servos")
    part = slice(0, 1000)
    axes[0, 0].plot(constant["time"][part], constant["angle"][part], color=BLUE)
    axes[0, 0].plot(constant["time"][part], constant["current"][part], color=VERMILLION)
    axes[0, 0].set(xlabel="time [s]", ylabel="angle [deg], current [%]", title="as Fig. 4.6")
    axis = axes[0, 1]
    axis.plot(constant["current"][::10], constant["angle"][::10], ".", color="0.8", markersize=3)
    at = np.linspace(0, 100, 101)
    for order, colour in ((1, BLUE), (3, GREEN), (5, VERMILLION)):
        axis.plot(at, constant["fits"][order], color=colour)
        printed = np.polynomial.Polynomial(PRINTED[order])(at)
        axis.plot(at[::10], printed[::10], "*", color=colour, markersize=7)
    axis.set(xlabel="relative current [%]", ylabel="total angle [deg]")
    axis.set_title("as Fig. 4.7: orders 1, 3, 5")
    _other(axes[0, 2], axes[1], other)
    add_legend(
        figure,
        [
            entry("angle, order 1", color=BLUE),
            entry("current, order 5, sensor", color=VERMILLION),
            entry("order 3", color=GREEN),
            entry("polynomials of the thesis", color=BLACK, marker="*", linestyle="none"),
            entry("reference", **{k: v for k, v in REFERENCE.items() if k != "label"}),
        ],
    )
    save(figure, path)


def _other(first: Axes, axes: Sequence[Axes], other: dict) -> None:
    """As Figs. 4.8 to 4.11."""
    step = max(1, len(other["time"]) // 6000)
    angles, shown = other["angles"][::step], {"s": 5, "linewidths": 0}
    early = other["time"] < 60
    first.plot(other["time"][early], other["angles"][early, 0], color=BLUE)
    first.plot(other["time"][early], other["angles"][early, 1], color=GREEN)
    first.plot(other["time"][early], other["current"][early], color=VERMILLION)
    first.set(xlabel="time [s]", ylabel="angles [deg], current [%]", title="as Fig. 4.8")
    for axis, name, title in (
        (axes[0], "current", "as Fig. 4.9: relative current [%]"),
        (axes[1], "error", "as Fig. 4.10: error [deg]"),
    ):
        cloud = axis.scatter(*angles.T, c=other[name][::step], cmap="viridis", **shown)
        axis.figure.colorbar(cloud, ax=axis)
        axis.set(xlabel="angle 1 [deg]", ylabel="angle 2 [deg]", title=title)
    axes[2].plot(other["time"][early], other["estimate"][early], color=VERMILLION)
    axes[2].plot(other["time"][early], other["angle"][early], **REFERENCE)
    axes[2].set(xlabel="time [s]", ylabel="total angle [deg]", title="as Fig. 4.11")


def _finger(grips: dict, shape: dict, path: Path) -> None:
    series = grips["series"]
    shown = [name for name in series if name != "fingertip 60 mm"]
    figure, axes = new_figure(2, 4, (15.0, 7.4))
    figure.suptitle("Three planar sensors in a finger of the gripper, in simulated grips")
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
        seen, turns, _ = series[name]
        time = np.arange(len(seen)) / 50
        for k in range(3):
            axis.plot(time, np.degrees(seen[:, k]), color=COLOURS[k])
            axis.plot(time, np.degrees(turns[:, k]), **REFERENCE)
        axis.set(xlabel="time [s]", ylabel="turn [deg]", title=name)
    axis = axes[1, 3]
    for estimate, true in shape["shapes"]:
        axis.plot(*estimate.T, color=VERMILLION)
        axis.plot(*true.T, **REFERENCE)
    axis.set(aspect="equal", xlabel="[mm]", ylabel="[mm]", title="as Fig. 4.18: 48 mm")
    parts = [entry(f"sensor {k + 1}", color=COLOURS[k]) for k in range(3)]
    shapes = [entry("shape by sensors", color=VERMILLION), entry("tags, true shape", color=BLACK)]
    add_legend(figure, parts + shapes)
    save(figure, path)


def _spatial(found: dict, path: Path) -> None:
    figure, axes = new_figure(1, 3, (13.5, 4.8))
    figure.suptitle("Spatial curvature sensor in the rig, one specimen")
    for k in range(4):
        axes[0, 0].plot(found["readings"][:60, k], ".-", color=COLOURS[k])
    axes[0, 0].set(xlabel="point", ylabel="light over straight [1]", title="as Fig. 4.22")
    circle = slice(-240, None)
    for axis, name in ((axes[0, 1], "network"), (axes[0, 2], "model")):
        axis.plot(*(1e3 * found[name][circle]).T, color=VERMILLION, linewidth=1)
        axis.plot(*(1e3 * found["tips"][circle]).T, **REFERENCE)
        axis.set(aspect="equal", xlabel="x [mm]", ylabel="y [mm]", title=f"tip by the {name}")
    add_legend(
        figure,
        [entry(f"fibre {k + 1}", color=COLOURS[k]) for k in range(4)]
        + [entry("sensor, four laps", color=VERMILLION), entry("true tip", color=BLACK)],
    )
    save(figure, path)
