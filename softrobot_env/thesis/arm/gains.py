"""Gains of the LQ laws at an operating point of the arm, from its closed form."""

import numpy as np

from softrobot_env.beams.closed_forms.planar_arm import PlanarArm
from softrobot_env.control.linear_quadratic import discretized, integral_gains
from softrobot_env.control.observers import linear_model
from softrobot_env.control.scheduled.plan_gains import Regulator, costates
from softrobot_env.thesis.arm.timing import KNOTS, PERIOD, TIMING

#: Weights of LQI on the integrated tip error and on the inputs. The thesis gives none; this ratio
#: comes closest to its rise times (audit of sec. 6.4).
ERROR_WEIGHT = 10.0  # 1/(m s)2
LQI_INPUT_WEIGHT = 1e-6  # 1/N2

#: Weights of LQ with preview: sum_k (|e|^2 + VELOCITY_WEIGHT |e.|^2 + INPUT_WEIGHT |u|^2), with e
#: the tip's distance [m] from the reference and u the inputs' [N] from those that hold it.
VELOCITY_WEIGHT = 1e-3  # s2
INPUT_WEIGHT = 3e-7  # m2/N2


def lqi_design(arm: PlanarArm, curvature: np.ndarray) -> np.ndarray:
    """Gains [K, K_i] (n_inputs, 2 n + 2) [N] of LQI, flattened.

    Args:
        arm: The arm.
        curvature: (n,) [1/m] of the operating point, which is at rest.
    """
    a, b, c = linear_model(arm, curvature).state_space()
    return integral_gains((a, b), c, LQI_INPUT_WEIGHT, ERROR_WEIGHT).ravel()


def preview_design(arm: PlanarArm, curvature: np.ndarray, period: float = PERIOD) -> np.ndarray:
    """Gains [N] of u = -K x + sum_i G_i r_i, flattened to (n_inputs * (2 n + 2 * knots),).

    x = (curvatures, rates) and r_i, the reference at the i-th knot, are deviations from an
    operating point.

    Args:
        arm: The arm.
        curvature: (n,) [1/m] of the operating point.
        period: [s] between decisions.
    """
    continuous_a, continuous_b, position = linear_model(arm, curvature).state_space()
    speed = np.roll(position, arm.n, axis=1)
    weight = position.T @ position + VELOCITY_WEIGHT * speed.T @ speed
    # Riccati's equation needs every state in the cost; this is far below the rest.
    weight += 1e-12 * np.eye(len(weight))
    change = INPUT_WEIGHT * np.eye(continuous_b.shape[1])
    system = discretized(continuous_a, continuous_b, period)
    size = np.ones(len(weight))
    law = Regulator(size, system, (position, speed), VELOCITY_WEIGHT, (weight, change))
    ahead = law.gain @ costates(law, TIMING._replace(period=period))[0]
    by_knot = ahead.reshape(len(change), len(KNOTS), 2)
    return np.hstack([law.feedback, by_knot.reshape(len(change), -1)]).ravel()
