"""Parameters sampled for every episode (domain randomisation)."""

from dataclasses import dataclass

import numpy as np

from softrobot_env.robots.variations import VARIATIONS, Variation, as_number, find_variation

Range = tuple[float, float]


@dataclass(frozen=True, init=False)
class Randomization:
    """Ranges of parameters that vary between episodes: of the robot, its drives and sensors.

        Randomization(youngs_modulus=(0.5, 1.5), delay=(0.0, 0.02))

    The names are those of the reset option `vary`, `robots.variations.VARIATIONS`. Factors [1] are
    sampled log-uniformly, other values uniformly; a delay [s] is rounded to whole control periods.

    Attributes:
        ranges: Smallest and largest values by name, of all parameters that can vary.
    """

    ranges: dict[str, Range]

    def __init__(self, ranges: dict[str, Range] | None = None, **more: Range) -> None:
        """Ranges of some parameters, by keyword or as a dict; all others stay nominal.

        Raises:
            ValueError: An unknown name, or an invalid range; the message says what is allowed.
        """
        given = {**(ranges or {}), **more}
        for name, ends in given.items():
            _check_range(find_variation(name), ends)
        every = {name: (one.neutral, one.neutral) for name, one in VARIATIONS.items()}
        object.__setattr__(self, "ranges", every | {n: tuple(ends) for n, ends in given.items()})

    def __getattr__(self, name: str) -> Range:
        if name == "ranges" or name not in self.ranges:
            raise AttributeError(name)
        return self.ranges[name]

    @property
    def varied(self) -> dict[str, Range]:
        """Ranges that contain values different from the nominal ones."""
        return {
            name: ends
            for name, ends in self.ranges.items()
            if set(ends) != {VARIATIONS[name].neutral}
        }

    def fitting(self, robot: object) -> "Randomization":
        """The same without the parameters that cannot vary for a robot (`RobotParams`)."""
        return Randomization(
            **{n: ends for n, ends in self.varied.items() if incompatibility(n, robot) is None}
        )

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Sampled values by name; the same seed gives the same values."""
        ranges = self.varied
        sampled = {
            name: _sample(rng, low, high, VARIATIONS[name].is_factor)
            for name, (low, high) in ranges.items()
            if low < high
        }
        return sampled | {name: low for name, (low, high) in ranges.items() if low == high}


def incompatibility(name: str, robot: object) -> str | None:
    """Why a parameter cannot vary for a robot; None if it can."""
    why = VARIATIONS[name].incompatibility
    return None if why is None else why(robot)


def _check_range(variation: Variation, ends: object) -> None:
    numbers = [as_number(end) for end in ends] if np.iterable(ends) else []
    low, high = variation.range
    if len(numbers) != 2 or None in numbers or not low <= numbers[0] <= numbers[1] <= high:
        raise ValueError(
            f"the range of {variation.name!r} must be a pair {low:g} <= low <= high <= {high:g}, "
            f"got {ends!r}"
        )


def _sample(rng: np.random.Generator, low: float, high: float, logarithmic: bool) -> float:
    if logarithmic:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(low, high))
