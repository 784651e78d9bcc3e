"""Loads on a robot, the same for the MuJoCo scene and the beam models."""

from dataclasses import dataclass

from softrobot_env.fields import NotNegative, check_fields


@dataclass(frozen=True)
class Load:
    """Force and moment at arc length `station` [m].

    Becomes an input of the same name whose value scales the load (1: as given).

    Attributes:
        name: Unique name.
        station: [m] from the base.
        force: (3,) [N].
        moment: (3,) [N m].
        follows: Whether the vectors turn with the cross-section; else they keep the world's
            directions (a dead load).
    """

    name: str
    station: NotNegative
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0)
    follows: bool = False

    def __post_init__(self) -> None:
        check_fields(self, f"load {self.name!r}")
