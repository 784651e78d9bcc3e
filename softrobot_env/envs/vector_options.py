"""Checks of what users pass to the reset of many environments."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from softrobot_env.envs.disturbances import NEUTRAL, check_value, periods

Seeds = int | Sequence[int | None] | None


def parse_seeds(seed: Seeds, count: int) -> list[int | None]:
    """One seed, or None, for each environment: given one number, the following ones.

    Raises:
        ValueError: Not as many as environments.
    """
    if seed is None:
        return [None] * count
    if isinstance(seed, int | np.integer):
        return [int(seed) + i for i in range(count)]
    seeds = np.asarray(seed, dtype=object).tolist()
    if not isinstance(seeds, list) or len(seeds) != count:
        raise ValueError(f"seed must be a number or {count} of them, got {seed!r}")
    return seeds


def parse_variation(vary: Any, count: int, control_period: float) -> dict[str, np.ndarray]:
    """Values (count,) of every variation, those that are not given neutral.

    Raises:
        ValueError: Not a dict, an unknown name, a value out of range, or not as many as
            environments.
    """
    if not isinstance(vary, dict):
        raise ValueError(f"option 'vary' must be a dict of numbers, got {vary!r}")
    out = {name: np.full(count, value) for name, value in NEUTRAL.items()}
    for name, value in vary.items():
        values = np.asarray(value).tolist() if np.ndim(value) else [value] * count
        for one in values:
            check_value(name, one)
            if name == "delay":
                periods(one, control_period)  # refuses fractions
        if len(values) != count:
            raise ValueError(f"values of {name!r} must be a number or {count}, got {value!r}")
        out[name][:] = values
    return out


def parse_mask(mask: Any, count: int) -> np.ndarray:
    """Indices (k,) of a mask (count,) bool, all for None.

    Raises:
        ValueError: Another shape or type, or none true.
    """
    if mask is None:
        return np.arange(count)
    mask = np.asarray(mask)
    if mask.shape != (count,) or mask.dtype != bool or not mask.any():
        raise ValueError(
            f"reset_mask must be {count} truth values, some of them true, got {mask!r}"
        )
    return np.flatnonzero(mask)
