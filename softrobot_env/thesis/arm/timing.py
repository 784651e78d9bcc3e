"""Which robot the LQ laws of the arm drive, when they decide, and when they see the reference."""

import numpy as np

from softrobot_env.control.scheduled.timing import Timing
from softrobot_env.robots import RobotParams

from ..robots import ARM

#: [s] between decisions of a law, and period of the first mode.
PERIOD, _FIRST = 1e-3, 1.2042

#: Times [s] ahead at which `lq_preview` uses the reference; straight lines in between.
KNOTS = (0.001, 0.002, 0.004, 0.007, 0.011, 0.016, 0.023, 0.032, 0.045, 0.06, 0.08, 0.105, 0.15)

TIMING = Timing(_FIRST, PERIOD, KNOTS, (PERIOD,))

#: What the laws need of an environment.
LQI_ENVIRONMENT = {"control_period": PERIOD}
LQ_ENVIRONMENT = LQI_ENVIRONMENT | {"preview": KNOTS}


def is_arm(robot: RobotParams) -> bool:
    """Whether a robot is the arm whose gain tables are shipped, by what these depend on."""
    if robot.sections or robot.pieces != ARM.pieces or not robot.moves_in_xz:
        return False
    own, wanted = identity(robot), identity(ARM)
    return own.shape == wanted.shape and np.allclose(own, wanted, rtol=1e-9)


def is_planar_arm(robot: RobotParams) -> bool:
    """Whether the closed form of planar arms knows a robot."""
    if is_arm(robot):
        return True
    from softrobot_env.beams.planar_arm import make_planar_arm

    try:
        make_planar_arm(robot)
    except ValueError:
        return False
    return True


def identity(robot: RobotParams) -> np.ndarray:
    """What a gain table depends on: numbers that tell robots apart."""
    ends, radii = robot.of_tendons("end"), robot.of_tendons("offset")[:, 0]
    own = (robot.length, robot.bending_stiffness, robot.mass_per_length, robot.damping_time)
    return np.array([*own, float(robot.pieces), *ends, *radii])
