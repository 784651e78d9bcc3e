"""Rewards by hand, and in the environments."""

from math import dist, e, exp

import numpy as np
import pytest

from softrobot_env.envs.rewards import TERMS, TrackingReward

USUAL = TrackingReward()
OWN = TrackingReward(0.1, 0.01, tracking=2, precision=3, effort=5, smoothness=7)


@pytest.mark.parametrize(
    ("reward", "error", "action", "previous", "expected"),
    [
        (USUAL, 0.0, [0, 0, 0], [0, 0, 0], (0.5, 0.5, 0, 0)),
        (USUAL, 0.05, [0, 0, 0], [0, 0, 0], (0.5 / e, 0.5 * exp(-10), 0, 0)),
        (USUAL, 0.005, [1, 1, 1], [1, 1, 1], (0.5 * exp(-0.1), 0.5 / e, -0.01, 0)),
        # mean(a^2) = (1 + 1 + 1/4) / 3, mean((a - p)^2) = (4 + 4 + 0) / 3
        (USUAL, 0.0, [1, -1, 0.5], [-1, 1, 0.5], (0.5, 0.5, -0.0075, -0.4 / 3)),
        (USUAL, 0.0, [1, 1, 1], [-1, -1, -1], (0.5, 0.5, -0.01, -0.2)),
        (OWN, 0.1, [0.5] * 3, [0, 0, 0], (2 / e, 3 * exp(-10), -5 * 0.25, -7 * 0.25)),
    ],
)
def test_by_hand(reward, error, action, previous, expected):
    _, terms = reward.terms(error, action, previous)
    assert tuple(terms) == TERMS
    np.testing.assert_allclose(list(terms.values()), [*expected, 0], rtol=1e-12, atol=1e-15)


def test_failed_terms():
    reward, terms = TrackingReward().failed_terms()
    assert terms == dict(zip(TERMS, (0, 0, 0, 0, -10), strict=True)) and reward == -10
    reward, terms = TrackingReward(failure=-1.0).failed_terms()
    assert terms["reward_failure"] == reward == -1.0


def test_no_success_is_worse_than_a_failure():
    """The penalty exceeds what a step can lose, so that giving up never pays within a step."""
    worst, _ = TrackingReward().terms(2.0, [1, 1, 1], [-1, -1, -1])
    assert TrackingReward().failed_terms()[0] < worst


def test_environments_return_the_sum_of_the_documented_terms(env_id, make_env):
    env = make_env(env_id, observe="all")
    observation, info = env.reset()
    assert all(info[name] == 0 for name in TERMS)
    rng = np.random.default_rng(4)
    previous = observation["previous_action"]
    for _ in range(50):
        action = rng.uniform(-0.3, 0.3, 3).astype(np.float32)
        observation, reward, *_, info = env.step(action)
        assert reward == sum(info[name] for name in TERMS)
        error = dist(observation["tip_position"], observation["reference"])
        _, expected = TrackingReward().terms(error, action.astype(float), previous)
        for name, value in expected.items():
            assert info[name] == pytest.approx(value, rel=1e-9, abs=1e-15), name
        assert info["error"] == pytest.approx(error, rel=1e-9)
        previous = action.astype(float)


def test_a_reward_of_ones_own(make_env):
    env = make_env(reward=TrackingReward(tracking=0, precision=0, effort=1.0, smoothness=0))
    env.reset()
    _, reward, *_ = env.step(np.array([1, 0, 0], np.float32))
    assert reward == pytest.approx(-1 / 3)
