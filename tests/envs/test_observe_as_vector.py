"""One vector in place of a dict, changes in place of inputs: every id, every robot."""

from functools import partial
from math import asinh

import gymnasium
import numpy as np
import pytest
from support.example_robots import EVERY_ROBOT
from support.real_episodes import live_rig

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.control.registry import make_policy
from softrobot_env.envs.observations.table import FAR, NEAR
from softrobot_env.envs.real import RealRigEnv
from softrobot_env.envs.rewards import LogReward, TrackingReward
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.robots import ARM
from softrobot_env.scene.timestep import slowest


def make(env_id, **options):
    return gymnasium.make(env_id, observe_as="vector", **options)


# ---------------------------------------------------------------- the contract


@EVERY_ROBOT
def test_entries_are_of_order_1_and_inside_the_space(env_id, options):
    env = make(env_id, observe="all", **options)
    space, rng = env.observation_space, np.random.default_rng(0)
    # A rate bound is 1e9 times its scale where the backbone is a thin wire; asinh(1e9) = 21.
    assert space.dtype == np.float32 and np.abs([space.low, space.high]).max() < 25
    seen = [env.reset(seed=0)[0]]
    for _ in range(10):
        action = rng.uniform(-1, 1, env.action_space.shape)
        observation, _, over, _, _ = env.step(action)
        seen.append(observation)
        if over:
            break
    assert all(space.contains(one) for one in seen)
    near = env.unwrapped.vector_layout["tracking_error_near"]
    assert np.abs(np.delete(seen, near, axis=1)).max() < 4
    assert np.abs(np.array(seen)[:, near]).max() < asinh(2 / NEAR)


def test_the_real_rig_shows_what_the_simulated_one_does():
    with live_rig(partial(RealRigEnv, "triangle"), observe_as="vector") as real:
        simulated = make("SoftRobot/RigTriangle-v0")
        assert real.observation_space == simulated.observation_space
        assert real.vector_layout == simulated.unwrapped.vector_layout
        seen, _ = real.reset()
        assert real.observation_space.contains(seen)
        real.step(np.ones(3))
        seen, *_ = real.step(np.ones(3))
        change = slowest(real.task.robot, winding=True) * real.control_period
        action = np.sinh(seen[real.vector_layout["previous_action"]]) / 2
        np.testing.assert_allclose(action, 2 * change, rtol=1e-5)


# ---------------------------------------------------------------- what the entries say


def test_entries_by_hand():
    env = make("SoftRobot/ArmSwing-v0").unwrapped
    plain = TrackingEnv("swing")
    vector, _ = env.reset()
    seen, _ = plain.reset()
    error = seen["reference"] - seen["tip_position"]
    ahead = seen["reference_preview"] - np.tile(seen["reference"], 4)
    sway = slowest(ARM, winding=False) * ARM.length / 20  # m/s
    expected = {
        "tracking_error": error / (FAR * ARM.length),
        "tracking_error_near": error / (NEAR * ARM.length),
        "tip_position": seen["tip_position"] / (ARM.length / 2),
        "reference_velocity": seen["reference_velocity"] / sway,
        "reference_preview": ahead / (ARM.length / 20),
        "curvature": seen["curvature"] * ARM.length / 2,
        "previous_action": seen["previous_action"] * 2,
    }
    for name, value in expected.items():
        entries = vector[env.vector_layout[name]]
        np.testing.assert_allclose(entries, np.arcsinh(value), rtol=1e-6, atol=1e-6, err_msg=name)
    assert set(env.vector_layout) == {*expected, "tip_velocity", "curvature_rate"}


def test_a_millimetre_is_seen():
    """Two references 1 mm apart, from the same tip."""
    env = make("SoftRobot/ArmStep-v0").unwrapped
    one, _ = env.reset(options={"step_width": 0.05})
    other, _ = env.reset(options={"step_width": 0.051})
    near = env.vector_layout["tracking_error_near"]
    assert np.linalg.norm(one[near] - other[near]) > 0.01
    env.reset(options={"start_input": env.task.start_input, "step_width": 1e-3})
    there, _ = env.reset(options={"step_width": 1e-3})
    assert np.linalg.norm(there[near]) > 0.5


def test_observe_chooses_the_entries():
    env = make("SoftRobot/ArmSwing-v0", observe=("tip_position", "reference_preview")).unwrapped
    assert list(env.vector_layout) == ["reference_preview", "tip_position"]
    vector, _ = env.reset()
    seen, _ = TrackingEnv("swing").reset()
    # Nothing to be relative to: from the base, over half of the reach.
    wanted = np.arcsinh(seen["reference_preview"] / (ARM.length / 2))
    np.testing.assert_allclose(vector[:8], wanted, rtol=1e-6, atol=1e-6)


# ---------------------------------------------------------------- what comes with it


def test_actions_change_the_inputs_in_force():
    env = TrackingEnv("swing", act_as="change")
    change = slowest(ARM, winding=False) * env.control_period
    before = env.reset()[0]["previous_action"]
    after = env.step(np.array([1.0, 0.0, -0.5]))[0]["previous_action"]
    np.testing.assert_allclose(after - before, change * np.array([1.0, 0.0, -0.5]), rtol=1e-9)
    for _ in range(60):
        after = env.step(np.array([1.0, 0.0, 0.0]))[0]["previous_action"]
        if after[0] == 1:
            break
    assert after[0] == 1  # never beyond full scale


def test_defaults_follow_the_vector_and_can_be_told_otherwise():
    assert make("SoftRobot/ArmStep-v0").unwrapped._reward == LogReward.of(ARM)
    env = make("SoftRobot/ArmStep-v0", reward="tracking", act_as="input").unwrapped
    assert env._reward == TrackingReward() == TrackingEnv("step")._reward
    env.reset()
    env.step(np.full(3, 0.25))
    np.testing.assert_array_equal(env._action, 0.25)


def test_the_log_reward_asks_for_less_error_at_every_scale():
    reward = LogReward.of(ARM)
    earned = [reward.terms(e, [0.0], [0.0])[0] for e in (2 * ARM.length, 0.1, 0.05, 2e-3, 1e-3, 0)]
    assert earned[0] == pytest.approx(0) and earned[-1] == reward.tracking
    far, near = earned[2] - earned[1], earned[4] - earned[3]
    assert 0.5 < near / far < 1
    batch = reward.batch_terms(np.array([0.05]), np.zeros((1, 1)), np.zeros((1, 1)))
    assert batch["reward_tracking"][0] == pytest.approx(earned[2])


def test_policies_by_name_refuse_what_they_do_not_know():
    for options in ({"observe_as": "vector"}, {"act_as": "change"}):
        env = TrackingEnv("swing", **options)
        with pytest.raises(ValueError, match="policy 'hold' reads dicts and chooses inputs"):
            make_policy("hold", env)
    with pytest.raises(ValueError, match="recording needs a dict"):
        run_episode(make("SoftRobot/ArmSwing-v0"), make_policy("hold", ARM, 0.01))


def test_beam_models_show_the_same_vector():
    chain, beam = (make("SoftRobot/ArmSwing-v0", plant=plant) for plant in (None, BeamPlant("pcc")))
    assert chain.observation_space == beam.observation_space
    # Their tips rest 0.3 mm apart: 0.3 near scales of the error, 0.006 far ones.
    seen, other = chain.reset()[0], beam.reset()[0]
    near = chain.unwrapped.vector_layout["tracking_error_near"]
    np.testing.assert_allclose(np.delete(seen, near), np.delete(other, near), atol=0.02)
    np.testing.assert_allclose(seen[near], other[near], atol=0.5)
