"""Many episodes and steps take no more memory than a few."""

import gc

import gymnasium
import numpy as np
import pytest

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.envs.randomization import Randomization

SAMPLED = Randomization(youngs_modulus=(0.7, 1.4), density=(0.7, 1.4), damping_time=(0.5, 2.0))
ENVIRONMENTS = {
    "arm": ("SoftRobot/ArmSwing-v0", {}),
    "rig": ("SoftRobot/RigTriangle-v0", {"observe": "all"}),
    "beam": ("SoftRobot/ArmSwing-v0", {"plant": BeamPlant("pcc")}),
    "sensors": ("SoftRobot/Track-v0", {"robot": "planar_finger", "observe": "all"}),
}


@pytest.fixture(params=ENVIRONMENTS)
def env(request):
    name, options = ENVIRONMENTS[request.param]
    made = gymnasium.make(name, randomization=SAMPLED, **options).unwrapped
    yield made
    made.close()


def test_what_an_episode_leaves_is_freed_at_once(env):
    """A model in a cycle of references stays until Python looks for them, hundreds of resets on."""
    env.reset(seed=0)
    env.reset()
    gc.collect()
    gc.disable()
    try:
        for _ in range(3):
            env.reset()
            env.step(np.zeros(env.action_space.shape))
        gc.set_debug(gc.DEBUG_SAVEALL)
        gc.collect()
        kinds = {f"{type(one).__module__}.{type(one).__qualname__}" for one in gc.garbage}
    finally:
        gc.set_debug(0)
        gc.garbage.clear()
        gc.enable()
    assert not [kind for kind in kinds if kind.startswith(("softrobot_env", "mujoco"))]
