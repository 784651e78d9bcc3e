"""Every argument of every environment refuses what it cannot be, in one line with its name."""

from math import inf, nan

import numpy as np
import pytest

from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.robots.variations import VARIATIONS
from softrobot_env.thesis.envs import RigEnv

STRANGE = (nan, -inf, -1.0, "x", (nan, 1.0), {}, object(), np.array(nan), np.array([nan, 1.0]))

#: What stands in a message in place of the argument.
SAID = {"task": "task|x"}


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        pytest.param(kind, name, id=f"{kind.__name__}-{name}")
        for kind in (TrackingEnv, RigEnv, VectorTrackingEnv)
        for name in kind.takes
    ],
)
def test_strange_arguments_are_refused_by_name(kind, name):
    for value in STRANGE:
        with pytest.raises(ValueError, match=SAID.get(name, name)) as caught:
            kind(**{name: value})
        assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="timestep must be at most the control period"):
        kind(timestep=0.03, control_period=0.02)


@pytest.mark.parametrize("kind", [TrackingEnv, VectorTrackingEnv])
@pytest.mark.parametrize("name", VARIATIONS)
def test_variations_of_no_robot_are_refused(kind, name):
    env = kind()
    for value in (nan, inf, -1.0, 1e300, "x", None, True):
        with pytest.raises(ValueError, match=f"value of '{name}' must"):
            env.reset(options={"vary": {name: value}})
    if VARIATIONS[name].range[0] > 0:
        for value in (0.0, 1e-300):
            with pytest.raises(ValueError, match=f"value of '{name}' must"):
                env.reset(options={"vary": {name: value}})


@pytest.mark.parametrize("kind", [TrackingEnv, VectorTrackingEnv, RigEnv])
def test_options_are_a_dict(kind):
    env = kind()
    for options in (nan, "x", (1.0,), [("duration", 1.0)]):
        with pytest.raises(ValueError, match="options must be"):
            env.reset(options=options)
    with pytest.raises(ValueError, match="must be a dict of numbers"):
        env.reset(options={"task" if kind is RigEnv else "vary": {1: 2}})
