"""Many rigs at once, with servos and cameras, are the rig's environment step for step."""

import numpy as np
import pytest
from gymnasium.utils import seeding
from support.rig_episodes import rig

from softrobot_env.envs.disturbances import noise_seed
from softrobot_env.envs.observations.readouts import Cameras, filmed
from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.robots import LENGTH_SCALE
from softrobot_env.scene.servos import Servos

COUNT = 3
MEASURED = ("tip_position", "tip_velocity", "curvature", "curvature_rate", "tendon_tension")


@pytest.mark.parametrize("seed", [3, 8])
def test_many_rigs_are_the_single_environment(seed):
    env = rig(twin=seed)
    observation, info = env.reset(seed=5)
    setting, twin = env._parts, env.twin
    batch = BatchSimulation(setting.plant.nominal, COUNT)
    servos = Servos(twin.servo_speed, twin.servo_offset, twin.backlash, COUNT)
    batch.drive_by(servos)
    everyone, start = np.arange(COUNT), np.zeros(3)
    servos.start(start)
    posture = setting.plant.equilibrium(start + np.array(twin.servo_offset))
    batch.reset(everyone, np.tile(posture, (COUNT, 1)), servos.horn)
    exact = setting.plant.readout(batch, servos)
    cameras = Cameras(COUNT, twin.camera_noise, 1, env.control_period)
    seeds = [noise_seed(seeding.np_random(s)[0]) for s in (4, 5, 6)]
    cameras.start(everyone, seeds, exact.tip)
    readout = filmed(exact, cameras)
    readout.update()
    rng = np.random.default_rng(0)
    for _ in range(60):
        for name in (*MEASURED, "tendon_length"):
            seen = getattr(readout, name)()
            np.testing.assert_allclose(seen[1], observation[name], atol=1e-9, err_msg=name)
        np.testing.assert_allclose(readout.truth()["tip_position"][1], info["tip_position"])
        np.testing.assert_allclose(exact.true_length()[1], info["tendon_length"], atol=1e-15)
        actions = rng.uniform(-0.5, 0.5, (COUNT, 3))
        servos.command[:] = LENGTH_SCALE * actions
        assert not batch.advance().any()
        readout.update()
        observation, *_, info = env.step(actions[1])
        assert not exact.outside.any()
