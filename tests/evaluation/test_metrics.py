import numpy as np
import pytest
from support.rollouts import made_rollout

from softrobot_env.evaluation.metrics import step_metrics, tracking_metrics

START, TARGET = np.array([0.1, 0.0, 0.4]), np.array([0.16, 0.0, 0.32])


def along(response):
    """Tip positions for a response that goes from 0 to 1 on the way."""
    return START + np.outer(response, TARGET - START)


def second_order(time, zeta, omega):
    damped = omega * np.sqrt(1 - zeta**2)
    phase = np.arccos(zeta)
    return 1 - np.exp(-zeta * omega * time) / np.sqrt(1 - zeta**2) * np.sin(damped * time + phase)


@pytest.mark.parametrize("zeta", [0.2, 0.5])
def test_second_order_step_response(zeta):
    time = np.arange(0, 40, 1e-3)
    omega = 3.0
    metrics = step_metrics(time, along(second_order(time, zeta, omega)), TARGET)
    exact = np.exp(-np.pi * zeta / np.sqrt(1 - zeta**2))
    assert metrics.overshoot == pytest.approx(exact, rel=1e-4)
    assert metrics.steady_state_error == pytest.approx(0, abs=1e-6)
    # The envelope bounds the settling time from above; it is left at most half a swing earlier.
    envelope = -np.log(0.02 * np.sqrt(1 - zeta**2)) / (zeta * omega)
    swing = np.pi / (omega * np.sqrt(1 - zeta**2))
    assert envelope - swing < metrics.settling_time <= envelope


@pytest.mark.parametrize(
    ("response", "rise", "settling", "left"),
    [
        (lambda t: 1 - np.exp(-t / 2), 2 * np.log(9), 2 * np.log(50), 0),
        # Rise and settling refer to the steady-state value, so they do not change.
        (lambda t: 0.95 * (1 - np.exp(-t)), np.log(9), np.log(50), 0.05),
        (lambda t: 0 * t, None, None, 1),
    ],
    ids=["first order", "a part of the step", "never moves"],
)
def test_step_responses(response, rise, settling, left):
    time = np.arange(0, 60, 0.05)
    metrics = step_metrics(time, along(response(time)), TARGET)
    # Linear interpolation on a curve of curvature 1/4 1/s2 errs by less than 1e-3 s.
    assert metrics.rise_time == pytest.approx(rise, abs=2e-3)
    assert metrics.settling_time == pytest.approx(settling, abs=2e-3)
    assert metrics.overshoot == (None if rise is None else pytest.approx(0, abs=1e-9))
    assert metrics.steady_state_error == pytest.approx(left, abs=1e-9)


def test_a_response_that_keeps_swinging_has_no_settling_time():
    time = np.arange(0, 30, 0.05)
    assert step_metrics(time, along(1 - np.cos(3 * time)), TARGET).settling_time is None


def test_motion_across_the_step_does_not_count():
    time = np.arange(0, 30, 0.05)
    across = np.outer(0.01 * np.sin(time), [0.8, 0.0, 0.6])  # normal to the way
    tip = along(1 - np.exp(-time)) + across
    assert step_metrics(time, tip, TARGET).overshoot == pytest.approx(0, abs=1e-9)


def test_tracking_metrics():
    error = np.array([0.0, 3e-3, 4e-3, 1e-3])
    tip = np.stack([error, np.zeros(4), np.zeros(4)], axis=1)
    metrics = tracking_metrics(made_rollout(np.arange(4.0), np.zeros((4, 3)), tip))
    assert metrics.e_mean == pytest.approx(2e-3)
    assert metrics.e_max == pytest.approx(4e-3)
    assert metrics.e_rms == pytest.approx(np.sqrt(26 / 4) * 1e-3)
    assert metrics.e_final == pytest.approx(1e-3)


def test_the_window_of_the_steady_value_begins_to_the_sample():
    """It is the last tenth; the response is 10 % off at one sample."""

    def with_excursion(at):
        response = np.ones(100)
        response[0], response[at] = 0.0, 1.1
        return step_metrics(0.05 * np.arange(100), along(response), TARGET)

    # From 10 % to 0 within a period, so 2 % are reached after 0.8 of it.
    before, inside = with_excursion(89), with_excursion(90)
    assert before.settling_time == pytest.approx(0.05 * 89.8)
    assert before.steady_state_error == pytest.approx(0, abs=1e-12)
    assert inside.settling_time is None
    assert inside.steady_state_error == pytest.approx(0.01)
