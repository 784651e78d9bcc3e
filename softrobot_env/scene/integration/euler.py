"""One linearly implicit Euler step of a chain; compiled. `friction` has what its tendons do."""

from typing import NamedTuple

from numpy import ndarray

from softrobot_env.compile.native import jit, making

from . import articulated
from . import mujoco_functions as mj
from .articulated import Tree, tree_on, tree_size
from .friction import Trial, settle, trial_on, trial_size
from .layout import AT, RUBBING
from .linear_algebra import dot
from .motors import move, tension_after, turn
from .mujoco_functions import assign, ints, reals

#: Motors are found in as many rounds at most, or until tensions agree to a share [1].
_ROUNDS, _AGREES = 30, 1e-10

_SMALLEST = 1e-300  # N


class System(NamedTuple):
    """What the change of velocities in an Euler step solves.

    Attributes:
        tree: Mass, springs and dampers of the joints.
        diagonal, right: (nv,), their springs and dampers, and impulses of all else.
        yields, behind: (nu,) [N/m], [m/s], stiffness of the springs of taut drives with their
            motors, and rates of the tendons at which they had no impulse.
        rates, expected: (nu,) [m/s], [N], where the motors were looked at, and tensions there.
        held: (2, elements), what slid or stuck last, and the friction [N], by the names of the
            elements of friction; they outlast the control period.
        trial: See `friction`.
    """

    tree: Tree
    diagonal: ndarray
    right: ndarray
    yields: ndarray
    behind: ndarray
    rates: ndarray
    expected: ndarray
    held: ndarray
    trial: Trial


@jit
def system_size(chain):
    """Number of doubles that `system_on` cuts."""
    nv, nu = chain.v.size, chain.ctrl.size
    return (
        tree_size(chain, _columns(chain))
        + 2 * nv
        + 4 * nu
        + trial_size(chain.header[RUBBING], nu, nv)
    )


@making
def system_on(chain, held, room):
    """Arrays for `euler_step`, cut from free memory but for the given ones."""
    own, drives = mj.cut(room, 2, chain.v.size), mj.cut(room, 4, chain.ctrl.size)
    return System(
        tree_on(chain, room, _columns(chain)),
        own[0],
        own[1],
        drives[0],
        drives[1],
        drives[2],
        drives[3],
        held,
        trial_on(chain.header[RUBBING], chain.ctrl.size, chain.v.size, room),
    )


@jit
def _columns(chain):
    """Most columns that are solved for at once."""
    return 1 + chain.ctrl.size + chain.header[RUBBING]


@jit
def euler_step(chain, forces, h, system, change):
    """The change (nv,) of the chain's velocities, by horns that stay.

    See `extrapolation` for the equation. A drive's spring acts by an impulse h^2 k times how fast
    its tendon would be at the step's end, which is found for all together.
    """
    _fill_joints(chain, forces, h, system.diagonal, system.right)
    articulated.factorize(system.tree, forces.axes, forces.inertias, system.diagonal)
    for s in range(int(forces.counts[0])):
        system.yields[s], system.behind[s] = forces.stiffness[s], 0.0
    settle(chain.v, forces, h, system, change, False)
    assign(system.held[1], forces.grip)


@jit
def turn_motors(v, forces, h, system, motors, change):
    """Let motors move on by an Euler step, and so correct what `euler_step` has found.

    By Newton's method on the rates of the tendons at the end, from those with horns that stay. By
    pieces all is linear, so that it ends when no motor changes between sticking, its limits and
    in between.
    """
    springs, rates, expected = int(forces.counts[0]), system.rates, system.expected
    for s in range(springs):
        rates[s] = dot(forces.pulls[s], v) + dot(forces.pulls[s], change)
    for _ in range(_ROUNDS):
        for s in range(springs):
            d, tension = int(forces.drives[s]), forces.tension[int(forces.drives[s])]
            wire = (tension, forces.stiffness[s], rates[s])
            turning, system.yields[s] = turn(motors, d, h, wire)
            expected[s] = tension_after(motors, d, h, wire, turning)
            system.behind[s] = rates[s] + (expected[s] - tension) / (h * system.yields[s])
        settle(v, forces, h, system, change, True)
        off = 0.0
        for s in range(springs):
            d, tension = int(forces.drives[s]), forces.tension[int(forces.drives[s])]
            rate = dot(forces.pulls[s], v) + dot(forces.pulls[s], change)
            wire = (tension, forces.stiffness[s], rate)
            found = tension_after(motors, d, h, wire, turn(motors, d, h, wire)[0])
            linear = expected[s] - h * system.yields[s] * (rate - rates[s])
            off = max(off, abs(found - linear) / (abs(found) + abs(tension) + _SMALLEST))
            rates[s] = rate
        if off < _AGREES:
            break
    assign(system.held[1], forces.grip)
    taut = 0
    for d in range(motors.turned.size):
        wire = (forces.tension[d], 0.0, 0.0)
        if taut < springs and int(forces.drives[taut]) == d:
            wire = (forces.tension[d], forces.stiffness[taut], rates[taut])
            taut += 1
        move(motors, d, h, turn(motors, d, h, wire)[0])


@jit
def _fill_joints(chain, forces, h, diagonal, right):
    """What resists each DOF beside the mass, and right-hand side."""
    model, header, nv = chain.model, chain.header, chain.v.size
    joints = ints(model, header[AT.dof_jntid], nv)
    armature = reals(model, header[AT.dof_armature], nv)
    damping = reals(model, header[AT.dof_damping], nv)
    stiffness = reals(model, header[AT.jnt_stiffness], joints[nv - 1] + 1)
    for i in range(nv):
        k = stiffness[joints[i]]
        diagonal[i] = armature[i] + h * (damping[i] + h * k)
        right[i] = h * (forces.force[i] - h * k * chain.v[i])
