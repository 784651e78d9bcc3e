"""An observable from outside: the sum of all tensions."""

from collections.abc import Callable

import numpy as np
from gymnasium import spaces
from numpy import ndarray

import softrobot_env
from softrobot_env.envs.observations.table import Observable, Sizes, Sources

NAME = "pull"


def most(sizes: Sizes) -> ndarray:
    """(1,) [N], the sum of all limits."""
    return np.array([sum(tendon.tension_limit for tendon in sizes.robot.tendons)])


def space(sizes: Sizes) -> spaces.Box:
    """From none to a little more than all, for rounding."""
    return spaces.Box(np.zeros(1), most(sizes) * (1 + 1e-9), dtype=np.float64)


def read(sources: Sources) -> Callable[[], ndarray]:
    """Function that returns (1,) of one robot or (n, 1) of many."""
    return lambda: sources.measured.tendon_tension().sum(axis=-1, keepdims=True)


def register() -> None:
    """What a package names in the entry-point group."""
    softrobot_env.register_observable(NAME, Observable("N", space, read, most))
