"""Rows of the study of sensors: a quantity of a figure or table, beside the thesis' number."""

from dataclasses import dataclass
from typing import Any, Literal

from softrobot_env.benchmarks.records import Record, for_pictures

#: Whether a number of the model was chosen so that the row comes out; it follows from the thesis'
#: polynomial of order 5, which the model has; it tests the model with numbers chosen elsewhere; or
#: it stands on a finger or on sizes of imperfections that were assumed.
Kind = Literal["fitted", "implied", "check", "assumed"]


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
        goal: Upper bound, None where there is none.
        note: What to know about it.
        curves: What the figure shows, by name.
    """

    figure: str
    quantity: str
    value: float
    unit: str
    kind: Kind
    thesis: float | None = None
    goal: float | None = None
    note: str = ""
    curves: dict[str, Any] | None = for_pictures()  # noqa: RUF009

    @property
    def met(self) -> bool | None:
        """Whether it is within its goal; None without one."""
        return None if self.goal is None else self.value <= self.goal
