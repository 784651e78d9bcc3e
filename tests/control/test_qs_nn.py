"""The quasi-static controller with the weights that the package ships."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.beams.registry import BeamPlant
from softrobot_env.cli import main
from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.core.files import models_dir
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.metrics import step_metrics
from softrobot_env.evaluation.run import run_episode
from softrobot_env.learned.network import Network, suits
from softrobot_env.robots import ARM
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.thesis.arm import quasi_static
from softrobot_env.thesis.arm.qs_nn import QuasiStaticNetwork
from softrobot_env.training.registry import TRAININGS

STATICS = ConstantCurvatureStatics(ARM)
SCALE = TendonMap(ARM).input_scale
WEIGHTS = models_dir() / "qs_nn.npz"


@pytest.fixture(scope="module")
def policy():
    return QuasiStaticNetwork(ARM, 0.2)


@pytest.fixture(scope="module")
def slow_policy():
    return make_policy("qs_nn", ARM, 0.01)


@pytest.fixture(scope="module")
def network():
    return Network.load(WEIGHTS)[0]


def observe(tip, target, inputs):
    return {
        "tip_position": np.array(tip, dtype=float),
        "reference_preview": np.array(target, dtype=float),
        "previous_action": np.asarray(inputs, dtype=float) / SCALE,
    }


def at_rest(inputs):
    tip = STATICS.tip(np.asarray(inputs, dtype=float))
    return observe(tip, tip, inputs)


# ---------------------------------------------------------------- the network


def test_one_step_is_that_of_the_inverse_statics(network):
    """(6.17) with exact statics, for small steps of 3.6 mm (rms)."""
    rng = np.random.default_rng(0)
    inputs = rng.uniform(-15, 15, (500, 3))
    missed, asked = [], []
    for u in inputs:
        jacobian, tip = STATICS.jacobian(u), STATICS.tip(u)
        change = np.linalg.pinv(jacobian) @ jacobian @ rng.uniform(-0.3, 0.3, 3)
        target = STATICS.tip(u + change)
        reached = STATICS.tip(network(np.concatenate((tip, target, u))[None])[0])
        missed.append(np.linalg.norm(reached - target))
        asked.append(np.linalg.norm(target - tip))
    assert np.sqrt(np.mean(np.square(asked))) > 3e-3
    assert np.sqrt(np.mean(np.square(missed))) < 0.3e-3


def test_the_noise_keeps_the_feedback_below_the_limit_of_stability(network):
    """A step of gain one on z_k, every 0.2 s, excites the first mode: stable below 0.256."""
    gains = []
    for u in np.outer(np.linspace(-15, 15, 20), np.ones(3)):
        tip, h = STATICS.tip(u), 1e-5
        inputs = np.concatenate((tip, tip, u))
        x = inputs + h * np.array([[1.0], [-1.0]])[:, :, None] * np.eye(2, 7)
        slope = (network(x[0]) - network(x[1])).T / (2 * h)
        gains.append(np.linalg.eigvals(-STATICS.jacobian(u) @ slope).real.max())
    assert np.median(gains) < 0.256
    assert np.mean(gains) > -0.02  # not fed back the wrong way round


# ---------------------------------------------------------------- the policy


def test_action_is_the_network_of_the_observation(policy, network):
    rng = np.random.default_rng(1)
    for u in rng.uniform(-15, 15, (20, 3)):
        tip, target = STATICS.tip(u), STATICS.tip(u + 0.3)
        action, state = policy.predict(observe(tip, target, u), None)
        expected = network(np.concatenate((tip, target, u))[None])[0] / SCALE
        np.testing.assert_allclose(action, expected, atol=1e-7)
        assert state.status is None and action.dtype == np.float32


def test_decides_every_fifth_of_a_second(slow_policy):
    state, actions = None, []
    for k in range(41):
        tip = STATICS.tip(np.full(3, 5.0)) + 1e-3 * np.sin(k)
        action, state = slow_policy.predict(observe(tip, tip, np.full(3, 5.0)), state)
        actions.append(action)
    changes = 1 + np.flatnonzero(np.any(np.diff(actions, axis=0) != 0, axis=1))
    np.testing.assert_array_equal(changes, [20, 40])


def test_actions_stay_within_the_tension_limit():
    tendons = tuple(replace(t, tension_limit=10.0) for t in ARM.tendons)
    policy = QuasiStaticNetwork(replace(ARM, tendons=tendons), 0.2)
    u = np.full(3, 9.9)
    observation = observe(STATICS.tip(u), STATICS.tip(u + 0.5), u * SCALE / 10)
    action, state = policy.predict(observation, None)
    assert state.status == "tension limit reached"
    assert action.max() == 1.0


def test_a_reference_outside_the_workspace_is_told_and_tried(policy):
    start = STATICS.tip(np.full(3, 5.0))
    action, state = policy.predict(observe(start, (0.24, 0.30), (5, 5, 5)), None)
    assert state.status == "outside the trained workspace"  # the corner of the L-shape
    at_start = policy.predict(at_rest((5, 5, 5)), None)[0]
    assert np.all(np.isfinite(action)) and np.abs(action - at_start).max() > 0.01


@pytest.mark.parametrize("name", QuasiStaticNetwork.requires)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_bad_observations_keep_the_action(policy, name, bad):
    _, state = policy.predict(at_rest((5, 5, 5)), None)
    observation = at_rest((6, 6, 6))
    observation[name][1] = bad
    action, state = policy.predict(observation, state)
    in_force = np.where(np.isfinite(observation["previous_action"]), 6 / 80, 0)
    np.testing.assert_allclose(action, in_force, atol=1e-8)
    assert state.status == f"observation not finite: {name}"
    first, _ = policy.predict(observation, None)
    assert np.all(np.isfinite(first))
    recovered, state = policy.predict(at_rest((6, 6, 6)), state)
    np.testing.assert_array_equal(recovered, policy.predict(at_rest((6, 6, 6)), None)[0])
    assert state.status is None


# ---------------------------------------------------------------- what is refused


def test_another_preview_is_refused(policy):
    observation = at_rest((5, 5, 5)) | {"reference_preview": np.zeros(8)}
    with pytest.raises(ValueError, match=r"preview=\(0.2,\)"):
        policy.predict(observation, None)


def test_another_robot_is_refused():
    with pytest.raises(ValueError, match="softrobot train qs_nn"):
        QuasiStaticNetwork(ARM.vary(youngs_modulus=0.5), 0.2)
    with pytest.raises(ValueError, match="'other'"):
        QuasiStaticNetwork(replace(ARM, name="other"), 0.2)


def test_other_periods_and_missing_files_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"divides it, not 0\.03"):
        QuasiStaticNetwork(ARM, 0.03)
    with pytest.raises(FileNotFoundError, match="softrobot train qs_nn"):
        QuasiStaticNetwork(ARM, 0.2, tmp_path / "none.npz")


# ---------------------------------------------------------------- training command


def test_training_command_writes_what_the_policy_loads(tmp_path, capsys, monkeypatch):
    few = quasi_static.Sampling(pairs=200)
    monkeypatch.setattr(quasi_static, "Sampling", lambda: few)
    monkeypatch.setattr(quasi_static, "HIDDEN", (4,))
    assert main(["train", "qs_nn", "--seed", "7", "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "effective parameters" in out and "rms error, fresh data" in out
    action, _ = QuasiStaticNetwork(ARM, 0.2, tmp_path / "qs_nn.npz").predict(at_rest((5, 5, 5)))
    assert np.all(np.isfinite(action))
    _, about = Network.load(tmp_path / "qs_nn.npz")
    assert about["seed"] == 7


def test_training_command_says_what_can_be_trained(capsys):
    with pytest.raises(SystemExit):
        main(["train", "nothing"])
    told = capsys.readouterr().err
    assert all(name in told for name in TRAININGS)


def test_shipped_file_says_what_it_is():
    network, about = Network.load(WEIGHTS)
    assert network.sizes == (7, 30, 3)
    assert suits(about, ARM)
    assert about["seed"] == 0
    assert WEIGHTS.with_suffix(".md").read_text("utf-8").count("softrobot train qs_nn") > 0


# ---------------------------------------------------------------- closed loop


def environment(task):
    return TrackingEnv(task, observe="all", plant=BeamPlant("pcc"), **policy_environment("qs_nn"))


def test_step_of_50_mm(slow_policy):
    """Thesis: rise 0.237 s, settling 7.65 s, overshoot 47.5 %; audit: 6.7 to 12 s, 61 to 69 %."""
    rollout = run_episode(environment("step"), slow_policy, options={"duration": 25.0})
    metrics = step_metrics(rollout.time, rollout.tip, rollout.reference[-1])
    assert rollout.failure is None
    assert 0.22 < metrics.rise_time < 0.26
    assert 5.0 < metrics.settling_time < 12.0
    assert 0.55 < metrics.overshoot < 0.72
    assert metrics.steady_state_error < 0.02


def test_swing(slow_policy):
    """Thesis: 27.3 mm at most; audit: 14 to 18 mm, in the first second."""
    rollout = run_episode(environment("swing"), slow_policy)
    assert rollout.failure is None
    assert 14e-3 < rollout.error.max() < 18e-3
    assert rollout.time[rollout.error.argmax()] < 2.0
    assert rollout.error[-1] < 5e-3


def test_swing_is_lost_with_a_softer_arm(slow_policy):
    """Thesis sec. 6.6.3: the quasi-static controller fails when E falls by a quarter."""
    options = {"vary": {"youngs_modulus": 0.75}}
    rollout = run_episode(environment("swing"), slow_policy, options=options)
    assert rollout.error.max() > 0.1
