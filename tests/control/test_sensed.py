"""A policy that is shown what a curvature sensor tells in place of the tip."""

from types import SimpleNamespace

import numpy as np
import pytest

from softrobot_env.control.base import Controller
from softrobot_env.control.registry import make_policy
from softrobot_env.control.sensed import SensedTip
from softrobot_env.robots import RIG
from softrobot_env.sensing.estimation import LightModel

#: A sensor as designed, on a robot whose bend grows in proportion to its tip.
MODEL = LightModel(
    gain=np.ones(4),
    tilt=np.full(4, np.radians(20)),
    azimuth=np.pi / 2 * np.arange(4),
    acceptance=np.radians(20),
    lag=0.0,
    straight=np.zeros(2),
    turn=3.0 * np.eye(2),
    curve=np.zeros(2),
)


class Shown(Controller):
    """Acts by the tip that it is shown."""

    requires = ("tip_position", "previous_action")
    sizes = {"tip_position": 2, "previous_action": 2}  # noqa: RUF012

    def start(self, observation):
        return SimpleNamespace(status=None)

    def act(self, observation, state):
        return 10 * np.nan_to_num(observation["tip_position"]), state


def seen(tip):
    """What an ideal sensor reads."""
    return {"sensors": MODEL.light(3.0 * np.asarray(tip)), "previous_action": np.zeros(2)}


def test_the_policy_is_shown_the_tip_behind_the_light():
    policy, state = SensedTip(Shown(), MODEL, 0.02), None
    for turn in np.linspace(0, 2 * np.pi, 60):
        tip = 0.04 * turn / (2 * np.pi) * np.array([np.cos(turn), np.sin(turn)])
        action, state = policy.predict(seen(tip), state)
        np.testing.assert_allclose(action / 10, tip, atol=5e-4)


def test_episodes_and_their_copies_do_not_share_what_was_felt():
    policy = SensedTip(Shown(), MODEL, 0.02)
    _, state = policy.predict(seen([0.02, 0.01]), None)
    ways = [policy.predict(seen([0.03, 0.0]), state)[0] for _ in range(2)]
    np.testing.assert_array_equal(*ways)


def test_a_reading_that_is_not_finite_tells_of_no_tip():
    policy, state = SensedTip(Shown(), MODEL, 0.02), None
    action, state = policy.predict(seen([np.nan, 0.0]), state)
    np.testing.assert_array_equal(action, np.zeros(2))
    action, _ = policy.predict(seen([0.01, 0.0]), state)
    np.testing.assert_allclose(action / 10, [0.01, 0.0], atol=5e-4)


def test_a_policy_that_reads_no_tip_is_refused():
    with pytest.raises(ValueError, match="does not read tip_position"):
        SensedTip(make_policy("rig_nn", RIG, 0.02), MODEL, 0.02)


def test_a_policy_that_reads_three_coordinates_is_refused():
    policy = Shown()
    policy.sizes = {**Shown.sizes, "tip_position": 3}
    with pytest.raises(ValueError, match="two coordinates"):
        SensedTip(policy, MODEL, 0.02)
