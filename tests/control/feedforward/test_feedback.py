"""Feedback of a late tip, on a plant of one mode whose motion is known exactly."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm

from softrobot_env.control.feedforward.feedback import Feedback
from softrobot_env.control.feedforward.statics import Rest
from softrobot_env.robots import RIG

FREQUENCY, DAMPING_TIME = 7.0, 0.07  # rad/s, s
REST = Rest(np.zeros(1))
AWAY = 3.0  # m per share that the robot is softer


def statics():
    """Of a robot whose input is its tip's place."""
    return SimpleNamespace(
        first_mode=lambda: (FREQUENCY, DAMPING_TIME),
        shifted=lambda rest, change, stiffer: (change + AWAY * stiffer, False),
        softened=lambda rest, size, stiffer: np.array([AWAY]),
    )


def errors(period, delay, offset=1.0, duration=20.0, told=None, **more):
    """Tips (n,) that should be at 0 but are pulled `offset` away, and the last state."""
    square = FREQUENCY**2
    rates = np.array([[0, 1, 0], [-square, -DAMPING_TIME * square, square], [0, 0, 0]])
    move = expm(period * rates)
    feedback = Feedback(
        statics(), period, tip_delay=delay * period if told is None else told, **more
    )
    felt, state, seen = feedback.start(np.zeros(1)), np.zeros(3), [0.0] * (delay + 1)
    for _ in range(round(duration / period)):
        tip = np.array([seen[-1 - delay]])
        state[2:], felt, _ = feedback.added(REST, np.zeros(1), tip, felt)
        state[2] += offset
        state = move @ state
        seen.append(state[0])
    return np.array(seen), felt


@pytest.mark.parametrize("learning", [None, RIG])
@pytest.mark.parametrize(("period", "delay"), [(0.02, 0), (0.02, 1), (0.01, 4), (0.05, 2)])
def test_the_tip_comes_to_rest_however_late_it_is_seen(period, delay, learning):
    seen, _ = errors(period, delay, learning=learning)
    assert np.abs(seen[-20:]).max() < 1e-2


def test_gains_that_are_not_told_of_the_delay_are_unstable():
    seen, _ = errors(0.02, 4, told=0.0)
    assert np.abs(seen[-20:]).max() > 1.0


def test_a_robot_that_is_softer_is_learnt():
    """Within three seconds the share, of what the integral holds the rest."""
    _, felt = errors(0.02, 1, offset=0.25 * AWAY, learning=RIG, duration=3.0)
    assert felt.stiffer == pytest.approx(-0.25, rel=0.25)
    _, felt = errors(0.02, 1, offset=0.25 * AWAY, duration=3.0)
    assert felt.stiffer == 0.0
