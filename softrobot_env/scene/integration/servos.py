"""How servos turn in a control period, for compiled code; the law is that of `scene.servos`."""

import numba
import numpy as np

from softrobot_env.machine_code import CALLED
from softrobot_env.scene.integration.layout import (
    COMMAND,
    HALF,
    HORN,
    LONGEST,
    MOTOR,
    OFFSET,
    SPEED,
    SUBSTEPS,
)
from softrobot_env.scene.integration.mujoco_functions import assign, jit


@jit
def wind(servos, memory, path):
    """Let servos (`SERVO_ROWS`, nu) turn for a control period, and tell where the horns are.

    Args:
        servos: Settings, order and state.
        memory: Of the simulation: its timesteps.
        path: (1 + timesteps, nu) [m], horns now and at the end of every timestep.

    Returns:
        Number of rows of the path up to the one at which all motors have arrived.
    """
    rows = 1 + _moving(servos, memory)
    half, horn = servos[HALF], servos[HORN]
    assign(path[0], horn)
    for k in range(1, rows):
        for i in range(horn.size):
            # A motor turns one way, so its horn is pushed by one side of the play at most.
            motor = _turned(servos, i, k * memory[LONGEST])
            path[k, i] = min(max(horn[i], motor - half[i]), motor + half[i])
    for i in range(horn.size):
        servos[MOTOR, i] = _turned(servos, i, (rows - 1) * memory[LONGEST])
    assign(horn, path[rows - 1])
    return rows


@numba.njit(**CALLED)
def turn(servos, memory, path):
    """As `wind`, for Python."""
    return wind(servos, memory, path)


@jit
def _way(servos, i):
    """What motor i still has to wind [m]."""
    return servos[OFFSET, i] + servos[COMMAND, i] - servos[MOTOR, i]


@jit
def _turned(servos, i, time):
    """Where motor i is [m] after a time [s]."""
    most = servos[SPEED, i] * time
    return servos[MOTOR, i] + min(max(_way(servos, i), -most), most)


@jit
def _moving(servos, memory):
    """Timesteps until all motors have arrived, at least one and at most all of them."""
    arrival = 0.0
    for i in range(servos.shape[1]):
        arrival = max(arrival, np.abs(_way(servos, i)) / servos[SPEED, i])
    steps = 1
    while steps < memory[SUBSTEPS] and steps * memory[LONGEST] < arrival:
        steps += 1
    return steps
