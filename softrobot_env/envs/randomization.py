"""Parameters of a robot drawn anew for every episode (domain randomisation)."""

from dataclasses import dataclass, fields

import numpy as np

from softrobot_env.robots import as_number

Range = tuple[float, float]


@dataclass(frozen=True)
class Randomization:
    """Ranges of factors [1] on the robot's parameters, drawn log-uniformly per episode.

    The names are those of `RobotParams.vary`; a range (1, 1) leaves a parameter as it is.

    Attributes:
        youngs_modulus, density, damping_time, tendon_radius: Smallest and largest factor.
    """

    youngs_modulus: Range = (1.0, 1.0)
    density: Range = (1.0, 1.0)
    damping_time: Range = (1.0, 1.0)
    tendon_radius: Range = (1.0, 1.0)

    def __post_init__(self) -> None:
        for name, ends in self._ranges().items():
            numbers = [as_number(end) for end in ends] if np.iterable(ends) else []
            if len(numbers) != 2 or None in numbers or not 0 < numbers[0] <= numbers[1] < np.inf:
                raise ValueError(
                    f"the range of {name!r} must be a pair of factors 0 < low <= high, got {ends!r}"
                )

    def _ranges(self) -> dict[str, Range]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Factors by name, those of parameters that vary; the same draws from the same seed."""
        varied = {name: ends for name, ends in self._ranges().items() if ends[0] < ends[1]}
        return {
            name: float(np.exp(rng.uniform(np.log(low), np.log(high))))
            for name, (low, high) in varied.items()
        } | {name: low for name, (low, high) in self._ranges().items() if low == high != 1}
