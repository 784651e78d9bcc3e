"""The studies of the rig against independent truths: a steady circle, a loop run in time."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from softrobot_env.control.feedforward.feedback import ReferenceFeedback
from softrobot_env.control.feedforward.statics import ChainStatics
from softrobot_env.control.registry import make_policy
from softrobot_env.identification.networks import direction_of
from softrobot_env.identification.visits import collect, disk_points, split
from softrobot_env.robots import EQUIVALENT_RIG, RIG
from softrobot_env.robots.twin import rig3d_twin
from softrobot_env.thesis.rig.servo_constraints import ServoConstraints
from softrobot_env.thesis.rig.spatial_piece import SUBPIECES
from studies import rig, rig_networks
from studies.rig import LATE, RADIUS, balance, disturbed, effective_force, least_force
from studies.rig_networks import Cell, measure_cell, train
from studies.truths.slow_rig import RigStatics

SERVO = ServoConstraints(RIG)
LEVER = 5.5e-3
PERIOD = 0.02


def steady_circle(radius):
    """Balance of the rig turning steadily about its axis, in the plane of the bend.

    Returns the static moment, the slope of the moment of inertia about the axis and the damping
    moment per angular velocity, from the geometry of an arc.
    """
    length, height = RIG.length, RIG.head.output

    def beside(angle, s):
        return length / angle * (1 - np.cos(s / length * angle))

    angle = brentq(lambda x: beside(x, length) + height * np.sin(x) - radius, 0.1, 2.0)

    def potential(x):
        heights = [m * 9.81 * length / x * np.sin(s / length * x) for s, m, _ in SUBPIECES]
        return 0.5 * RIG.bending_stiffness / length * x**2 + sum(heights)

    def turning(x):
        return sum(
            m * beside(x, s) ** 2
            + i[0] * np.sin(s / length * x) ** 2
            + i[2] * (1 - np.cos(s / length * x)) ** 2
            for s, m, i in SUBPIECES
        )

    step = 1e-4
    static, slope = ((f(angle + step) - f(angle - step)) / (2 * step) for f in (potential, turning))
    return static, slope, 3.77e-3 * angle


def test_force_is_the_balance_of_stiffness_centripetal_and_damping_moments():
    static, slope, damping = steady_circle(RADIUS)
    for omega in np.geomspace(rig.SLOWEST, rig.FASTEST, 12):
        expected = complex(static - 0.5 * omega**2 * slope, omega * damping) / LEVER
        force, phase = effective_force(SERVO, RADIUS, omega)
        assert force == pytest.approx(abs(expected), rel=1e-6)
        assert phase == pytest.approx(np.angle(expected), abs=1e-6)
    assert balance(SERVO) == pytest.approx(np.sqrt(2 * static / slope), rel=1e-6)
    assert balance(SERVO) == pytest.approx(8.6, abs=0.05)  # audit
    # The least of (static - slope w^2 / 2)^2 + (damping w)^2.
    least = np.sqrt(2 * static / slope - 2 * (damping / slope) ** 2)
    assert least_force(SERVO) == pytest.approx(least, rel=1e-5)


def swing(proportional, integral, duration):
    """Largest place of a mode in the last fifth, with feedback of how it was `LATE` before."""
    frequency, damping_time = ChainStatics(EQUIVALENT_RIG).first_mode()
    square, late = frequency**2, round(LATE / PERIOD)
    state, total, places = np.array([1.0, 0.0]), 0.0, [0.0] * late + [1.0]
    for _ in range(round(duration / PERIOD)):
        error = -places[-1 - late]
        total += PERIOD * error
        held = proportional * error + integral * total
        motion = solve_ivp(
            lambda _, x: [x[1], square * (held - x[0]) - damping_time * square * x[1]],  # noqa: B023
            (0.0, PERIOD),
            state,
            rtol=1e-8,
        )
        state = motion.y[:, -1]
        places.append(state[0])
    return np.abs(places[-len(places) // 5 :]).max()


def test_the_largest_gains_are_on_the_edge_of_what_is_stable():
    taken, larger, limit = rig.gain_rows()
    assert limit.limit and limit.integral == pytest.approx(5 * limit.proportional)
    gains = limit.proportional, limit.integral
    below, above = (swing(*(f * gain for gain in gains), duration=30.0) for f in (0.8, 1.2))
    assert below < 0.1 and above > 10
    assert taken.decay < larger.decay and limit.proportional < 0.6  # as the thesis tells


@pytest.mark.parametrize(("proportional", "integral"), [(0.2, 0.0), (0.2, 1.0)])
def test_share_left_of_an_error_that_turns_is_that_of_a_loop_run_in_time(proportional, integral):
    frequency, damping_time = ChainStatics(EQUIVALENT_RIG).first_mode()
    rate, parts = 0.42, 20
    step, late = PERIOD / parts, round(LATE / PERIOD)
    place, speed, total, seen, sizes = 0j, 0j, 0j, [0j] * late, []
    for k in range(3000):
        seen.append(np.exp(1j * rate * k * PERIOD) - place)
        total += PERIOD * seen[-1 - late]
        held = proportional * seen[-1 - late] + integral * total
        for _ in range(parts):
            speed += step * frequency**2 * (held - place - damping_time * speed)
            place += step * speed
        sizes.append(abs(seen[-1]))
    assert rig.left(proportional, integral, rate) == pytest.approx(sizes[-1], rel=0.02)
    assert rig.left(proportional, integral, 0.0) == pytest.approx(0.0 if integral else 1 / 1.2)


def test_disturbed_rigs_differ_by_the_disturbance_alone():
    plain, offset = disturbed(0, ""), disturbed(0, "offset 7 mm")
    assert plain.camera_delay == LATE and plain.robot == rig3d_twin(0).robot
    assert offset.servo_offset[0] - plain.servo_offset[0] == pytest.approx(7e-3)
    heavier = disturbed(0, "weight 40 g").robot.head.mass - plain.robot.head.mass
    assert heavier == pytest.approx(0.04)
    assert {name for _, name in rig.PRINTED} < set(rig.DISTURBANCES)


def test_feedback_shifts_the_reference_of_its_policy():
    """By the definitions, with the tip of two periods before."""
    network = make_policy("rig_nn", RIG, PERIOD)
    around = ReferenceFeedback(network, PERIOD, 0.3, 2.0, tip_delay=0.04)
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
        total = total + PERIOD * error
        shifted = observation | {"reference": path[k] + 0.3 * error + 2.0 * total}
        wanted, _ = network.predict(shifted, None)
        np.testing.assert_allclose(before, wanted, atol=1e-6)


# ---------------------------------------------------------------- networks


@pytest.mark.slow
def test_a_cell_is_the_median_of_its_trainings():
    points = disk_points(100)
    data = collect(RIG, RigStatics(), np.random.default_rng(0), points)
    parts = split(100, np.random.default_rng(0))
    cell = Cell("samples", "forward", 1, 4, samples=30, trainings=3)
    row = measure_cell(cell, data, parts)
    test = direction_of(data, "forward").take(parts.test)
    errors, worst = [], []
    for seed in range(3):
        network = train(cell, data, parts, seed).network
        off = np.linalg.norm(network(test.inputs) - test.outputs, axis=1)
        errors.append(np.sqrt(np.mean(off**2)))
        worst.append(off.max())
    expected = [np.median(errors), min(errors), max(errors), np.median(worst)]
    np.testing.assert_allclose([row.e_rms, row.e_rms_least, row.e_rms_largest, row.e_max], expected)
    with pytest.raises(ValueError, match="71 samples are wanted of a set of 70"):
        measure_cell(replace(cell, samples=71), data, parts)


@pytest.mark.slow
def test_friction_sets_the_errors():
    """0.3 N err by several times what no friction does, which leaves the camera's noise."""
    free, rubbing = (
        rig_networks.friction_rows(disk_points(215), 1, (26.0, friction)) for friction in (0.0, 0.3)
    )
    assert all(b.e_rms > 2.5 * a.e_rms for a, b in zip(free, rubbing, strict=True))
