"""Tendon forces of the spatial rig on a circle at different speeds (thesis Fig. 5.14)."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from softrobot_env.benchmarks.records import Record
from softrobot_env.control.rig.servo_constraints import ServoConstraints
from softrobot_env.robots import RIG, RobotParams

#: Radius [m] of the circle and angular velocities [1/s] of the figure.
RADIUS = 0.09
SLOWEST, FASTEST = 0.015, 63.0

_INSTANTS = 60  # per lap
#: Angular velocity [1/s] of the least force in the thesis, and of the balance of stiffness and
#: centripetal moment with its printed parameters (audit).
_THESIS, _AUDIT = 2.8, 8.6


@dataclass(frozen=True)
class ForceRow(Record):
    """A point of Fig. 5.14, or a number of it; columns as the thesis benchmark has them.

    Attributes:
        figure: "5.14a" for the force, "5.14b" for its phase.
        y_name, y: What was found.
        x_name, x: Angular velocity [rad/s] of a point; None for a number.
        thesis, audit: What they say.
        note: On what was found.
        case, model, n: Which circle, which model, and its number of pieces.
    """

    figure: str
    y_name: str
    y: float
    x: float | None = None
    x_name: str | None = None
    thesis: float | None = None
    audit: float | None = None
    note: str | None = None
    case: str = f"circle of {1e3 * RADIUS:g} mm"
    model: str = "pcc"
    n: int = 1


def effective_force(servo: ServoConstraints, radius: float, omega: float) -> tuple[float, float]:
    """Mean magnitude [N] and phase [rad] of the effective tendon force (5.42) on a circle.

    Args:
        servo: Inverse model of the rig.
        radius: [m].
        omega: Angular velocity [1/s] of the steady motion.

    Returns:
        Magnitude, and how far the force is ahead of the output, from -pi to pi.

    Raises:
        OutOfReachError: The radius is out of reach.
    """
    angle = 2 * np.pi * np.arange(_INSTANTS) / _INSTANTS
    z = radius * np.exp(1j * angle)
    motion = (np.column_stack([x.real, x.imag]) for x in (z, 1j * omega * z, -(omega**2) * z))
    tension = servo.plan(*motion).tension
    force = tension @ np.exp(2j * np.pi * np.arange(3) / 3)
    return float(np.mean(np.abs(force))), float(np.angle(np.sum(force * np.conj(z))))


def least_force(servo: ServoConstraints, radius: float = RADIUS) -> float:
    """Angular velocity [1/s] of the least mean effective force on a circle."""
    found = minimize_scalar(
        lambda x: effective_force(servo, radius, np.exp(x))[0],
        bounds=np.log([SLOWEST, FASTEST]),
        method="bounded",
        options={"xatol": 1e-8},
    )
    return float(np.exp(found.x))


def balance(servo: ServoConstraints, radius: float = RADIUS) -> float:
    """Angular velocity [1/s] at which only damping is left, a quarter turn ahead of the output."""

    def ahead(x: float) -> float:
        return effective_force(servo, radius, np.exp(x))[1] - np.pi / 2

    return float(np.exp(brentq(ahead, *np.log([SLOWEST, FASTEST]), xtol=1e-10)))


def force_rows(robot: RobotParams = RIG, count: int = 61) -> list[ForceRow]:
    """Rows of Fig. 5.14: force and phase over the angular velocity, least force and balance.

    Args:
        robot: The rig.
        count: Number of angular velocities, in geometric sequence.
    """
    servo = ServoConstraints(robot)
    rows = []
    for omega in map(float, np.geomspace(SLOWEST, FASTEST, count)):
        force, phase = effective_force(servo, RADIUS, omega)
        rows.append(ForceRow("5.14a", "effective_force_N", force, omega, "omega_rad_s"))
        rows.append(ForceRow("5.14b", "phase_rad", phase, omega, "omega_rad_s"))
    note = "damping puts it below the balance; 2.8 does not follow from the printed parameters"
    least, even = least_force(servo), balance(servo)
    return [
        *rows,
        ForceRow("5.14a", "omega_of_least_force_rad_s", least, thesis=_THESIS, note=note),
        ForceRow("5.14b", "omega_of_balance_rad_s", even, audit=_AUDIT),
    ]
