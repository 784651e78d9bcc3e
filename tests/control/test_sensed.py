"""A policy that is shown what curvature sensors tell in place of tip and curvatures."""

from types import SimpleNamespace

import numpy as np
import pytest

from softrobot_env.control.base import Controller
from softrobot_env.control.registry import make_policy
from softrobot_env.control.sensed import Sensed
from softrobot_env.robots import RIG, Sensor
from softrobot_env.sensing.estimation import LightModel
from softrobot_env.sensing.reconstruction import TIP, Map, Reconstruction
from softrobot_env.thesis.envs import RigEnv

#: A sensor as designed, on a robot whose tip grows in proportion to its bend.
LIGHT = LightModel(
    gain=np.ones(4),
    tilt=np.full(4, np.radians(20)),
    azimuth=np.pi / 2 * np.arange(4),
    acceptance=np.radians(20),
    lag=0.0,
    straight=np.zeros(2),
    turn=3.0 * np.eye(2),
    curve=np.zeros(2),
)
LINEAR = Map(np.eye(3, 2, -1, dtype=int), np.eye(3, 2, -1) / 3, np.zeros(2), np.ones(2), 1e-4)
KNOWN = Reconstruction((Sensor("s", "spatial", 0.0, 0.1),), (LIGHT,), None, (0, 1), {TIP: LINEAR})


class Shown(Controller):
    """Acts by the tip that it is shown."""

    requires = (TIP, "previous_action")
    sizes = {TIP: 2, "previous_action": 2}  # noqa: RUF012

    def start(self, observation):
        return SimpleNamespace(status="fine")

    def act(self, observation, state):
        return 10 * observation[TIP], state


class Faster(Shown):
    """Acts by the tip's velocity."""

    requires = ("tip_velocity", "previous_action")
    sizes = {"previous_action": 2}  # noqa: RUF012

    def act(self, observation, state):
        return observation["tip_velocity"], state


class Rarely(Shown):
    """Decides in every third period."""

    hold = 3


def seen(tip):
    """What an ideal sensor reads."""
    return {"sensors": LIGHT.light(3.0 * np.asarray(tip)), "previous_action": np.zeros(2)}


def acted(kind, tips):
    """Actions (k, 2) and states of a policy behind sensors, of readings at tips."""
    policy, state, actions, states = Sensed(kind(), KNOWN, 0.02), None, [], []
    for tip in tips:
        action, state = policy.predict(seen(tip), state)
        actions.append(action)
        states.append(state)
    return np.array(actions), states


def test_the_policy_is_shown_the_tip_behind_the_light():
    turn = np.linspace(0, 2 * np.pi, 60)
    tips = 0.04 * turn[:, None] / (2 * np.pi) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    actions, states = acted(Shown, tips)
    np.testing.assert_allclose(actions / 10, tips, atol=5e-4)
    assert states[-1].status == "fine"


def test_episodes_and_their_copies_do_not_share_what_was_felt():
    policy = Sensed(Shown(), KNOWN, 0.02)
    _, state = policy.predict(seen([0.02, 0.01]), None)
    ways = [policy.predict(seen([0.03, 0.0]), state)[0] for _ in range(2)]
    np.testing.assert_array_equal(*ways)


def test_a_reading_that_is_not_finite_is_passed_over():
    actions, _ = acted(Shown, [(0.01, 0.0), (np.nan, 0.0), (0.02, 0.0)])
    np.testing.assert_allclose(actions[1:] / 10, [[0.01, 0.0], [0.02, 0.0]], atol=5e-4)


def test_rates_are_differences_of_readings():
    # Old readings come again until a new one is there.
    actions, _ = acted(Faster, [(0.0, 0.0)] * 3 + [(0.01, 0.0)])
    assert actions[-1, 0] == pytest.approx(0.01 / 0.06, rel=0.05)


def test_sensors_are_read_while_the_policy_holds_its_action():
    tips = [(x, 0.0) for x in (0.0, 0.01, 0.02, 0.03)]
    actions, states = acted(Rarely, tips)
    reported = [state.shape.reported[TIP][0] for state in states]
    np.testing.assert_allclose(reported, np.array(tips)[:, 0], atol=5e-4)
    x = actions[:, 0]
    assert x[1] == x[2] == x[0] and x[3] == pytest.approx(0.3, abs=5e-3)


def test_what_sensors_do_not_tell_is_refused():
    with pytest.raises(ValueError, match="reads none of tip_position"):
        Sensed(make_policy("rig_nn", RIG, 0.02), KNOWN, 0.02)
    for asked, said in (
        ({"requires": (TIP, "curvature")}, "reads curvature, the sensors were calibrated to tell"),
        ({"sizes": {**Shown.sizes, TIP: 3}}, "reads 3 entries of tip_position"),
    ):
        policy = Shown()
        vars(policy).update(asked)
        with pytest.raises(ValueError, match=said):
            Sensed(policy, KNOWN, 0.02)


def test_policies_by_name_are_given_the_shipped_calibration():
    env = RigEnv("triangle", twin=0, observe=("all", "sensors"))
    policy = make_policy("rig_nn_pi", env, feedback="sensors")
    assert isinstance(policy, Sensed)
    observation, _ = env.reset(seed=0)
    action, _ = policy.predict({name: observation[name] for name in policy.requires})
    assert np.isfinite(action).all() and TIP not in policy.requires
    assert not isinstance(make_policy("rig_nn", env, feedback="sensors"), Sensed)
    env.close()
