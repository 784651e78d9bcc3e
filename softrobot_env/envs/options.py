"""Checks of the arguments of `reset` and `step`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy import float64, ndarray

from softrobot_env.core.arrays import HOST, HostArrays, namespace
from softrobot_env.core.records import shown
from softrobot_env.robots.variations import VARIATIONS, as_number, check_variation, neutral
from softrobot_env.tasks import LONGEST, Task, remake_task

from .disturbances import periods

#: Option of vectorised environments that selects those to reset.
MASK = "reset_mask"


@dataclass(frozen=True)
class ResetOptions:
    """Options of one reset; see `RESET_OPTIONS`, and `robots.variations` for `vary`."""

    vary: dict[str, float] = field(default_factory=dict)
    step_width: float | None = None
    duration: float | None = None
    start_input: ndarray | None = None
    start_curvature: ndarray | None = None
    start_length: ndarray | None = None
    task: dict[str, float] = field(default_factory=dict)
    clear_fault: bool = False

    def changed(self, task: Task) -> Task:
        """The task with the options that concern it.

        Raises:
            ValueError: The task has no such option, or a value is out of range.
        """
        if self.step_width is not None:
            task = replace(remake_task(task, step_width=self.step_width), duration=task.duration)
        if self.task:
            task = remake_task(task, **self.task)
        return task if self.duration is None else replace(task, duration=self.duration)


@dataclass(frozen=True)
class ResetOption:
    """Description of an option, and the check of its value: (name, value, size)."""

    text: str
    check: Callable[[str, Any, int], Any]


def positive(name: str, value: Any, _size: int = 0) -> float:
    """The value of an option as a positive number, for durations up to the longest."""
    number = as_number(value)
    if number is None or not 0 < number < np.inf:
        raise ValueError(f"option {name!r} must be a positive number, got {value!r}")
    if name == "duration" and number > LONGEST:
        raise ValueError(f"option 'duration' must be at most {LONGEST:g} s, got {value!r}")
    return number


def _vector(name: str, value: Any, size: int) -> ndarray:
    try:
        array = np.asarray(value, float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (size,) or not np.all(np.isfinite(array)):
        raise ValueError(f"option {name!r} must be {size} finite numbers, got {value!r}")
    return array


def _numbers(name: str, value: Any, _size: int) -> dict[str, float]:
    if not isinstance(value, dict) or not all(isinstance(key, str) for key in value):
        raise ValueError(f"option {name!r} must be a dict of numbers, got {value!r}")
    return value


def _variation(name: str, value: Any, size: int) -> dict[str, float]:
    for varied, amount in _numbers(name, value, size).items():
        check_variation(varied, amount)
    return value


def _truth(name: str, value: Any, _size: int) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"option {name!r} must be True or False, got {value!r}")
    return value


#: Options of `reset` of all environments; each environment takes some of them.
RESET_OPTIONS = {
    "vary": ResetOption(
        "variation of the robot, its drives and sensors by name "
        f"({', '.join(VARIATIONS.registered())})",
        _variation,
    ),
    "step_width": ResetOption("width [m] of the step task", positive),
    "duration": ResetOption("duration [s] of the episode instead of the task's", positive),
    "start_input": ResetOption(
        "inputs of the robot (reduced tendon forces [N], or lengths pulled in [m]) in whose "
        "equilibrium the episode starts",
        _vector,
    ),
    "start_curvature": ResetOption(
        "curvature [1/m] per piece at the start, at rest; of a spatial robot to x and y", _vector
    ),
    "start_length": ResetOption("as start_input, of robots driven by length", _vector),
    "task": ResetOption("dict of options of the task, as those of the environment", _numbers),
    "clear_fault": ResetOption("True to clear the fault that ended the last episode", _truth),
}

#: Options of simulated robots, and of real ones.
SIMULATED_OPTIONS = tuple(name for name in RESET_OPTIONS if name != "clear_fault")
REAL_OPTIONS = ("duration", "task", "clear_fault")


def parse_options(
    options: dict[str, Any] | None, allowed: Sequence[str], sizes: Mapping[str, int] | None = None
) -> ResetOptions:
    """Check the options of a `reset`.

    Args:
        options: The given options.
        allowed: Names that the environment takes.
        sizes: Sizes of vector options.

    Raises:
        ValueError: Unknown option, wrong shape, a value out of range, or two starts.
    """
    if not isinstance(options, dict | None):
        raise ValueError(f"options must be a dict, got {options!r}")
    given = dict(options or {})
    unknown = sorted(set(given) - set(allowed), key=str)
    if unknown:
        listed = "; ".join(f"{name}: {RESET_OPTIONS[name].text}" for name in allowed)
        raise ValueError(f"unknown reset option {unknown[0]!r}; allowed are {listed}")
    starts = [name for name in given if name.startswith("start_")]
    if len(starts) > 1:
        raise ValueError(f"give {' or '.join(starts)}, not both")
    sizes = sizes or {}
    return ResetOptions(
        **{n: RESET_OPTIONS[n].check(n, value, sizes.get(n, 0)) for n, value in given.items()}
    )


# ---------------------------------------------------------------- vectorised environments

Seeds = int | Sequence[int | None] | None


def parse_seeds(seed: Seeds, count: int) -> list[int | None]:
    """One seed, or None, for each environment; from a single number, consecutive seeds.

    Raises:
        ValueError: The number of seeds differs from that of the environments.
    """
    if seed is None:
        return [None] * count
    if isinstance(seed, int | np.integer):
        return [int(seed) + i for i in range(count)]
    seeds = np.asarray(seed, object).tolist()
    if not isinstance(seeds, list) or len(seeds) != count:
        raise ValueError(f"seed must be a number or {count} of them, got {seed!r}")
    return seeds


def seed_generators(generators: list[np.random.Generator], seeds: list[int | None]) -> None:
    """Seed a generator for each environment, as Gymnasium does; those without a seed continue."""
    for i, one in enumerate(seeds):
        if i == len(generators):
            generators.append(seeding.np_random(one)[0])
        elif one is not None:
            generators[i] = seeding.np_random(one)[0]


def parse_variation(vary: Any, count: int, control_period: float) -> dict[str, ndarray]:
    """Values (count,) of every variation; those not given are neutral.

    Raises:
        ValueError: Not a dict, an unknown name, a value out of range, or a wrong number of values.
    """
    out = {name: np.full(count, value) for name, value in neutral().items()}
    for name, value in _numbers("vary", vary, count).items():
        values = np.asarray(value).tolist() if np.ndim(value) else [value] * count
        for one in values:
            check_variation(name, one)
            if name == "delay":
                periods(one, control_period)  # refuses fractions
        if len(values) != count:
            raise ValueError(f"values of {name!r} must be a number or {count}, got {value!r}")
        out[name][:] = values
    return out


def take_mask(options: dict[str, Any], count: int, started: bool) -> ndarray:
    """Indices (k,) of a mask (count,) bool, removed from the options of a reset; all without one.

    Raises:
        ValueError: Wrong shape or type, no true entry, or not all true in the first reset.
    """
    mask = options.pop(MASK, None)
    mask = np.ones(count, bool) if mask is None else np.asarray(mask)
    if mask.shape != (count,) or mask.dtype != bool or not mask.any():
        raise ValueError(
            f"reset_mask must be {count} truth values, some of them true, got {mask!r}"
        )
    if not started and not mask.all():
        raise ValueError("the first reset must be of all environments")
    return np.flatnonzero(mask)


# ---------------------------------------------------------------- actions


#: Tolerance for actions beyond their bounds, to which they are then clipped: rounding of float32.
ROUNDING = 1e-6


def one_action(action: Any, shape: tuple[int]) -> tuple[ndarray, list[float]]:
    """An action (n,) as a new array of float64 and as plain numbers.

    Raises:
        ValueError: See `checked_actions`.
    """
    if type(action) is ndarray and action.shape == shape:
        values = action.tolist()
        try:
            for value in values:
                if not -1.0 <= value <= 1.0:  # or NaN
                    break
            else:
                return action.astype(float64), values
        except TypeError:  # complex numbers, texts
            pass
    checked = checked_actions(action, shape)
    return checked, checked.tolist()


def checked_actions(actions: Any, shape: tuple[int, ...], arrays: HostArrays = HOST) -> ndarray:
    """Actions as a new array of float64; those beyond [-1, 1] by at most `ROUNDING` are clipped.

    If `arrays` are tensors, tensors and NumPy arrays are accepted.

    Raises:
        ValueError: Anything other than real numbers in [-1, 1] of this shape.
    """
    if arrays is not HOST and namespace(actions) is not np and actions.shape == shape:
        values = arrays.copy(arrays.real(actions))
        if bool((values.abs() <= 1.0 + ROUNDING).all()):
            return values.clip(-1.0, 1.0)
    try:
        given = np.asarray(actions)
    except (TypeError, ValueError, RuntimeError):  # uneven lists, tensors that cannot be read
        given = np.empty(0, object)
    if given.shape == shape and given.dtype.kind in "fiub":
        values = given.astype(float64)
        # The largest of numbers with a NaN is NaN, and that is not <= anything.
        largest = np.maximum.reduce(np.abs(values), axis=None)
        if largest <= 1.0 + ROUNDING:
            return arrays.real(values if largest <= 1.0 else np.clip(values, -1.0, 1.0))
    what = "action must be an array of" if len(shape) == 1 else "actions must be an array of"
    wrapper = "ClipAction" if len(shape) == 1 else "vector.ClipAction"
    raise ValueError(
        f"{what} {' x '.join(map(str, shape))} numbers in [-1, 1], got {shown(actions)} "
        f"(gymnasium.wrappers.{wrapper} clips)"
    )
