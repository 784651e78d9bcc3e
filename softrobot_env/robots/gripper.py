"""A gripper as data: soft fingers round a palm.

Its frame has the origin in the middle of the palm and z away from it.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

import numpy as np

from softrobot_env.core.records import Key, Positive, Unit, check_fields, check_unique, unwritten
from softrobot_env.robots.parameters import Base, RobotParams


@dataclass(frozen=True)
class Finger:
    """A robot that is a finger.

    Attributes:
        name: Unique name.
        robot: The robot.
        base: Where it is clamped; its own x axis points to what it grips.
    """

    name: str
    robot: RobotParams
    base: Base

    def __post_init__(self) -> None:
        check_fields(self, f"finger {self.name!r}")


@dataclass(frozen=True)
class Gripper:
    """Fingers round a palm.

    Attributes:
        name: Key in `GRIPPERS`.
        fingers: One or more.
        gravity: (3,) [m/s2].
        palm: Sizes (3,) [m] of a block below z = 0; None without.
        file: That describes it, None of others.
    """

    name: str
    fingers: Annotated[tuple[Finger, ...], Key("finger")]
    gravity: Annotated[tuple[float, float, float], Unit("m/s2")] = (0.0, 0.0, 0.0)
    palm: Annotated[tuple[Positive, Positive, Positive] | None, Unit("m")] = None
    file: Path | None = unwritten(None, compare=False, repr=False)

    def __post_init__(self) -> None:
        check_fields(self, f"gripper {self.name!r}")
        if not self.fingers:
            raise ValueError(f"gripper {self.name!r} needs a finger")
        check_unique([finger.name for finger in self.fingers], f"gripper {self.name!r}: fingers")
        for finger in self.fingers:
            if not finger.robot.tendons or finger.robot.drive.kind != "tension":
                raise ValueError(
                    f"gripper {self.name!r}: finger {finger.name!r} needs tendons that are driven "
                    "by tension"
                )

    @cached_property
    def tension_limits(self) -> np.ndarray:
        """(n,) [N], of all tendons, finger by finger."""
        return np.array([t.tension_limit for f in self.fingers for t in f.robot.tendons])

    def seat(self, radius: float) -> float:
        """Height [m] at which a round thing of a radius [m] above the middle touches first.

        Its axis lies across the planes in which the fingers bend. It touches the lines along which
        the straight fingers lie, or the palm.
        """
        heights = [0.0 if self.palm is None else radius]
        for finger in self.fingers:
            inward = finger.base.axes[:, 0]
            away = radius + float(finger.robot.backbone.widest)
            if inward[2] > 0:
                beyond = away + inward[:2] @ np.array(finger.base.position[:2])
                heights.append(finger.base.position[2] + float(beyond / inward[2]))
        return max(heights)
