"""MuJoCo's C functions and arrays for compiled code, which has addresses of its structures."""

import numpy as np

from softrobot_env.compile.native import (
    ADDRESS,
    FLOAT,
    array_at,
    functions_of,
    jit,
    making,
)

from .layout import library_path

# ---------------------------------------------------------------- functions

_function = functions_of(library_path(), ADDRESS, ADDRESS)

mj_kinematics = _function("mj_kinematics")
mj_com_pos = _function("mj_comPos")
mj_cam_light = _function("mj_camlight")
mj_tendon = _function("mj_tendon")
mj_make_mass = _function("mj_makeM")
mj_transmission = _function("mj_transmission")
mj_actuation = _function("mj_fwdActuation")
mj_acceleration = _function("mj_fwdAcceleration")
mj_fwd_velocity = _function("mj_fwdVelocity")
mj_sensor_pos = _function("mj_sensorPos")
mj_sensor_vel = _function("mj_sensorVel")
mj_check_pos = _function("mj_checkPos")
mj_check_vel = _function("mj_checkVel")
mj_forward = _function("mj_forward")
mj_step = _function("mj_step")
mj_step1 = _function("mj_step1")
mj_step2 = _function("mj_step2")
_mj_integrate_pos = _function("mj_integratePos", ADDRESS, FLOAT)
_mj_differentiate_pos = _function("mj_differentiatePos", FLOAT, ADDRESS, ADDRESS)


@jit
def move(model, q, v, time):
    """Let positions q (nq,) move with velocities v (nv,) for a time."""
    _mj_integrate_pos(model, q.ctypes.data, v.ctypes.data, time)


@jit
def subtract(model, turn, q, start):
    """The turns (nv,) of the joints by which positions q (nq,) are away from `start`."""
    _mj_differentiate_pos(model, turn.ctypes.data, 1.0, start.ctypes.data, q.ctypes.data)


# ---------------------------------------------------------------- arrays


@making
def reals_at(address, size):
    """The array (size,) of doubles at an address."""
    return array_at(np.uint64(address), (size,), np.float64)


@making
def ints_at(address, size):
    """As `reals_at`, of 32-bit integers."""
    return array_at(np.uint64(address), (size,), np.int32)


@making
def table_at(address, rows, columns):
    """The array (rows, columns) of doubles at an address."""
    return array_at(np.uint64(address), (rows, columns), np.float64)


@jit
def assign(array, values):
    """Let (n,) be other values (n,); `array[:] = values` might make a copy."""
    for i in range(array.size):
        array[i] = values[i]


@making
def cut(room, rows, columns):
    """An array (rows, columns) of doubles from the start of what is left at address room[0]."""
    start = room[0]
    room[0] += 8 * rows * columns
    return table_at(start, rows, columns)


@making
def word(structure, place):
    """A word of a structure: an address."""
    return array_at(structure, (place + 1,), np.uint64)[place]


@making
def reals(structure, place, size):
    """The array (size,) of doubles to which a structure's word points."""
    return reals_at(word(structure, place), size)


@making
def ints(structure, place, size):
    """As `reals`, of 32-bit integers."""
    return ints_at(word(structure, place), size)
