"""The gripper study as tables of a terminal."""

from collections.abc import Sequence

from rich.console import Group

from softrobot_env.benchmarks.gripper.rows import Grip, Outcome, Shape, Size, Speed
from softrobot_env.benchmarks.records import Record, groups, of_kind
from softrobot_env.rendering.tables import Column, make_table


def tables(rows: Sequence[Record]) -> Group:
    """Grips, sizes, holds and speed."""
    return Group(
        make_table(
            "Grips of clamped cylinders, and of the oval: bends of the middle finger's sensors",
            _GRIP,
            [_told(grip) for grip in of_kind(rows, Grip)],
            caption="turn: of a sensor that lies on the cylinder altogether",
        ),
        make_table(
            "Diameters from one enclosing grip, of bars and fingers that were not fitted to",
            _SIZE,
            of_kind(rows, Size),
            caption="sensors: their imperfections over the usual ones; none: exact mean bends",
        ),
        make_table("Bends and tips told by calibrated sensors", _SHAPE, of_kind(rows, Shape)),
        make_table(
            "Random bars and fingers, held under random pulls and shaking, or enclosed",
            _OUTCOME,
            of_kind(rows, Outcome),
            caption="error: over what counts as success, median",
        ),
        make_table(
            "Speed, with closings to 25 N",
            _SPEED,
            of_kind(rows, Speed),
            caption="bend: difference of a sensor from the rule's, mean and largest in a closing",
        ),
    )


def changes(grips: Sequence[Grip]) -> dict[str, list[Grip]]:
    """Grips by thing."""
    return {thing: found for (thing,), found in groups(grips, "thing").items()}


def _told(grip: Grip) -> dict:
    bends = {f"bend{k}": angle for k, angle in enumerate(grip.angles, 1)}
    return grip.row() | bends


_GRIP = (
    Column("thing", "thing"),
    Column("tension N", "tension", ".0f"),
    Column("grip", "kind"),
    Column("bends deg", "bend1", ".1f"),
    Column("", "bend2", ".1f"),
    Column("", "bend3", ".1f"),
    Column("turn deg", "turn", ".1f"),
    Column("touching %", "touching", ".0f", "%"),
    Column("tip %", "tip_share", ".0f", "%"),
)

_SIZE = (
    Column("method", "method"),
    Column("task", "task"),
    Column("pieces", "pieces", "d"),
    Column("fitted with", "fitted", "d"),
    Column("sensors", "errors", "g"),
    Column("bars", "count", "d"),
    Column("mean mm", "mean", ".2f", "mm"),
    Column("95 % mm", "high", ".2f", "mm"),
    Column("most mm", "most", ".2f", "mm"),
)

_SHAPE = (
    Column("task", "task"),
    Column("pieces", "pieces", "d"),
    Column("sensors", "errors", "g"),
    Column("fingers", "count", "d"),
    Column("bend deg", "bend", ".2f"),
    Column("95 %", "high_bend", ".2f"),
    Column("most", "most_bend", ".2f"),
    Column("tip mm", "tip", ".2f", "mm"),
    Column("95 %", "high_tip", ".2f", "mm"),
    Column("most", "most_tip", ".2f", "mm"),
)

_OUTCOME = (
    Column("task", "task"),
    Column("policy", "policy"),
    Column("pieces", "pieces", "d"),
    Column("dt ms", "timestep", ".3g", "ms"),
    Column("bars", "count", "d"),
    Column("success %", "success", ".1f", "%"),
    Column("lost %", "lost", ".1f", "%"),
    Column("error", "error", ".2f"),
    Column("tension N", "tension", ".1f"),
    Column("ms/step", "ms_per_step", ".2f"),
)

_SPEED = (
    Column("task", "task"),
    Column("pieces", "pieces", "d"),
    Column("dt ms", "timestep", ".3g", "ms"),
    Column("fineness", "fineness"),
    Column("grippers", "count", "d"),
    Column("threads", "threads", "d"),
    Column("steps/s", "steps_per_s", ".0f"),
    Column("bend deg", "mean_error", ".2f"),
    Column("most", "bend_error", ".2f"),
)
