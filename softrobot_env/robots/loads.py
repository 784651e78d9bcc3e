"""Loads on a robot, the same for the MuJoCo scene and the beam models."""

from dataclasses import dataclass
from math import isfinite


@dataclass(frozen=True)
class Load:
    """Force and moment at arc length `station` [m].

    Becomes an input of the same name whose value scales the load (1: as given).

    Raises:
        ValueError: A number is not finite.

    Attributes:
        name: Unique name.
        station: [m] from the base.
        force: (3,) [N].
        moment: (3,) [N m].
        follows: Whether the vectors turn with the cross-section; else they keep the world's
            directions (a dead load).
    """

    name: str
    station: float
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0)
    follows: bool = False

    def __post_init__(self) -> None:
        if not all(isfinite(x) for x in (self.station, *self.force, *self.moment)):
            raise ValueError(
                f"load {self.name!r}: station, force and moment must be finite, got "
                f"{self.station} m, {self.force} N and {self.moment} N m"
            )
