"""Rows of the study of sensors: a quantity of a figure or table, beside the thesis' number."""

from dataclasses import dataclass
from typing import Any, Literal

from softrobot_env.benchmarks.records import Record, drawn

#: Whether a number of the model was chosen so that the row comes out; it follows from the thesis'
#: polynomial of order 5, which the model has; it tests the model with numbers chosen elsewhere; or
#: it stands on shapes that were assumed.
Kind = Literal["fitted", "implied", "check", "assumed shape"]


@dataclass(frozen=True)
class Row(Record):
    """A quantity.

    Attributes:
        figure: Of the thesis, or "" beyond it.
        quantity: What it is.
        value: In SI; angles in degrees where `unit` says so.
        unit: Of value and thesis.
        kind: See `Kind`.
        thesis: The printed number, None where there is none.
        at_most: Whether the thesis' number, or the goal, is an upper bound.
        note: What to know about it.
        curves: What the figure shows, by name.
    """

    figure: str
    quantity: str
    value: float
    unit: str
    kind: Kind
    thesis: float | None = None
    at_most: bool = False
    note: str = ""
    curves: dict[str, Any] | None = drawn()  # noqa: RUF009

    @property
    def met(self) -> bool | None:
        """Whether it is within its bound; None without one."""
        return self.value <= self.thesis if self.at_most and self.thesis is not None else None
