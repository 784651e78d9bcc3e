"""Servos whose motors have a force of their own, and wires that seat: their laws, compiled.

A motor has wound x (turns by the bare radius of its spool) and turns at u. With the command c, the
gain K and damping D of its loop, the error e = c - x less half a count to either side, the inertia
m, and the tension T on a spool that winds x + a x^2 of a tendon,

    m u' = P - (1 + 2 a x) T - friction,    P = K e - D u within its limit,    x' = u,

at a limited speed. Dry friction of the gear lets it stick. Where there is backlash the horn, whose
x it is that winds, stays while the motor crosses the gap, and then the motor has no load.

At the end of an Euler step of size h the tension is T + h k ((1 + 2 a x) u - rate), by the rate at
which the robot follows. For any such rate the balance of the forces on the motor grows with its
speed u by pieces that are linear, or jumps, so there is exactly one u: the chain sees a spring that
is softer than its tendon by what the motor gives way, see `euler`.

A wire that was slack has the force k s^2 / (2 seating) up to a stretch s = seating, then
k (s - seating / 2). Its pretension is that of command 0.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.native import called, jit, making

from . import layout
from . import mujoco_functions as mj
from .layout import DRIVE_SIZE

#: Speed [m/s] of a motor without limit.
_FAST = 1e4

#: Least stiffness, over the tendon's [1], of a spring that only pulls.
SOFTEST = 1e-9

#: Speeds at which the balance of a motor may have a corner.
_CORNERS = 11

#: Newton's steps to a motor at rest.
_STEPS = 60


class Motors(NamedTuple):
    """Motors of a simulation or its shadow; none of servos of any force.

    Attributes:
        servos: (SERVO_ROWS, m) or more, see `layout`.
        drives: (DRIVE_SIZE m,), their parameters.
        goal: (m,) [m], commands in force with their offsets.
        now: (4, m), the four that follow.
        turned, horn, turning, effort: (m,) [m], [m], [m/s], [N].
        begun: (3, m), the first three at the start of an interval.
    """

    servos: ndarray
    drives: ndarray
    goal: ndarray
    now: ndarray
    turned: ndarray
    horn: ndarray
    turning: ndarray
    effort: ndarray
    begun: ndarray


@making
def motors_on(servos, drives, room):
    """Motors of servos (rows, m), cut from free memory, of 8 m doubles."""
    own = mj.cut(room, 8, servos.shape[1])
    return Motors(servos, drives, own[7], own[:4], own[0], own[1], own[2], own[3], own[4:7])


@jit
def begin_motors(motors):
    """Remember where motors are at the start of an interval."""
    mj.assign(motors.begun[0], motors.turned)
    mj.assign(motors.begun[1], motors.horn)
    mj.assign(motors.begun[2], motors.turning)


@jit
def reset_motors(motors):
    """Be where motors were at the start of an interval."""
    mj.assign(motors.turned, motors.begun[0])
    mj.assign(motors.horn, motors.begun[1])
    mj.assign(motors.turning, motors.begun[2])


@jit
def place_motors(motors, turns, speeds):
    """Let motors have turned by turns since the start of an interval, the last m of (nv + m,)."""
    nv = turns.size - motors.turned.size
    for d in range(motors.turned.size):
        motors.turned[d] = motors.begun[0, d] + turns[nv + d]
        motors.turning[d] = speeds[nv + d]
        motors.horn[d] = _followed(motors, d, motors.begun[1, d])


@jit
def _followed(motors, d, horn):
    """The horn [m] of a motor, from where it was."""
    half = motors.servos[layout.HALF, d]
    return min(max(horn, motors.turned[d] - half), motors.turned[d] + half)


# ---------------------------------------------------------------- wires


@jit
def wire_force(drives, d, stretch):
    """Tension [N] of a wire by its stretch [m], without limit; negative where it is slack."""
    stiffness, seating = drives[d * DRIVE_SIZE], drives[d * DRIVE_SIZE + layout.SEATING]
    if stretch <= 0 or seating <= 0:
        return stiffness * stretch
    if stretch < seating:
        return stiffness * stretch * stretch / (2 * seating)
    return stiffness * (stretch - seating / 2)


@jit
def wire_stiffness(drives, d, stretch):
    """Derivative [N/m] of `wire_force`, zero where it is slack."""
    stiffness, seating = drives[d * DRIVE_SIZE], drives[d * DRIVE_SIZE + layout.SEATING]
    if stretch <= 0:
        return 0.0
    return stiffness * stretch / seating if stretch < seating else stiffness


@jit
def wound(drives, d, x):
    """Length [m] that a spool has wound by a horn at x [m]."""
    return x + drives[d * DRIVE_SIZE + layout.LAYERS] * x * x


@jit
def lever(drives, d, x):
    """Length wound by a small turn there, over that at the bare radius [1]."""
    return 1 + 2 * drives[d * DRIVE_SIZE + layout.LAYERS] * x


# ---------------------------------------------------------------- motion


@jit
def tension_after(motors, d, h, pull, turning):
    """Tension [N] at the end of a step, for a pull as of `turn` and a motor's speed [m/s]."""
    tension, stiffness, rate = pull
    winds = lever(motors.drives, d, motors.horn[d]) * _moved(motors, d, h * turning)
    return tension + stiffness * (winds - h * rate)


