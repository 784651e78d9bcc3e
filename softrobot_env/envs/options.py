"""Checks of what users pass to an environment and to its `reset`."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from softrobot_env.envs.disturbances import NEUTRAL, check_value
from softrobot_env.robots import as_number
from softrobot_env.tasks import LONGEST

#: Control periods [s] an environment accepts.
CONTROL_PERIODS = (1e-3, 0.2)

#: Option -> what it does; also the list in error messages.
OPTIONS = {
    "vary": f"variation of the robot, its drives and sensors by name ({', '.join(NEUTRAL)})",
    "step_width": "width [m] of the step task",
    "duration": "duration [s] of the episode instead of the task's",
    "start_input": "reduced tendon inputs [N] in whose equilibrium the episode starts",
    "start_curvature": "curvature [1/m] per piece at the start, at rest",
}


@dataclass(frozen=True)
class ResetOptions:
    """Options of one reset; see `OPTIONS`.

    In `vary` youngs_modulus, density, damping_time, tendon_radius and tension_gain are factors
    [1], tendon_friction is in N, delay in s and sensor_noise [1] the scale of
    `disturbances.SENSOR_NOISE`.
    """

    vary: dict[str, float] = field(default_factory=dict)
    step_width: float | None = None
    duration: float | None = None
    start_input: np.ndarray | None = None
    start_curvature: np.ndarray | None = None


def parse_options(options: dict[str, Any] | None, n_inputs: int, n_pieces: int) -> ResetOptions:
    """Check the options of `reset`.

    Raises:
        ValueError: Unknown option, wrong shape, a value out of range, or two starts.
    """
    given = known_options(options, OPTIONS)
    if "start_input" in given and "start_curvature" in given:
        raise ValueError("give start_input or start_curvature, not both")
    for name, size in (("start_input", n_inputs), ("start_curvature", n_pieces)):
        if name in given:
            given[name] = vector(name, given[name], size)
    for name in ("step_width", "duration"):
        if name in given:
            given[name] = positive(name, given[name])
    if not isinstance(given.get("vary", {}), dict):
        raise ValueError(f"option 'vary' must be a dict of numbers, got {given['vary']!r}")
    for name, value in given.get("vary", {}).items():
        check_value(name, value)
    return ResetOptions(**given)


def known_options(options: dict[str, Any] | None, allowed: dict[str, str]) -> dict[str, Any]:
    """A copy of the options of a reset; ValueError if one is not among `allowed` (with texts)."""
    if not isinstance(options, dict | None):
        raise ValueError(f"options must be a dict, got {options!r}")
    given = dict(options or {})
    unknown = sorted(set(given) - set(allowed), key=str)
    if unknown:
        listed = "; ".join(f"{name}: {text}" for name, text in allowed.items())
        raise ValueError(f"unknown reset option {unknown[0]!r}; allowed are {listed}")
    return given


def positive(name: str, value: Any) -> float:
    """The value of an option as a positive number, a duration up to the longest."""
    number = as_number(value)
    if number is None or not 0 < number < np.inf:
        raise ValueError(f"option {name!r} must be a positive number, got {value!r}")
    if name == "duration" and number > LONGEST:
        raise ValueError(f"option 'duration' must be at most {LONGEST:g} s, got {value!r}")
    return number


def vector(name: str, value: Any, size: int) -> np.ndarray:
    """The value of an option as finite numbers (size,)."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (size,) or not np.all(np.isfinite(array)):
        raise ValueError(f"option {name!r} must be {size} finite numbers, got {value!r}")
    return array


def check_arguments(
    control_period: float, preview: tuple[float, ...], frame_size: tuple[int, int]
) -> None:
    """Check arguments of an environment that no other part checks.

    Raises:
        ValueError: One is out of range; the message names what is allowed.
    """
    low, high = CONTROL_PERIODS
    if not low <= (as_number(control_period) or 0.0) <= high:
        raise ValueError(
            f"control_period must lie between {low:g} and {high:g} s, got {control_period!r}"
        )
    times = [as_number(time) for time in preview] if np.iterable(preview) else []
    if not times or not all(t is not None and 0 <= t < np.inf for t in times):
        raise ValueError(f"preview needs one or more times >= 0 s, got {preview!r}")
    if not all(isinstance(pixels, int) and pixels > 0 for pixels in frame_size):
        raise ValueError(f"width and height must be positive pixels, got {frame_size}")


def check_render_mode(render_mode: str | None, modes: list[str]) -> None:
    """Raise ValueError for a render mode that is neither None nor one of `modes`."""
    if render_mode is not None and render_mode not in modes:
        raise ValueError(f"render_mode must be None or one of {modes}, got {render_mode!r}")


def action_values(action: np.ndarray, shape: tuple[int]) -> list[float]:
    """An action (n,) as numbers.

    Raises:
        ValueError: Wrong shape, NaN, or a value outside [-1, 1].
    """
    valid = isinstance(action, np.ndarray) and action.shape == shape
    values = action.tolist() if valid else []
    try:
        for value in values:
            valid = valid and -1.0 <= value <= 1.0  # False for NaN
    except TypeError:  # no numbers
        valid = False
    if not valid:
        raise ValueError(
            f"action must be an array of {shape[0]} numbers in [-1, 1], got {action!r} "
            "(gymnasium.wrappers.ClipAction clips)"
        )
    return values
