"""What is drawn anew for every episode (domain randomisation)."""

from dataclasses import dataclass, fields

import numpy as np

from softrobot_env.envs.disturbances import NEUTRAL, check_value
from softrobot_env.robots import as_number

Range = tuple[float, float]


@dataclass(frozen=True)
class Randomization:
    """Ranges of what varies between episodes: of the robot, its drives and its sensors.

    The names are those of the reset option `vary`. Factors [1] are drawn log-uniformly, and a range
    (1, 1) leaves a parameter as it is; friction, delay and noise are drawn uniformly, (0, 0) is
    without.

    Attributes:
        youngs_modulus, density, damping_time, tendon_radius: Smallest and largest factor [1].
        tension_gain: Smallest and largest tension applied per tension commanded [1].
        tendon_friction: [N], dry friction of every tendon.
        delay: [s] from an action to its effect; a draw is rounded to whole control periods.
        sensor_noise: Scale [1] of the noise of `disturbances.SENSOR_NOISE`.
        sensor_errors: Scale [1] of the usual imperfections of curvature sensors.
    """

    youngs_modulus: Range = (1.0, 1.0)
    density: Range = (1.0, 1.0)
    damping_time: Range = (1.0, 1.0)
    tendon_radius: Range = (1.0, 1.0)
    tension_gain: Range = (1.0, 1.0)
    tendon_friction: Range = (0.0, 0.0)
    delay: Range = (0.0, 0.0)
    sensor_noise: Range = (0.0, 0.0)
    sensor_errors: Range = (0.0, 0.0)

    def __post_init__(self) -> None:
        for name, ends in self._ranges().items():
            numbers = [as_number(end) for end in ends] if np.iterable(ends) else []
            positive = _is_factor(name)
            if (
                len(numbers) != 2
                or None in numbers
                or not 0 <= numbers[0] <= numbers[1] < np.inf
                or (positive and numbers[0] == 0)
            ):
                allowed = "0 < low <= high" if positive else "0 <= low <= high"
                raise ValueError(f"the range of {name!r} must be a pair {allowed}, got {ends!r}")
            check_value(name, numbers[1])

    def _ranges(self) -> dict[str, Range]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Values by name, of what varies; the same draws from the same seed."""
        drawn, fixed = {}, {}
        for name, (low, high) in self._ranges().items():
            if low < high:
                drawn[name] = _draw(rng, low, high, _is_factor(name))
            elif low != NEUTRAL[name]:
                fixed[name] = low
        return drawn | fixed


def _is_factor(name: str) -> bool:
    return NEUTRAL[name] == 1


def _draw(rng: np.random.Generator, low: float, high: float, logarithmic: bool) -> float:
    if logarithmic:
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.uniform(low, high))
