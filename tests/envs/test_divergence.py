"""A huge acceleration alone is a divergence, before velocities or postures are huge."""

import mujoco
import numpy as np
import pytest

from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import ARM
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.timestep import linearize

#: [rad/s2], beyond MuJoCo's bound of 1e10; after a step of 10 ms the velocity is within it.
ACCELERATION = 3e10

STEP = {"timestep": 0.01, "control_period": 0.01, "integrator": "implicitfast"}


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    """MuJoCo writes its log of warnings into the working directory."""
    monkeypatch.chdir(tmp_path)


def raised(warning):
    """Numbers of warnings of position, velocity and acceleration."""
    kinds = mujoco.mjtWarning
    return [
        int(warning[int(kind)])
        for kind in (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
    ]


def test_a_huge_acceleration_ends_an_episode():
    env = TrackingEnv("swing", **STEP)
    env.reset()
    mass = linearize(env.model).mass
    env.data.qfrc_applied[:] = mass @ np.full(env.model.nv, ACCELERATION)
    *_, terminated, _, info = env.step(np.zeros(3, np.float32))
    assert raised(env.data.warning.number) == [0, 0, 1]
    assert terminated and "acceleration of DOF" in info["failure"]


def test_a_huge_acceleration_ends_one_of_many():
    """Springs drive it, from a posture that is within the bound."""
    scene = build_scene(SceneConfig(ARM, **STEP))
    chain = linearize(scene.model)
    posture = np.linalg.solve(chain.stiffness, chain.mass @ np.full(len(chain.mass), ACCELERATION))
    assert np.abs(posture).max() < 1e10
    alone = mujoco.MjData(scene.model)
    alone.qpos[:] = posture
    mujoco.mj_step(scene.model, alone)
    mujoco.mj_step1(scene.model, alone)
    assert raised(alone.warning.number) == [0, 0, 1]

    batch = BatchSimulation(scene, 3)
    postures = np.stack([0 * posture, posture, 0 * posture])
    batch.reset(np.arange(3), postures, np.zeros((3, scene.model.nu)))
    assert batch.advance().tolist() == [False, True, False]