@jit
def turn(motors, d, h, pull):
    """Speed [m/s] of a motor at the end of a step, and what stiffness [N/m] its tendon has.

    Args:
        motors, d: Which motor.
        h: [s].
        pull: Tension [N] at the start, the tendon's stiffness [N/m], and the rate [m/s] at which
            the robot lets it out at the end.
    """
    stiffness = pull[1]
    high = min(motors.servos[layout.SPEED, d], _FAST)
    low = -high
    if _balance(motors, d, h, pull, high, -1)[0] <= 0:
        return high, stiffness
    if _balance(motors, d, h, pull, low, 1)[0] >= 0:
        return low, stiffness
    for corner in range(_CORNERS):
        u = _corner(motors, d, h, corner)
        if not low < u < high:
            continue
        before = _balance(motors, d, h, pull, u, -1)[0]
        beyond = _balance(motors, d, h, pull, u, 1)[0]
        if before < 0 < beyond:
            return u, stiffness
        if before >= 0:
            high = u
        else:
            low = u
    inside = (low + high) / 2
    force, slope = _balance(motors, d, h, pull, inside, 0)
    if slope > 0:
        inside = min(max(inside - force / slope, low), high)
    if stiffness <= 0 or _moved(motors, d, h * inside) == 0:
        return inside, stiffness
    arm = lever(motors.drives, d, motors.horn[d])
    given = h * stiffness * arm * arm / slope
    return inside, stiffness * max(1 - given, SOFTEST)


@jit
def _corner(motors, d, h, number):
    """A speed at which the balance may have a corner or a jump."""
    at, half = d * DRIVE_SIZE, motors.servos[layout.HALF, d]
    gain, damping = motors.drives[at + layout.GAIN], motors.drives[at + layout.DAMPING]
    limit = motors.drives[at + layout.LIMIT]
    side = 1.0 if number % 2 else -1.0
    if number == 0:  # friction
        return 0.0
    if number <= 2:  # backlash
        return (motors.horn[d] + side * half - motors.turned[d]) / h
    if number >= 9:  # the limit, within a count
        return side * limit / damping if damping > 0 else np.inf
    error = motors.goal[d] - motors.turned[d] + side * motors.drives[at + layout.COUNT] / 2
    if number <= 4:  # a count
        return error / h
    limit = limit if number <= 6 else -limit
    return (gain * error - limit) / (h * gain + damping)


@jit
def _push(motors, d, h, turning):
    """Force [N] of a loop at the end of a step, and how it falls with the speed."""
    at = d * DRIVE_SIZE
    gain, damping = motors.drives[at + layout.GAIN], motors.drives[at + layout.DAMPING]
    limit, half = motors.drives[at + layout.LIMIT], motors.drives[at + layout.COUNT] / 2
    error = motors.goal[d] - motors.turned[d] - h * turning
    beyond = error - min(max(error, -half), half)
    force = gain * beyond - damping * turning
    if abs(force) >= limit:
        return min(max(force, -limit), limit), 0.0
    return force, damping + (h * gain if abs(error) > half else 0.0)


@jit
def _moved(motors, d, way):
    """How far [m] a horn follows its motor on a way [m]."""
    half, lead = motors.servos[layout.HALF, d], motors.turned[d] - motors.horn[d]
    return way - min(max(way, -half - lead), half - lead)


