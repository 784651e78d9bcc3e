"""Tasks of grippers: what is gripped, how specimens vary, and what counts as success."""

from dataclasses import dataclass

from softrobot_env.core.records import Positive, check_fields
from softrobot_env.core.registry import Registry


@dataclass(frozen=True)
class GripTask:
    """A task: a round bar between the fingers, across the planes in which they bend.

    Pairs are the smallest and largest value of a uniform distribution, sampled for every episode.

    Attributes:
        name: Key in `GRIP_TASKS`.
        free: Whether the bar is free and must be held; else it is clamped and must be enclosed.
        duration: [s].
        closing: [s], until which a free bar lies on the palm, undisturbed.
        diameter: [m], of the bar.
        length: [m], of the bar.
        mass: [kg], of the bar.
        friction: [1], coefficient of friction.
        pull: [N], size of a force in any direction, which grows from `closing` on until
            half the time that is left is over, and stays.
        shake: [m/s2], amplitude of an acceleration of the palm in any direction, from then on too.
        rate: [Hz], frequency of the shaking.
        modulus: [1], factor on the stiffness of each finger.
        arm: [1], factor on the distance of each finger's tendon from its fibre.
        sensor_errors: [1], scale of the usual imperfections of the fingers' sensors
            (`robots.sensors.USUAL`).
        specimen: Seed of the differences between the sensors of grippers, rounded down.
        within: Limit for success at the end: for an enclosing grip, the mean relative deviation of
            the curvatures from that of the wrapped bar; for a hold, the largest displacement [m] of
            the bar.
        lost: [m], displacement of a free bar at which an episode fails.
    """

    name: str
    free: bool
    duration: Positive = 2.0
    closing: Positive = 1.0
    diameter: tuple[float, float] = (0.045, 0.100)
    length: Positive = 0.08
    mass: tuple[float, float] = (0.03, 0.15)
    friction: tuple[float, float] = (0.6, 1.0)
    pull: tuple[float, float] = (0.0, 0.0)
    shake: tuple[float, float] = (0.0, 0.0)
    rate: tuple[float, float] = (1.0, 4.0)
    modulus: tuple[float, float] = (0.9, 1.1)
    arm: tuple[float, float] = (0.95, 1.05)
    sensor_errors: tuple[float, float] = (1.0, 1.0)
    specimen: tuple[float, float] = (0.0, 1e9)
    within: Positive = 0.1
    lost: Positive = 0.04

    def __post_init__(self) -> None:
        check_fields(self, f"task {self.name!r}")
        for name in SAMPLED:
            low, high = getattr(self, name)
            least = 1e-9 if name in POSITIVE else 0.0
            if not least <= low <= high:
                raise ValueError(
                    f"task {self.name!r}: {name} must be a pair, smallest and largest, of "
                    f"{'zero or more' if least == 0 else 'positive numbers'}, got {(low, high)}"
                )
        if not self.closing < self.duration:
            raise ValueError(f"task {self.name!r}: closing must be less than its duration")


#: What episodes sample; pulls and shaking have a random direction as well.
SAMPLED = (
    *("diameter", "mass", "friction", "pull", "shake", "rate", "modulus", "arm"),
    *("sensor_errors", "specimen"),
)

#: Its name up to version 0.2.
DRAWN = SAMPLED

#: Those of them that cannot be zero.
POSITIVE = ("diameter", "mass", "rate", "modulus", "arm")

#: The tasks by name.
GRIP_TASKS = Registry(
    "grip task",
    {
        "enclose": GripTask("enclose", free=False),
        "hold": GripTask(
            "hold", free=True, duration=2.4, pull=(0.0, 4.0), shake=(0.0, 6.0), within=0.015
        ),
    },
)
