import numpy as np
import pytest

from softrobot_env.control.observers import arm_observer
from softrobot_env.control.registry import make_policy
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.robots import ARM

PERIOD = 0.001


@pytest.fixture(scope="module")
def motion():
    """Curvatures and rates (T, 6) of MuJoCo's arm under smooth inputs, and the actions before."""
    env = TrackingEnv("step", control_period=PERIOD, observe="all")

    def record(**vary):
        observation, _ = env.reset(options={"vary": vary})
        out = [observation]
        for k in range(1500):
            turn = 0.1 * np.sin(2 * np.pi * PERIOD * k * np.array([1.0, 1.7, 2.3]))
            observation, *_ = env.step((0.06 + turn).astype(np.float32))
            out.append(observation)
        names = ("curvature", "curvature_rate", "previous_action")
        return tuple(np.stack([o[name] for o in out]) for name in names)

    return record


def observe(observer, curvature, actions):
    """Estimated rates (T, 6)."""
    estimate = observer.start(curvature[0])
    out = [estimate[1]]
    for measured, action in zip(curvature[1:], actions[1:], strict=True):
        estimate = observer.update(estimate, action, measured)
        out.append(estimate[1])
    return np.array(out)


@pytest.mark.parametrize("factor", [0.5, 1.0, 1.5])
def test_rates_are_found_also_for_another_stiffness(motion, factor):
    curvature, rate, actions = motion(youngs_modulus=factor)
    found = observe(arm_observer(ARM, PERIOD), curvature, actions)
    later = slice(200, None)
    assert rms(found[later] - rate[later]) < 0.05 * rms(rate[later])


def test_noise_is_kept_off_better_than_by_differences(motion):
    curvature, rate, actions = motion()
    noise = 0.01
    measured = curvature + noise * np.random.default_rng(0).normal(size=curvature.shape)
    found = observe(arm_observer(ARM, PERIOD), measured, actions)
    differences = np.diff(measured, axis=0) / PERIOD
    error = rms(found[200:] - rate[200:])
    assert error < 0.4 * rms(differences[199:] - rate[200:])


@pytest.mark.parametrize("size", [1.0, 20.0])
def test_outliers_are_ignored(motion, size):
    curvature, rate, actions = motion()
    measured = curvature.copy()
    measured[700, 2] += size
    found = observe(arm_observer(ARM, PERIOD), measured, actions)
    assert rms(found[701:] - rate[701:]) < 0.05 * rms(rate[701:])


def test_a_wrong_estimate_begins_anew(motion):
    """What is measured differs for good: after a few samples it is believed."""
    curvature, rate, actions = motion()
    observer = arm_observer(ARM, PERIOD)
    estimate = observer.start(curvature[0] + 10.0)
    for k in range(1, 400):
        estimate = observer.update(estimate, actions[k], curvature[k])
    np.testing.assert_allclose(estimate[0], curvature[399], atol=0.1)
    assert rms(estimate[1] - rate[399]) < 0.3 * rms(rate)


def rms(values):
    """Root mean square."""
    return np.sqrt(np.mean(values**2))


@pytest.mark.parametrize("period", [0.001, 0.01, 0.1, 0.2])
def test_observer_is_stable_at_every_control_period(period):
    """From a wrong start it comes to the rest that is measured."""
    observer = arm_observer(ARM, period)
    estimate = observer.start(np.zeros(6))
    curvature = np.repeat([3.0, 2.0, 1.0], 2)
    action = np.full(3, ARM.bending_stiffness / 0.025 / 80)
    for _ in range(round(max(3.0, 100 * period) / period)):
        estimate = observer.update(estimate, action, curvature)
    np.testing.assert_allclose(estimate[0], curvature, atol=0.01)
    np.testing.assert_allclose(estimate[1], 0, atol=0.05)


def test_output_feedback_asks_for_no_rates():
    policy = make_policy("lqi", ARM, PERIOD, "output")
    assert "curvature_rate" not in policy.requires and "curvature" in policy.requires
    assert type(make_policy("feedforward", ARM, PERIOD, "output")).__name__ == "Feedforward"
    with pytest.raises(ValueError, match="choose from state, output"):
        make_policy("lqi", ARM, PERIOD, "tip")
