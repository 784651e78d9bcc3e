"""The study of feedback: its rigs, its gains against a loop run in time, and a lap."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from softrobot_env.benchmarks.feedback import gains
from softrobot_env.benchmarks.feedback.rigs import DISTURBANCES, LATE, disturbed
from softrobot_env.benchmarks.feedback.run import CAMERA, PRINTED, SENSOR, SLOW, LapRow, lap_row
from softrobot_env.benchmarks.feedback.tables import tables
from softrobot_env.control.feedforward.reference_feedback import ReferenceFeedback
from softrobot_env.control.feedforward.statics import ChainStatics
from softrobot_env.control.registry import make_policy
from softrobot_env.rendering.tables import PlainTable
from softrobot_env.robots import ARM, EQUIVALENT_RIG, RIG
from softrobot_env.robots.twin import rig3d_twin
from softrobot_env.tasks import make_task


def _swing(proportional, integral, duration):
    """Largest place of a mode in the last fifth, with feedback of how it was `LATE` before."""
    frequency, damping_time = ChainStatics(EQUIVALENT_RIG).first_mode()
    period, square = 0.02, frequency**2
    late, state, total = round(LATE / period), np.array([1.0, 0.0]), 0.0
    places = [0.0] * late + [1.0]
    for _ in range(round(duration / period)):
        error = -places[-1 - late]
        total += period * error
        held = proportional * error + integral * total
        motion = solve_ivp(
            lambda _, x: [x[1], square * (held - x[0]) - damping_time * square * x[1]],  # noqa: B023
            (0.0, period),
            state,
            rtol=1e-8,
        )
        state = motion.y[:, -1]
        places.append(state[0])
    return np.abs(places[-len(places) // 5 :]).max()


def test_the_largest_gains_are_on_the_edge_of_what_is_stable():
    limit = gains.gain_rows()[-1]
    assert limit.limit and limit.integral == pytest.approx(5 * limit.proportional)
    below, above = (
        _swing(f * limit.proportional, f * limit.integral, duration=30.0) for f in (0.8, 1.2)
    )
    assert below < 0.1 and above > 10


def test_gains_of_the_thesis_ring_as_it_tells():
    """Those that it takes calm down soon, the larger ones ring, and larger still are unstable."""
    taken, larger, limit = gains.gain_rows()
    assert taken.decay < larger.decay
    assert limit.proportional < 0.6


@pytest.mark.parametrize(("proportional", "integral"), [(0.2, 0.0), (0.2, 1.0)])
def test_share_left_of_an_error_that_turns_is_that_of_a_loop_run_in_time(proportional, integral):
    frequency, damping_time = ChainStatics(EQUIVALENT_RIG).first_mode()
    period, rate, parts = 0.02, 0.42, 20
    step, late = period / parts, round(LATE / period)
    place, speed, total, seen, sizes = 0j, 0j, 0j, [0j] * late, []
    for k in range(3000):
        seen.append(np.exp(1j * rate * k * period) - place)
        total += period * seen[-1 - late]
        held = proportional * seen[-1 - late] + integral * total
        for _ in range(parts):
            speed += step * frequency**2 * (held - place - damping_time * speed)
            place += step * speed
        sizes.append(abs(seen[-1]))
    assert gains.left(proportional, integral, rate) == pytest.approx(sizes[-1], rel=0.02)


def test_share_left_of_an_error_that_stays():
    assert gains.left(0.2, 0.0, 0.0) == pytest.approx(1 / 1.2)
    assert gains.left(0.2, 1.0, 0.0) == 0.0
    assert gains.left(0.2, 1.0, 1e-6) == pytest.approx(0.0, abs=1e-5)


def test_disturbed_rigs_differ_by_the_disturbance_alone():
    plain = disturbed(0, "")
    assert plain.camera_delay == LATE and plain.robot == rig3d_twin(0).robot
    assert disturbed(0, "offset 7 mm").servo_offset[0] - plain.servo_offset[0] == pytest.approx(
        7e-3
    )
    heavier = disturbed(0, "weight 40 g").robot.head.mass - plain.robot.head.mass
    assert heavier == pytest.approx(0.04)
    assert {name for _, name in PRINTED} < set(DISTURBANCES)


def test_feedback_shifts_the_reference_of_its_policy():
    """By the definitions, with the tip of two periods before."""
    network = make_policy("rig_nn", RIG, 0.02)
    around = ReferenceFeedback(network, 0.02, 0.3, 2.0, tip_delay=0.04)
    rng = np.random.default_rng(0)
    path, seen = 0.05 * rng.uniform(-1, 1, (6, 2)), 0.05 * rng.uniform(-1, 1, (6, 2))
    state, total, before = None, np.zeros(2), np.zeros(3)
    for k in range(6):
        observation = {
            "reference": path[k],
            "reference_velocity": np.zeros(2),
            "reference_acceleration": np.zeros(2),
            "previous_action": before,
        }
        before, state = around.predict(observation | {"tip_position": seen[k]}, state)
        error = path[max(k - 2, 0)] - seen[k]
        total = total + 0.02 * error
        shifted = observation | {"reference": path[k] + 0.3 * error + 2.0 * total}
        wanted, _ = network.predict(shifted, None)
        np.testing.assert_allclose(before, wanted, atol=1e-6)


def test_a_robot_without_identified_parameters_is_told_what_to_take():
    with pytest.raises(ValueError, match="feedforward_pi"):
        make_policy("rig_nn_pi", ARM, 0.02)


def test_tables_show_the_thesis_and_what_failed():
    rows = [
        LapRow(SLOW, CAMERA, "rig_nn", 0, "offset 2 mm", 9e-3, 8e-3, 2e-2, 9e-3, 31.3e-3, None),
        LapRow(
            SLOW, CAMERA, "rig_nn_p", 0, "offset 2 mm", None, None, None, None, 26.9e-3, "diverged"
        ),
        *gains.gain_rows(),
    ]
    parts = tables(rows).renderables
    text = str([list(column.cells) for column in parts[0].columns])
    assert isinstance(parts[0], PlainTable) and "9 (31.3)" in text and "failed" in text


@pytest.mark.slow
def test_offsets_are_made_up_for():
    """Half of what PI leaves on a rig that was not identified, and all but 1 mm on one that was."""
    task = make_task("rig_circle")

    def rms(policy, twin, seen_by=CAMERA):
        return lap_row(SLOW, task, seen_by, policy, twin, "offset 7 mm").rms

    assert rms("hybrid_feedback", 3) < rms("rig_nn_pi", 3) / 2
    assert rms("hybrid_feedback", 0) < 1e-3
    assert rms("hybrid_feedback", 0, SENSOR) < 2e-3
