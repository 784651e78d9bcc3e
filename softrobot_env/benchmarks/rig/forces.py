"""Tendon forces of the spatial rig on a circle at different speeds (thesis Fig. 5.14)."""

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from softrobot_env.control.rig.servo_constraints import ServoConstraints
from softrobot_env.robots import RIG
from studies.thesis import Row, make_row

#: Radius [m] of the circle and angular velocities [1/s] of the figure.
RADIUS = 0.09
SLOWEST, FASTEST = 0.015, 63.0

_INSTANTS = 60  # per lap
#: Angular velocity [1/s] of the least force in the thesis, and of the balance of stiffness and
#: centripetal moment with its printed parameters (audit).
_THESIS, _AUDIT = 2.8, 8.6


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


def force_rows(count: int) -> list[Row]:
    """Rows of Fig. 5.14: force and phase over so many speeds, least force and balance."""
    servo, what = ServoConstraints(RIG), (f"circle of {1e3 * RADIUS:g} mm", "pcc", 1)
    rows = []
    for omega in np.geomspace(SLOWEST, FASTEST, count):
        force, phase = effective_force(servo, RADIUS, omega)
        x = ("omega_rad_s", omega)
        rows.append(make_row("5.14a", *what, "effective_force_N", force, x))
        rows.append(make_row("5.14b", *what, "phase_rad", phase, x))
    note = "damping puts it below the balance; 2.8 does not follow from the printed parameters"
    least, name = least_force(servo), "omega_of_least_force_rad_s"
    rows.append(make_row("5.14a", *what, name, least, thesis=_THESIS, note=note))
    even, name = balance(servo), "omega_of_balance_rad_s"
    rows.append(make_row("5.14b", *what, name, even, audit=_AUDIT))
    return rows
