"""Figs. 6.3 and 6.4 of the thesis anew."""

from pathlib import Path

import numpy as np

from softrobot_env.benchmarks.feedback.run import CAMERA, LapRow, Row
from softrobot_env.benchmarks.records import groups, of_kind
from softrobot_env.rendering.curves import Curve, policy_curves
from softrobot_env.rendering.figures import (
    REFERENCE,
    add_legend,
    add_panels,
    add_title,
    new_figure,
    save,
)

#: [mm], at the lower end of the axes of errors.
_LEAST_ERROR = 0.05


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw paths of the tip, and errors over time, a column for each disturbance.

    Args:
        rows: Rows of `benchmarks.feedback.run`.
        path: The PNG.
    """
    laps = [row for row in of_kind(rows, LapRow) if row.trace is not None]
    cases = groups(laps, "disturbance")
    figure, _ = new_figure(0, 0, (max(2.1 * len(cases), 5.0), 5.6))
    figure.get_layout_engine().set(h_pad=0.09)  # inches
    parts = figure.subfigures(2, 1, height_ratios=[1, 1.05])
    axes = [add_panels(part, 1, len(cases), share=True)[0] for part in parts]
    for above, below, ((name,), mine) in zip(*axes, cases.items(), strict=True):
        curves = _curves(mine)
        reference = 1e3 * curves[0].rollout.reference
        above.plot(*reference[:, :2].T, **REFERENCE)
        for curve in curves:
            tip = 1e3 * curve.rollout.tip
            above.plot(*tip[:, :2].T, label=curve.label, **curve.line)
            below.plot(curve.rollout.time, 1e3 * curve.rollout.error, **curve.line)
        above.set(title=name or "undisturbed", xlabel="x [mm]", aspect="equal")
        below.set(xlabel="time [s]", yscale="log")
    axes[1][0].set_ylim(bottom=_LEAST_ERROR)
    axes[0][0].set_ylabel("y [mm]")
    axes[1][0].set_ylabel("error [mm]")
    worst = {}
    for (policy,), mine in groups([row for row in laps if row.seen_by == CAMERA], "policy").items():
        errors = [row.rms for row in mine if row.rms is not None]
        worst[policy] = max(errors) if len(errors) == len(mine) else np.inf
    best = min(worst, key=worst.__getitem__)
    add_title(
        figure,
        f"{best} errs least when disturbed, {1e3 * worst[best]:.2g} mm rms at most",
        "A circle with a disturbance of the rig, as Figs. 6.3 and 6.4; tips seen by the camera "
        "unless told",
    )
    add_legend(figure, axes[0][0])
    save(figure, path)


def _curves(rows: list[LapRow]) -> list[Curve]:
    """A policy with a sensor is drawn as with the camera, dotted."""
    seen = policy_curves({row.policy: row.trace for row in rows if row.seen_by == CAMERA})
    lines = {curve.name: curve.line for curve in seen}
    return seen + [
        Curve(f"{row.policy}, {row.seen_by}", row.trace, lines[row.policy] | {"linestyle": ":"})
        for row in rows
        if row.seen_by != CAMERA
    ]
