"""The model predictive controllers as policies, and their closed loops."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.metrics import step_metrics, tracking_metrics
from softrobot_env.evaluation.run import run_episode
from softrobot_env.robots import ARM
from softrobot_env.thesis.arm.mpc import MPC
from softrobot_env.thesis.arm.mpc_settings import PREVIEW, THESIS

POLICIES = ("mpc", "mpc_preview")

#: Tip of an arm bent by 1/m everywhere, a circular arc of 0.5 rad.
TIP = np.array([1 - np.cos(0.5), np.sin(0.5)])
NEARBY = (TIP[0] + 2e-3, TIP[1] - 1e-3)


def build(name, robot=ARM):
    return make_policy(name, robot, policy_environment(name)["control_period"])


@pytest.fixture(params=POLICIES)
def policy(request):
    return build(request.param)


def observe(reference=NEARBY, curvature=1.0, **changed):
    """A bent arm at rest and a resting reference."""
    reference = np.asarray(reference, dtype=float)
    observation = {
        "curvature": np.full(6, curvature),
        "curvature_rate": np.zeros(6),
        "tip_position": TIP,
        "reference": reference,
        "reference_preview": np.tile(reference, len(PREVIEW.steps)),
        "previous_action": np.full(3, 0.06),
    }
    return observation | changed


def run(name, task, plant=None, **options):
    env = TrackingEnv(task, observe="all", plant=plant, **policy_environment(name))
    return run_episode(env, build(name), options=options)


def step_response(name, width, plant=None, **options):
    rollout = run(name, "step", plant, step_width=width, duration=3.0, **options)
    return step_metrics(rollout.time, rollout.tip, rollout.reference[-1])


# ---------------------------------------------------------------- as policies


def test_single_and_stacked_observations_give_the_same_actions(policy):
    observations = [observe(), observe((-0.1, 0.48), curvature=-0.5)]
    single, states = zip(*(policy.predict(o) for o in observations), strict=True)
    stacked = {name: np.stack([o[name] for o in observations]) for name in observations[0]}
    actions, together = policy.predict(stacked)
    assert actions.shape == (2, 3) and actions.dtype == np.float32
    np.testing.assert_array_equal(actions, single)
    again = [policy.predict(o, s)[0] for o, s in zip(observations, states, strict=True)]
    np.testing.assert_array_equal(policy.predict(stacked, together)[0], again)


def test_state_is_not_changed_in_place():
    for settings in (THESIS, PREVIEW):
        policy = MPC(ARM, settings.period, settings)
        _, state = policy.predict(observe())
        moved = observe((0.22, 0.43), curvature=1.1)
        first, _ = policy.predict(moved, state)
        second, _ = policy.predict(moved, state)
        np.testing.assert_array_equal(first, second)


def test_thesis_controller_decides_every_tenth_of_a_second():
    policy = make_policy("mpc", ARM, 0.01)
    action, state = policy.predict(observe())
    for _ in range(9):
        held, state = policy.predict(observe((-0.1, 0.48)), state)
        np.testing.assert_array_equal(held, action)
    decided, _ = policy.predict(observe((-0.1, 0.48)), state)
    assert np.abs(decided - action).max() > 0.1


@pytest.mark.parametrize("settings", [THESIS, PREVIEW], ids=POLICIES)
def test_weights_do_not_depend_on_how_forces_are_geared(settings):
    """Half the lever arms and twice the tensions are the same robot to its actions."""

    def geared(tendon):
        offset = tuple(x / 2 for x in tendon.offset)
        return replace(tendon, offset=offset, tension_limit=2 * tendon.tension_limit)

    other = replace(ARM, tendons=tuple(geared(t) for t in ARM.tendons))
    actions = [
        MPC(robot, settings.period, settings).predict(observe())[0] for robot in (ARM, other)
    ]
    np.testing.assert_allclose(actions[1], actions[0], rtol=1e-3)


def test_other_periods_are_refused():
    with pytest.raises(ValueError, match=r"decides every 0\.1 s"):
        make_policy("mpc", ARM, 0.03)


def test_other_previews_are_refused():
    bad = observe(reference_preview=np.zeros(8))
    with pytest.raises(ValueError, match=r"give the environment preview=\(0.005, 0.01, 0.02"):
        build("mpc_preview").predict(bad)


def test_missing_package_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "daqp", None)
    with pytest.raises(ImportError, match=r'pip install "daqp>='):
        build("mpc")


# ---------------------------------------------------------------- where no optimum is found


@pytest.mark.parametrize("settings", [THESIS, PREVIEW], ids=POLICIES)
def test_action_is_kept_without_a_finite_observation(settings):
    policy = MPC(ARM, settings.period, settings)
    action, state = policy.predict(observe())
    for name in policy.requires:
        bad = observe()
        bad[name] = np.full_like(bad[name], np.nan)
        kept, told = policy.predict(bad, state)
        assert told.status == f"observation not finite: {name}"
        np.testing.assert_array_equal(kept, action)
        after, recovered = policy.predict(observe(), told)
        assert recovered.status is None and np.all(np.isfinite(after))


def test_first_action_without_a_finite_observation(policy):
    bad = observe(curvature=np.nan)
    action, state = policy.predict(bad)
    np.testing.assert_allclose(action, 0.06)
    assert getattr(state, "status", None) == "observation not finite: curvature"


@pytest.mark.parametrize(
    ("settings", "observation", "reason"),
    [
        (replace(THESIS, iterations=0), observe(), "not converged in 0 iterations"),
        (replace(THESIS, iterations=1), observe((-0.3, 0.3)), "not converged in 1 iterations"),
        (THESIS, observe(curvature_rate=np.full(6, 1e200)), "prediction failed"),
    ],
)
def test_action_is_kept_where_the_optimisation_fails(settings, observation, reason):
    policy = MPC(ARM, settings.period, settings)
    action, state = policy.predict(observation)
    assert state.status == f"last action kept: {reason}"
    np.testing.assert_allclose(action, observation["previous_action"])


@pytest.mark.parametrize("settings", [THESIS, PREVIEW], ids=POLICIES)
def test_after_a_failure_the_next_decision_begins_anew(settings):
    policy = MPC(ARM, settings.period, settings)
    action, state = policy.predict(observe())
    kept, state = policy.predict(observe(curvature_rate=np.full(6, 1e200)), state)
    np.testing.assert_array_equal(kept, action)
    assert state.status == "last action kept: prediction failed"
    after, state = policy.predict(observe(), state)
    assert state.status is None
    np.testing.assert_array_equal(after, action)  # the same problem, begun from the same inputs


def test_tension_limit_is_kept_and_told():
    tendons = tuple(replace(t, tension_limit=6.0) for t in ARM.tendons)
    policy = MPC(replace(ARM, tendons=tendons), THESIS.period)
    action, state = policy.predict(observe((0.3, 0.37)))
    assert state.status == "tension limit reached"
    assert np.abs(action).max() == 1.0


# ---------------------------------------------------------------- thesis, on its own plant


@pytest.mark.parametrize("width", [0.05, 0.2])
def test_thesis_controller_steps_as_recomputed(width):
    """Audit sec. 3: rise 0.09 s, settling 0.85-1.0 s, overshoot 28-29 %, no steady error."""
    metrics = step_response("mpc", width, BeamPlant("pcc"))
    assert metrics.rise_time == pytest.approx(0.09, abs=0.01)
    assert metrics.settling_time == pytest.approx(0.93, abs=0.12)
    assert metrics.overshoot == pytest.approx(0.28, abs=0.015)
    assert metrics.steady_state_error < 1e-4


def test_thesis_controller_lags_on_the_swing_as_recomputed():
    """Audit sec. 3: at most 12.8 mm, 8.9 mm in motion: one period of 0.1 s at 0.1 m/s."""
    rollout = run("mpc", "swing", BeamPlant("pcc"), duration=6.0)
    assert tracking_metrics(rollout).e_max == pytest.approx(12.8e-3, abs=0.3e-3)
    moving = (rollout.time > 1.0) & (rollout.time < 6.0)
    assert rollout.error[moving].mean() == pytest.approx(8.9e-3, abs=0.5e-3)


def test_thesis_controller_on_the_lshape_as_recomputed():
    rollout = run("mpc", "lshape", BeamPlant("pcc"))
    assert tracking_metrics(rollout).e_max == pytest.approx(2.6e-3, abs=0.1e-3)


@pytest.mark.parametrize(("scale", "least"), [(0.5, 40e-3), (1.5, 40e-3)])
def test_thesis_controller_fails_on_another_stiffness(scale, least):
    """Audit sec. 3: the tip is lost at half the stiffness and stays too high at 1.5 times."""
    vary = {"youngs_modulus": scale}
    rollout = run("mpc", "swing", BeamPlant("pcc"), duration=12.0, vary=vary)
    assert rollout.error[rollout.time > 9.0].max() > least
    if scale > 1:
        assert rollout.tip[-1, 2] > rollout.reference[-1, 2] + 0.02


# ---------------------------------------------------------------- with preview, on MuJoCo's arm


@pytest.mark.parametrize(
    ("task", "duration", "e_max"),
    [pytest.param("swing", 12.0, 0.8e-3, marks=pytest.mark.slow), ("lshape", 6.0, 0.4e-3)],
)
def test_preview_follows_closely(task, duration, e_max):
    """Errors are largest at the start, in the L's corner (5 s) and at the swing's end (10 s)."""
    metrics = tracking_metrics(run("mpc_preview", task, duration=duration))
    assert metrics.e_max < e_max and metrics.e_rms < 0.1e-3


@pytest.mark.parametrize("width", [0.05, 0.2])
def test_preview_steps_without_much_overshoot(width):
    metrics = step_response("mpc_preview", width)
    assert metrics.overshoot < 0.04
    assert metrics.settling_time < 0.25
    assert metrics.steady_state_error < 1e-4


@pytest.mark.parametrize("scale", [0.5, pytest.param(1.5, marks=pytest.mark.slow)])
def test_preview_adapts_to_the_stiffness(scale):
    """The arm starts out of balance, of which the controller knows nothing before it moves."""
    vary = {"youngs_modulus": scale}
    rollout = run("mpc_preview", "swing", duration=3.0, vary=vary)
    assert rollout.error.max() < 1.2e-3
    assert rollout.error[rollout.time > 0.5].max() < 0.3e-3
    assert step_response("mpc_preview", 0.05, vary=vary).overshoot < 0.05
