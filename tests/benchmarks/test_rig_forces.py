import numpy as np
import pytest
from scipy.optimize import brentq

from softrobot_env.beams.closed_forms.spatial_piece import SUBPIECES
from softrobot_env.benchmarks.rig.forces import (
    FASTEST,
    RADIUS,
    SLOWEST,
    balance,
    effective_force,
    force_rows,
    least_force,
)
from softrobot_env.control.rig.servo_constraints import ServoConstraints
from softrobot_env.robots import RIG

#: Columns of a report, those of the thesis benchmark.
COLUMNS = {
    "figure", "case", "model", "n", "x_name", "x", "y_name", "y", "thesis", "audit", "note"
}  # fmt: skip

SERVO = ServoConstraints(RIG)
LEVER = 5.5e-3


def steady_circle(radius):
    """Balance of the rig turning steadily about its axis, in the plane of the bend.

    Returns the bending angle, the static moment, the slope of the moment of inertia about the
    axis and the damping moment per angular velocity, from the geometry of an arc.
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
    return angle, static, slope, 3.77e-3 * angle


def test_force_is_the_balance_of_stiffness_centripetal_and_damping_moments():
    _, static, slope, damping = steady_circle(RADIUS)
    for omega in np.geomspace(SLOWEST, FASTEST, 12):
        expected = complex(static - 0.5 * omega**2 * slope, omega * damping) / LEVER
        force, phase = effective_force(SERVO, RADIUS, omega)
        assert force == pytest.approx(abs(expected), rel=1e-6)
        assert phase == pytest.approx(np.angle(expected), abs=1e-6)


def test_balance_is_that_of_the_centripetal_moment_and_the_stiffness():
    _, static, slope, _ = steady_circle(RADIUS)
    assert balance(SERVO) == pytest.approx(np.sqrt(2 * static / slope), rel=1e-6)
    assert balance(SERVO) == pytest.approx(8.6, abs=0.05)  # audit


def test_damping_puts_the_least_force_below_the_balance():
    """The least of (static - slope w^2 / 2)^2 + (damping w)^2."""
    _, static, slope, damping = steady_circle(RADIUS)
    expected = np.sqrt(2 * static / slope - 2 * (damping / slope) ** 2)
    assert least_force(SERVO) == pytest.approx(expected, rel=1e-5)


def test_rows():
    rows = force_rows(count=7)
    assert all(set(row.row()) == COLUMNS for row in rows)
    force = [row.y for row in rows if row.y_name == "effective_force_N"]
    phase = [row.y for row in rows if row.y_name == "phase_rad"]
    assert len(force) == len(phase) == 7
    assert 0 < phase[0] < 0.01  # slow: the tendons pull where the rig bends to
    assert np.pi - 0.1 < phase[-1] < np.pi  # fast: they hold it back
    assert np.all(np.diff(phase) > 0)
