"""The test rig's environment in tests: random episodes, and what they gave as plain numbers."""

from functools import partial

import numpy as np
import pytest

from softrobot_env.thesis.envs import RigEnv

TWINS = pytest.mark.parametrize("twin", [None, 3], ids=["nominal", "twin"])

#: Makes bare environments that observe everything.
rig = partial(RigEnv, observe="all")


def act(env, rng=None):
    """A random action, or none."""
    size = env.action_space.shape
    values = np.zeros(size) if rng is None else rng.uniform(-1, 1, size)
    return values.astype(np.float32)


def steps(env, count, seed=0):
    """Results of `count` steps at most with random actions."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        result = env.step(act(env, rng))
        yield result
        if result[2] or result[3]:
            return


def flatten(result):
    """Every number of a result of `reset` or `step`, for bitwise comparison."""
    if isinstance(result, dict):
        return [part for key in sorted(result) for part in (key, *flatten(result[key]))]
    if isinstance(result, tuple):
        return [part for item in result for part in flatten(item)]
    return [result.tobytes() if isinstance(result, np.ndarray) else result]
