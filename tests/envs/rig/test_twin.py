"""What a twin adds to the test rig's environment: servos and a camera with errors."""

from dataclasses import replace

import numpy as np
import pytest
from support.rig_episodes import rig, steps

from softrobot_env.robots import EQUIVALENT_RIG, RIG
from softrobot_env.robots.twin import nominal_twin, rig3d_twin

# ---------------------------------------------------------------- servos


def test_servos_wind_at_their_speed():
    env = rig(control_period=0.02)
    env.reset()
    *_, info = env.step(np.array([1.0, -0.05, 0.0], np.float32))
    speed = nominal_twin(EQUIVALENT_RIG).servo_speed
    np.testing.assert_allclose(info["tendon_length"], [0.02 * speed, -1.5e-3, 0], atol=1e-9)
    for _ in range(20):
        observation, *_, info = env.step(np.array([1.0, -0.05, 0.0], np.float32))
    np.testing.assert_allclose(info["tendon_length"], [0.03, -1.5e-3, 0], atol=1e-9)
    np.testing.assert_array_equal(observation["tendon_length"], info["tendon_length"])


def test_offsets_and_backlash_of_a_twin_are_applied_and_not_read_by_potentiometers():
    twin = replace(
        nominal_twin(EQUIVALENT_RIG), servo_offset=(1e-3, 0.0, 0.0), backlash=(0.0, 4e-4, 0.0)
    )
    env = rig(twin=twin)
    observation, info = env.reset()
    np.testing.assert_allclose(info["tendon_length"], [1e-3, 0, 0], atol=1e-15)
    np.testing.assert_allclose(observation["tendon_length"], 0, atol=1e-15)
    for _ in range(5):
        observation, *_, info = env.step(np.array([0.1, 0.1, 0.1], np.float32))
    np.testing.assert_allclose(info["tendon_length"], [4e-3, 2.8e-3, 3e-3], atol=1e-9)
    np.testing.assert_allclose(observation["tendon_length"], 3e-3, atol=1e-9)


# ---------------------------------------------------------------- twins and their camera


def test_a_seed_stands_for_its_twin():
    env = rig(twin=5)
    assert env.twin == rig3d_twin(5)
    assert env.task.robot is RIG
    assert env.scene.config.robot == env.twin.robot
    assert rig().twin == nominal_twin(EQUIVALENT_RIG)
    np.testing.assert_allclose(
        env.model.tendon_frictionloss[:3], [t.friction for t in env.twin.robot.tendons]
    )


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_the_camera_sees_late_and_not_exactly(delay):
    noise = 3e-4
    twin = replace(
        nominal_twin(EQUIVALENT_RIG), camera_noise=noise, camera_delay=delay * 0.02 + 0.004
    )
    env, exact = rig(twin=twin), rig()
    observation, info = env.reset(seed=0)
    truth, seen, speed = [info["tip_position"]], [observation["tip_position"]], []
    exact.reset()
    for (observation, *_, info), (other, *_) in zip(
        steps(env, 300), steps(exact, 300), strict=True
    ):
        np.testing.assert_array_equal(info["tip_position"], other["tip_position"])
        error = np.hypot(*(other["tip_position"] - other["reference"]))
        assert info["error"] == pytest.approx(error, rel=1e-12)
        truth.append(info["tip_position"])
        seen.append(observation["tip_position"])
        speed.append(observation["tip_velocity"])
    np.testing.assert_allclose(speed, np.diff(seen, axis=0) / 0.02, atol=1e-12)
    error = np.array(seen[delay:]) - truth[: len(truth) - delay]
    assert np.std(error) == pytest.approx(noise, rel=0.1)
    assert abs(np.mean(error)) < 4 * noise / np.sqrt(error.size)


@pytest.mark.parametrize("period", [0.001, 0.004, 0.01, 0.05])
def test_pictures_come_90_a_second_each_at_the_next_control_instant(period):
    """Exact pictures, two periods late: each new one is the truth of then."""
    env = rig(
        twin=replace(nominal_twin(EQUIVALENT_RIG), camera_delay=2 * period), control_period=period
    )
    _, info = env.reset()
    truth, taken, before = [info["tip_position"]], [], None
    action = np.array([0.5, 0.2, -0.3], np.float32)
    for k in range(1, round(1 / period)):
        observation, *_, info = env.step(action)
        truth.append(info["tip_position"])
        if k < 2 or np.array_equal(observation["tip_position"], before):
            continue
        before = observation["tip_position"]
        np.testing.assert_array_equal(before, truth[k - 2])
        taken.append(k - 2)
        if len(taken) > 2:
            way = truth[taken[-1]] - truth[taken[-2]]
            speed = way / (period * (taken[-1] - taken[-2]))
            np.testing.assert_allclose(observation["tip_velocity"], speed, atol=1e-9)
    frame = max(1 / 90, period)
    late = period * np.array(taken[1:]) - frame * np.arange(1, len(taken))
    assert np.ptp(late) < 1.001 * period
    assert len(taken) == pytest.approx(1 / frame, abs=3)


def test_an_exact_twin_needs_no_camera():
    _, info = rig().reset()
    assert "tip_position" not in info
