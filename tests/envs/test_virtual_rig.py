"""The virtual rig is the rig of `RigEnv`, seen through pulses, counts and late pictures."""

import numpy as np
import pytest

from softrobot_env.envs.simulation.virtual_rig import VirtualRig
from softrobot_env.robots import CAMERA_PERIOD
from softrobot_env.robots.twin import rig3d_twin
from softrobot_env.thesis.envs import RigEnv

TWIN = rig3d_twin(3)


@pytest.fixture
def rig():
    return VirtualRig(TWIN)


def hold(rig, command, seconds):
    for _ in range(round(seconds / rig.tick)):
        assert rig.advance(command) is None


def test_it_moves_as_the_environment_does(rig):
    """Same twin, same commands held for 20 ms, some quick: only the timestep differs."""
    env = RigEnv("reach", twin=TWIN)
    env.reset(seed=0)
    rng, worst = np.random.default_rng(1), 0.0
    action = np.zeros(3)
    for k in range(50):
        change = (0.3 if k % 10 == 0 else 0.05) * rng.standard_normal(3)
        action = np.clip(action + change, -0.3, 0.3).astype(np.float32)
        observation, *_, info = env.step(action)
        hold(rig, env.length_scale * action.astype(float), env.control_period)
        assert observation["tendon_length"] == pytest.approx(rig.length, abs=1e-12)
        worst = max(worst, np.hypot(*(rig.tip - info["tip_position"])))
    assert np.hypot(*rig.tip) > 0.03
    assert worst < 0.3e-3


def test_without_power_the_servos_stay(rig):
    hold(rig, np.array([0.01, 0.0, 0.0]), 0.3)
    assert rig.length == pytest.approx([0.01, 0.0, 0.0])
    hold(rig, None, 0.1)
    assert rig.length == pytest.approx([0.01, 0.0, 0.0])


def test_a_stuck_servo_stays_and_the_others_move(rig):
    rig.stuck.add(1)
    hold(rig, np.full(3, 0.004), 0.2)
    assert rig.length == pytest.approx([0.004, 0.0, 0.004])


def test_pictures_are_late_and_noisy_around_the_tip(rig):
    pictures = []
    for _ in range(3000):
        rig.advance(np.zeros(3))
        pictures += [rig.picture] if rig.picture else []
    ages = [picture[0] for picture in pictures]
    assert len(pictures) == pytest.approx(3000 * rig.tick / CAMERA_PERIOD, abs=2)
    assert min(ages) >= CAMERA_PERIOD - 1e-9 and max(ages) <= CAMERA_PERIOD + rig.tick + 1e-9
    errors = np.array([picture[1] for picture in pictures]) - rig.tip
    assert errors.std() == pytest.approx(TWIN.camera_noise, rel=0.15)
    assert np.abs(errors.mean(axis=0)).max() < 4 * TWIN.camera_noise / np.sqrt(len(errors))


def test_sensors_tell_the_direction_of_the_bend(rig):
    straight = np.array(rig.adc())
    hold(rig, np.array([0.01, -0.005, -0.005]), 1.0)
    change = np.array(rig.adc()) - straight
    bend = np.array([change[0] - change[2], change[1] - change[3]])
    # Pairs of opposite sensors see the same bend.
    assert change[0] == pytest.approx(-change[2], abs=12)
    assert change[1] == pytest.approx(-change[3], abs=12)
    assert np.argmax(np.abs(bend)) == np.argmax(np.abs(rig.tip))
    assert np.sign(bend[np.argmax(np.abs(bend))]) == np.sign(rig.tip[np.argmax(np.abs(rig.tip))])
