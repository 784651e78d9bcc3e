"""Figs. 6.14 to 6.22 of the thesis anew, and error against policy time."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from softrobot_env.benchmarks.controllers.cases import COMPARED, PCC, VARIED, ControllerRow, moduli
from softrobot_env.benchmarks.controllers.run import Row
from softrobot_env.benchmarks.records import names, of_kind, one, select
from softrobot_env.evaluation.labels import variation_label
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
    Figure,
    add_legend,
    add_title,
    entry,
    new_figure,
    save,
    style_axes,
    style_of,
)
from softrobot_env.robots import ARM, centerline
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.thesis.figures import CONTROLLERS, FIGURES, POLICY_TIME
from studies.pictures import label_points

#: Colours of factors on Young's modulus: warm where the robot is softer than known.
_MODULI = {0.5: VERMILLION, 0.75: ORANGE, 1.0: GREEN, 1.25: SKY, 1.5: BLUE}

#: [s] of a step response that is shown from near, and as a whole.
_STEP_WINDOWS = (1.0, 5.0)

#: Setting -> (label, whether markers are filled).
_SETTINGS = {"mujoco": ("MuJoCo", True), "thesis": ("PCC plant", False)}

_ERRORS = {"e_rms": "rms error on the swing [mm]", "e_max": "largest error on the swing [mm]"}


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw as PNG what there are rows for.

    Args:
        rows: Rows of `benchmarks.controllers.run`.
        path: A file in the folder of the figures, which have names of their own (`fig_6_14.png`).
    """
    found = of_kind(rows, ControllerRow)
    for name, draw, curves, title in _figures(found):
        if curves:
            save(draw(curves, title), Path(path).with_name(f"{name}.png"))
    swings = [row for row in select(found, task="swing", failure=None) if row.setting in _SETTINGS]
    if swings:
        save(_error_against_time(swings), Path(path).with_name("error_against_time.png"))


def _figures(
    rows: list[ControllerRow],
) -> Iterator[tuple[str, Callable[[list[Curve], str], Figure], list[Curve], str]]:
    """File name, what draws it, episodes and title of each figure of curves."""
    swing, lshape = (_compared(rows, task) for task in ("swing", "lshape"))
    step = _compared(rows, "step", 0.05)
    yield "fig_6_14", _step, step, "As Fig. 6.14: step of 50 mm, PCC plant"
    yield "fig_6_15", _tracking, swing, "As Fig. 6.15: swing, PCC plant"
    yield "fig_6_16", _inputs, swing, "As Fig. 6.16: swing, PCC plant"
    yield "fig_6_17", _arms, swing, "As Fig. 6.17: the arm at the end of the swing, PCC plant"
    yield "fig_6_18", _plane, lshape, "As Fig. 6.18: L-shape, PCC plant"
    yield "fig_6_19", _inputs, lshape, "As Fig. 6.19: L-shape, PCC plant"
    for policy, name in VARIED.items():
        curves = _varied(rows, policy)
        number = name.removeprefix("fig_").replace("_", ".")
        title = f"As Fig. {number}" if policy in CONTROLLERS else "As Figs. 6.20 to 6.22"
        text = f"{title}: swing of {policy} with another Young's modulus, PCC plant"
        yield name, _varied_swings, curves if len(curves) > 1 else [], text


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


def _step(curves: list[Curve], title: str) -> Figure:
    figure, axes = new_figure(2, 2, (9.5, 6))
    for column, end in enumerate(_STEP_WINDOWS):
        draw_tip(axes[:, column], curves, shown=until(end))
    return finish(figure, axes[0, 0], least_error(curves), title)


def _tracking(curves: list[Curve], title: str) -> Figure:
    return _tracked(curves, least_error(curves), title)


def _varied_swings(curves: list[Curve], title: str) -> Figure:
    """With a message of the most sensitive case."""
    errors = {curve.name: 1e3 * typical_error(curve.rollout) for curve in curves}
    least, most = (f(errors, key=errors.__getitem__) for f in (min, max))
    text = "failed" if np.isinf(errors[most]) else f"{errors[most]:.3g} mm"
    message = f"The rms error goes from {errors[least]:.3g} mm ({least}) to {text} ({most})"
    return _tracked(curves, message, title)


def _tracked(curves: list[Curve], message: str, title: str) -> Figure:
    figure, axes = new_figure(3, 1, (8, 8))
    draw_tip(axes[:, 0], curves)
    return finish(figure, axes[0, 0], message, title)


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


def _error_against_time(rows: list[ControllerRow]) -> Figure:
    """Rms and largest error over the median policy time; the thesis gives the largest only."""
    figure, ((left, right),) = new_figure(1, 2, (10, 5.2))
    for axis, (metric, text) in zip((left, right), _ERRORS.items(), strict=True):
        for row in rows:
            place = 1e6 * row.policy_time_median, 1e3 * getattr(row, metric)
            axis.plot(*place, **_marker(style_of(row.policy).colour, _SETTINGS[row.setting][1]))
        axis.set(xscale="log", yscale="log", ylabel=text)
        axis.set_xlabel("policy time per decision, median [µs]")
    of_controller = {controller: policy for policy, controller in CONTROLLERS.items()}
    for figure_ in select(FIGURES, task="swing"):
        colour = style_of(of_controller[figure_.controller]).colour
        place = 1e6 * POLICY_TIME[figure_.controller], 1e3 * figure_.e_max
        right.plot(*place, **THESIS | {"color": colour, "markeredgecolor": "black"})
    told = [entry(label, **_marker(GREY, filled)) for label, filled in _SETTINGS.values()]
    best = min(select(rows, setting="mujoco") or rows, key=lambda row: row.e_rms)
    add_title(
        figure,
        f"{best.policy} errs least on the swing, {1e3 * best.e_rms:.2g} mm rms for "
        f"{float(f'{1e6 * best.policy_time_median:.2g}'):g} µs a decision",
        "All policies: error against the time of a decision",
    )
    label = "thesis (colour: its controller)"
    add_legend(figure, [*told, entry(**THESIS | {"label": label, "color": GREY})])
    for axis, metric in zip((left, right), _ERRORS, strict=True):
        label_points(axis, [_labelled(rows, name, metric) for name in names(rows)])
    return figure


def _labelled(rows: list[ControllerRow], policy: str, metric: str) -> tuple:
    """Name, places [µs, mm] and colour of a policy's points."""
    mine = select(rows, policy=policy)
    places = [(1e6 * row.policy_time_median, 1e3 * getattr(row, metric)) for row in mine]
    return policy, places, style_of(policy).colour


def _marker(colour: str, filled: bool) -> dict[str, str | float]:
    face = colour if filled else "white"
    style = {"marker": "o", "linestyle": "none", "markersize": 7}
    return {"color": colour, "markerfacecolor": face, **style}
