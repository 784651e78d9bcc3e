"""Quantities of episodes as people read them: names, units and digits."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from softrobot_env.rendering.tables import FACTORS


@dataclass(frozen=True)
class Quantity:
    """How a field of a row is shown.

    Attributes:
        name: For people.
        unit: Unit shown.
        digits: Decimals of small numbers.
    """

    name: str
    unit: str
    digits: int

    @property
    def heading(self) -> str:
        """Name and unit."""
        return f"{self.name} {self.unit}"

    @property
    def factor(self) -> float:
        """From SI to the unit."""
        return FACTORS.get(self.unit, 1.0)


#: Field of a row -> how it is shown.
QUANTITIES = {
    "e_max": Quantity("max", "mm", 2),
    "e_rms": Quantity("rms", "mm", 3),
    "e_final": Quantity("final", "mm", 2),
    "e_motion": Quantity("motion", "mm", 2),
    "rise_time": Quantity("rise", "ms", 0),
    "settling_time": Quantity("settling", "s", 2),
    "overshoot": Quantity("over", "%", 1),
    "steady_state_error": Quantity("steady", "%", 2),
    "tension_max": Quantity("tension", "N", 0),
    "policy_time_median": Quantity("policy", "µs", 1),
    "policy_time_p99": Quantity("p99", "µs", 1),
    "e_max_ratio": Quantity("max", "", 2),
    "e_rms_ratio": Quantity("rms", "", 2),
    "failures": Quantity("failures", "", 0),
}

_LEAST_STEADY_ERROR = 1e-4


def number(value: float | None, name: str) -> str:
    """A value in the unit of its quantity; a dash for none.

    Large numbers have fewer decimals. A steady-state error is told down to the 0.01 % that the
    thesis uses as a bound.
    """
    if value is None:
        return "-"
    if name == "steady_state_error" and value <= _LEAST_STEADY_ERROR:
        return f"<{100 * _LEAST_STEADY_ERROR:g}"
    scaled = QUANTITIES[name].factor * value
    most = 3 - sum(abs(scaled) >= size for size in (1, 10, 100))
    return f"{scaled:.{min(QUANTITIES[name].digits, most)}f}"


def with_unit(value: float | None, name: str) -> str:
    """Three digits of a value, and its unit."""
    if value is None:
        return "-"
    scaled = QUANTITIES[name].factor * value
    digits = "0f" if abs(scaled) >= 1000 else "3g"
    return f"{scaled:.{digits}} {QUANTITIES[name].unit}".strip()


def span(values: tuple[float, float] | None, name: str) -> str:
    """Smallest and largest value, one number if they are the same."""
    if values is None:
        return "-"
    return "-".join(dict.fromkeys(number(value, name) for value in values))


def cell(row: Any | None, name: str) -> str:
    """A value of a row: a dash if it was not run, "failed" or "never" where there is none."""
    if row is None:
        return "-"
    if row.failure is not None:
        return "failed"
    value = getattr(row, name)
    if value is None and name in ("settling_time", "rise_time"):
        return "never"
    return number(value, name)


def cells(row: Any | None, names: Sequence[str], stroke: str = " / ") -> str:
    """Values of a row, parted by a stroke; one word if there are none."""
    if row is None or row.failure is not None:
        return cell(row, names[0])
    return stroke.join(cell(row, name) for name in names)


def both(rows: Sequence[Any | None], name: str) -> str:
    """A value of several rows, parted by strokes."""
    return " / ".join(cell(row, name) for row in rows)