@jit
def _balance(motors, d, h, pull, turning, side):
    """Forces [N] on a motor that slow it at the end of a step, and their derivative by its speed.

    Where they jump, those below (side -1) or beyond (1).
    """
    tension, stiffness, rate = pull
    at, way = d * DRIVE_SIZE, h * turning
    half, lead = motors.servos[layout.HALF, d], motors.turned[d] - motors.horn[d]
    moved = _moved(motors, d, way)
    touches = moved != 0
    if side > 0:
        touches = touches or way >= (half - lead) * (1 - 1e-12)
    elif side < 0:
        touches = touches or way <= -(half + lead) * (1 - 1e-12)
    push, falls = _push(motors, d, h, turning)
    inertia = motors.drives[at + layout.INERTIA] / h
    force, slope = inertia * (turning - motors.turning[d]) - push, inertia + falls
    if touches:
        arm = lever(motors.drives, d, motors.horn[d])
        force += arm * (tension + stiffness * (arm * moved - h * rate))
        slope += h * stiffness * arm * arm
    onward = turning > 0 or (turning == 0 and side > 0)
    gear = motors.drives[at + layout.GEAR]
    return force + (gear if onward else -gear), slope


@jit
def move(motors, d, h, turning):
    """Let a motor turn on for a step at a speed [m/s]."""
    motors.turned[d] += h * turning
    motors.turning[d] = turning
    motors.horn[d] = _followed(motors, d, motors.horn[d])


@jit
def jump_of(motors, d, tension, h):
    """How far [m] a jump of a motor's friction and load [N] since the begin moves it within h."""
    at, half = d * DRIVE_SIZE, motors.servos[layout.HALF, d]
    before, now = motors.begun[2, d], motors.turning[d]
    force = motors.drives[at + layout.GEAR] * abs(np.sign(now) - np.sign(before))
    if half > 0:
        lead, led = motors.turned[d] - motors.horn[d], motors.begun[0, d] - motors.begun[1, d]
        if (abs(lead) >= half) != (abs(led) >= half):
            force += tension
    resists = motors.drives[at] + motors.drives[at + layout.GAIN]
    resists = motors.drives[at + layout.INERTIA] + h * (
        motors.drives[at + layout.DAMPING] + h * resists
    )
    return h * h * force / resists


@jit
def take_effort(motors):
    """Let efforts be the forces of the loops now."""
    for d in range(motors.turned.size):
        motors.effort[d] = _push(motors, d, 0.0, motors.turning[d])[0]


# ---------------------------------------------------------------- rest


@jit
def hold(drives, d, command, slack, limit):
    """A servo at rest under its load.

    Args:
        drives, d: Which servo.
        command: [m], less half of its backlash.
        slack: [m], stretch of the wire were nothing wound.
        limit: [N] of the tendon.

    Returns:
        Where the horn is [m], tension [N], its derivatives [N/m] by the slack and the command.
    """
    at = d * DRIVE_SIZE
    gain, most = drives[at + layout.GAIN], drives[at + layout.LIMIT]
    reach = command - drives[at + layout.COUNT] / 2
    x, growth = reach, 2 * drives[at + layout.LAYERS]
    if gain > 0:
        for _ in range(_STEPS):  # from the right on a convex function
            arm, stretch = lever(drives, d, x), wound(drives, d, x) + slack
            tension = max(wire_force(drives, d, stretch), 0.0)
            excess = arm * tension - min(gain * (reach - x), most)
            yields = arm * arm * wire_stiffness(drives, d, stretch) + growth * tension
            yields += gain if gain * (reach - x) < most else 0.0
            before = x
            x -= excess / yields if excess > 0 else 0.0
            if not x < before:
                break
        if tension > limit:
            x = (gain * reach - limit) / (gain + growth * limit)
    arm, stretch = lever(drives, d, x), wound(drives, d, x) + slack
    tension, stiffness = wire_force(drives, d, stretch), wire_stiffness(drives, d, stretch)
    if not 0 < tension < limit:
        return x, min(max(tension, 0.0), limit), 0.0, 0.0
    if gain <= 0:
        return x, tension, stiffness, stiffness * arm
    loop = gain if gain * (reach - x) < most * (1 - 1e-9) else 0.0
    total = arm * arm * stiffness + growth * tension + loop
    kept = (loop + growth * tension) / total
    return x, tension, stiffness * kept, stiffness * arm * loop / total


@called
def hold_all(drives, commands, slacks, limits):
    """`hold` of servos, with drives (DRIVE_SIZE n,) and (n,) of the others: four times (n,)."""
    out = np.empty((4, commands.size))
    for d in range(commands.size):
        found = hold(drives, d, commands[d], slacks[d], limits[d])
        for k in range(4):
            out[k, d] = found[k]
    return out
