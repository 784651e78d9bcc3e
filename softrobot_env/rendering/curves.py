"""Curves of recorded episodes, in the manner of thesis Figs. 5.10 to 5.13 and 6.14 to 6.22."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.evaluation.rollout import Rollout

from .figures import COLOURS, REFERENCE, Axes, style_of

#: Samples of an episode to show.
Shown = Callable[[Rollout], slice]

#: Numbers over the instants (T,) of an episode, or (T, k).
Values = Callable[[Rollout], ndarray]

_AXES = "xyz"

#: Lower end [mm] of an axis of errors.
_SMALLEST_ERROR = 1e-3

#: For more curves than colours, without the dashes of the reference.
_LINES = ("-", "-.", ":")

#: Beneath dashes that take turns, for where no other line continues them.
_WHOLE = {"linestyle": "-", "linewidth": 0.7, "zorder": 1.5}


@dataclass(frozen=True)
class Curve:
    """An episode to draw.

    Attributes:
        name: For the legend.
        rollout: The episode.
        line: Matplotlib's keywords of its lines.
    """

    name: str
    rollout: Rollout
    line: Mapping[str, Any]

    @property
    def label(self) -> str:
        """The name, with a failure."""
        time = self.rollout.time
        return f"{self.name} (failed at {time[-1]:.2f} s)" if self.rollout.failure else self.name


def policy_curves(rollouts: Mapping[str, Rollout]) -> list[Curve]:
    """Episodes by the policy, each in its own colour of all figures."""
    return [Curve(name, r, style_of(name).curve) for name, r in rollouts.items()]


def varied_curves(rollouts: Mapping[str, Rollout]) -> list[Curve]:
    """Episodes of one policy by what was varied."""
    lines = [{"color": c, "linestyle": line} for line in _LINES for c in COLOURS]
    pairs = zip(rollouts.items(), cycle(lines), strict=False)
    return [Curve(name, r, line) for (name, r), line in pairs]


def everything(rollout: Rollout) -> slice:
    """All samples."""
    return slice(len(rollout.time))


def longest(curves: Sequence[Curve]) -> Rollout:
    """The episode that has all of the reference, where others failed."""
    return max((curve.rollout for curve in curves), key=lambda r: r.time[-1])


def draw(axis: Axes, curves: Sequence[Curve], values: Values, shown: Shown = everything) -> None:
    """Numbers over time."""
    for curve in curves:
        part = shown(curve.rollout)
        line = {"linewidth": 1.2} | dict(curve.line)
        axis.plot(curve.rollout.time[part], values(curve.rollout)[part], **line, label=curve.label)


def draw_tip(
    axes: Sequence[Axes], curves: Sequence[Curve], plane: str = "xz", shown: Shown = everything
) -> None:
    """Coordinates of the tip with their reference, and the error if there is one axis more.

    Args:
        axes: One for each coordinate, and one for the error.
        curves: The episodes.
        plane: The coordinates, such as "xz".
        shown: Which samples.
    """
    whole = longest(curves)
    part = shown(whole)
    for axis, name in zip(axes, plane, strict=False):
        index = _AXES.index(name)
        axis.plot(whole.time[part], 1e3 * whole.reference[part, index], **REFERENCE)
        draw(axis, curves, lambda rollout, k=index: 1e3 * rollout.tip[:, k], shown)
        axis.set_ylabel(f"tip {name} [mm]")
    for axis in axes[len(plane) :]:
        draw(axis, curves, lambda rollout: 1e3 * rollout.error, shown)
        axis.set(yscale="log", ylabel="error [mm]")
        axis.set_ylim(bottom=max(_SMALLEST_ERROR, axis.get_ylim()[0]))
    axes[-1].set_xlabel("time [s]")


def draw_stacked(
    axes: Sequence[Axes],
    curves: Sequence[Curve],
    values: Values,
    names: Sequence[str],
    shown: Shown = everything,
) -> None:
    """The columns of `values` (T, k), with their k names, on k axes below one another."""
    for index, (axis, name) in enumerate(zip(axes, names, strict=True)):
        draw(axis, curves, lambda rollout, k=index: values(rollout)[:, k], shown)
        axis.set_ylabel(name)
    axes[-1].set_xlabel("time [s]")


def draw_path(
    axis: Axes,
    curves: Sequence[Curve],
    reference: ndarray | None,
    plane: str = "xz",
    shown: Shown = everything,
    **reference_line: Any,
) -> None:
    """Path of the tip in a plane with equal axes, and that of the reference (n, 3) [m] if given."""
    for curve in curves:
        tip = _in_plane(curve.rollout.tip[shown(curve.rollout)], plane)
        axis.plot(*tip, **({"linewidth": 1.1} | dict(curve.line)), label=curve.label)
    if reference is not None:
        axis.plot(*_in_plane(reference, plane), **(REFERENCE | reference_line))
    axis.set(aspect="equal", xlabel=f"{plane[0]} [mm]", ylabel=f"{plane[1]} [mm]")


def draw_shapes(axis: Axes, curves: Sequence[Curve], shapes: Sequence[ndarray]) -> None:
    """Shapes (n, 3) [m] of a planar robot at the end of episodes."""
    for order, (curve, points) in enumerate(zip(curves, shapes, strict=True)):
        line = dict(curve.line) | _dashes(order, len(curves))
        axis.plot(*_in_plane(points, "xz"), **dict(curve.line) | _WHOLE)
        axis.plot(*_in_plane(points, "xz"), **line)
        axis.plot([], [], **(line | {"linestyle": "-"}), label=curve.label)  # dashes may miss it


def typical_error(rollout: Rollout) -> float:
    """Root mean square error [m] of an episode; of one that failed it counts more than any."""
    return np.inf if rollout.failure else float(np.sqrt(np.mean(rollout.error**2)))


def least_error(curves: Sequence[Curve]) -> str:
    """Which episode errs least, and by how much, as a message."""
    best = min(curves, key=lambda curve: typical_error(curve.rollout))
    error = 1e3 * typical_error(best.rollout)
    if np.isinf(error):
        return "all failed"
    return f"{best.name} errs {'least, ' if len(curves) > 1 else ''}by {error:.3g} mm rms"


def spread_of_errors(curves: Sequence[Curve]) -> str:
    """Between which errors episodes are, as a message."""
    if len(curves) == 1:
        return least_error(curves)
    errors = {curve.name: 1e3 * typical_error(curve.rollout) for curve in curves}
    least, most = (find(errors, key=errors.__getitem__) for find in (min, max))
    if np.isinf(errors[least]):
        return "all failed"
    text = "failed" if np.isinf(errors[most]) else f"{errors[most]:.3g} mm"
    return f"the rms error goes from {errors[least]:.3g} mm ({least}) to {text} ({most})"


def end_errors(curves: Sequence[Curve]) -> str:
    """How far from the reference episodes end, as a message; those that failed are counted."""
    away = [1e3 * curve.rollout.error[-1] for curve in curves if not curve.rollout.failure]
    if not away:
        return "all failed"
    failed = len(curves) - len(away)
    some = f"{len(away)} of {len(curves)} end" if failed else "all end"
    who = some if len(curves) > 1 else f"{curves[0].name} ends"
    said = f"{who} within {max(away):.2g} mm of the reference"
    return f"{said}, {failed} failed" if failed else said


def most_input(curves: Sequence[Curve], values: Values, shown: Shown = everything) -> tuple:
    """Name of the episode with the largest size of `values`, and that size."""
    most = {c.name: np.abs(values(c.rollout)[shown(c.rollout)]).max(initial=0) for c in curves}
    name = max(most, key=most.__getitem__)
    return name, float(most[name])


def _dashes(order: int, count: int) -> dict[str, Any]:
    """Line whose dashes take turns with those of the others, so that equal ones all show."""
    long = 5.0  # in line widths
    style = "-" if count == 1 else (long * order, (long, long * (count - 1)))
    return {"linestyle": style, "linewidth": 2.0}


def _in_plane(points: ndarray, plane: str) -> ndarray:
    """Two coordinates (2, n) [mm] of points (n, 3) [m]."""
    return 1e3 * points[:, [_AXES.index(name) for name in plane]].T
