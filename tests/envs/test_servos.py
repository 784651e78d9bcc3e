"""Servos against the definitions of rate limit and play, and against a small-step simulation."""

import numpy as np
import pytest

from softrobot_env.envs.simulation.servos import Servos

TIMES = 1e-3 * np.arange(1, 21)
NONE = np.zeros(3)


def servos(speed=0.1, offset=NONE, backlash=NONE):
    return Servos(speed, np.asarray(offset, float), np.asarray(backlash, float))


def held(path):
    """(20, 3): after the row of now, and the last row holds."""
    horns = path[1:] if len(path) > 1 else path
    return np.concatenate((horns, np.repeat(horns[-1:], len(TIMES) - len(horns), axis=0)))


def test_the_horn_turns_at_its_speed_and_stops_at_the_command():
    drive = servos()
    horns = held(drive.move(np.array([5e-4, -3e-3, 0.0]), TIMES))
    np.testing.assert_allclose(horns[:, 0], np.minimum(0.1 * TIMES, 5e-4), atol=1e-15)
    np.testing.assert_allclose(horns[:, 1], -0.1 * TIMES, atol=1e-15)
    np.testing.assert_array_equal(horns[:, 2], 0)
    # It goes on where it was.
    horns = held(drive.move(np.array([5e-4, -3e-3, 0.0]), TIMES))
    np.testing.assert_allclose(horns[:, 1], np.maximum(-2e-3 - 0.1 * TIMES, -3e-3), atol=1e-15)


@pytest.mark.parametrize("way", [0.0, 4.9e-4, 5e-4, 2e-3, 1.0])
def test_only_instants_of_motion_are_returned(way):
    horns = servos().move(np.array([0.0, way, 0.0]), TIMES)
    needed = np.flatnonzero(way - 1e-15 <= 0.1 * TIMES)
    assert len(horns) == 1 + (needed[0] + 1 if len(needed) else len(TIMES))
    np.testing.assert_array_equal(horns[0], 0)


def test_offset_adds_to_the_command():
    drive = servos(offset=[1e-3, 0.0, -1e-3])
    drive.start(np.full(3, 5e-3))
    np.testing.assert_allclose(drive.horn, [6e-3, 5e-3, 4e-3], atol=1e-15)
    for _ in range(5):
        horns = drive.move(np.zeros(3), TIMES)
    np.testing.assert_allclose(horns[-1], [1e-3, 0.0, -1e-3], atol=1e-15)


def test_play_is_crossed_before_the_horn_moves():
    width = 4e-4
    drive = servos(speed=1.0, backlash=[width] * 3)
    there = [drive.move(np.full(3, x), TIMES)[-1, 0] for x in np.linspace(0, 2e-3, 41)]
    back = [drive.move(np.full(3, x), TIMES)[-1, 0] for x in np.linspace(2e-3, 0, 41)]
    way = np.linspace(0, 2e-3, 41)
    np.testing.assert_allclose(there, np.maximum(way - width / 2, 0), atol=1e-12)
    np.testing.assert_allclose(
        back, np.minimum(2e-3 - width / 2, way[::-1] + width / 2), atol=1e-12
    )


def test_small_steps_give_the_same_motion():
    """The play of a motor simulated one microsecond at a time."""
    speed, half, rng = 0.13, 1e-4, np.random.default_rng(0)
    drive = servos(speed, backlash=[2 * half] * 3)
    motor, horn = np.zeros(3), np.zeros(3)
    for _ in range(20):
        command = rng.uniform(-3e-3, 3e-3, 3)
        fast = held(drive.move(command, TIMES))
        slow = []
        for _ in TIMES:
            for _ in range(1000):
                motor = motor + np.clip(command - motor, -speed * 1e-6, speed * 1e-6)
                horn = np.where(motor - half > horn, motor - half, horn)
                horn = np.where(motor + half < horn, motor + half, horn)
            slow.append(horn)
        np.testing.assert_allclose(fast, slow, atol=1e-12)
