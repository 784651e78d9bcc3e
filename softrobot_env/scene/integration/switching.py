"""Drives that change their law after the last evaluation of an interval, for compiled code.

A drive of a length pulls like a spring while its tendon is taut and below its limit. Where a tendon
goes slack or taut, or comes to its limit, between the last evaluation of all forces and the end of
an interval, no row of the extrapolation sees it: all agree, and all are wrong. So the forces at the
end are compared with what the last evaluation led to expect.
"""

from softrobot_env.scene.integration.forces import BIASES, find_taut
from softrobot_env.scene.integration.layout import AT
from softrobot_env.scene.integration.mujoco_functions import (
    ints,
    jit,
    making,
    mj_actuation,
    mj_com_pos,
    mj_kinematics,
    mj_tendon,
    mj_transmission,
    reals,
)

_GAINS = 10  # mjNGAIN


@jit
def drives_length(chain):
    """Whether any drive pulls like a spring."""
    biases = reals(chain.model, chain.header[AT.actuator_biasprm], chain.ctrl.size * BIASES)
    for k in range(chain.ctrl.size):
        if biases[k * BIASES + 1] < 0:
            return True
    return False


@making
def drive_forces(chain):
    """View (nu,) of the drives' forces [N] of the last evaluation."""
    return reals(chain.data, chain.header[AT.actuator_force], chain.ctrl.size)


@jit
def find_switched(chain, before, forces):
    """Let `forces` be the surprises of drives in MuJoCo's positions, with the springs there.

    Args:
        chain: Its positions and controls are those at the end of an interval.
        before: (nu,) [N], forces of the drives in the last evaluation.
        forces: Their mass stays as it is.

    Returns:
        Whether any drive has changed its law.
    """
    model, data = chain.model, chain.data
    mj_kinematics(model, data)
    mj_com_pos(model, data)
    mj_tendon(model, data)
    mj_transmission(model, data)
    mj_actuation(model, data)
    found = False
    for i in range(chain.v.size):
        forces.force[i] = 0.0
    for k in range(chain.ctrl.size):
        surprise = _surprise(chain, before, k)
        if surprise != 0:
            found = True
            _add_pull(chain, k, surprise, forces.force)
    forces.counts[0], forces.counts[1] = find_taut(chain, forces.stiffness, forces.pulls), 0
    return found


@jit
def _surprise(chain, before, k):
    """Force [N] of a drive less that of the law it had in the last evaluation."""
    model, data, header, nu = chain.model, chain.data, chain.header, chain.ctrl.size
    bounds = reals(model, header[AT.actuator_forcerange], 2 * nu)
    gains = reals(model, header[AT.actuator_gainprm], nu * _GAINS)
    biases = reals(model, header[AT.actuator_biasprm], nu * BIASES)
    low, high, bias = bounds[2 * k], bounds[2 * k + 1], k * BIASES
    now, was = drive_forces(chain)[k], _law(before[k], low, high)
    if biases[bias + 1] >= 0 or _law(now, low, high) == was:
        return 0.0
    if was != 0:
        return now - before[k]
    length = reals(data, header[AT.actuator_length], nu)[k]
    return now - (gains[k * _GAINS] * chain.ctrl[k] + biases[bias] + biases[bias + 1] * length)


@jit
def _law(force, low, high):
    """Whether a drive leaves its tendon slack (-1), pulls like a spring (0) or by its limit (1)."""
    return -1 if force <= low else 1 if force >= high else 0


@jit
def _add_pull(chain, k, pull, force):
    """Add a drive's pull [N] to generalised forces (nv,)."""
    data, header, nu = chain.data, chain.header, chain.ctrl.size
    start = ints(data, header[AT.moment_rowadr], nu)[k]
    end = start + ints(data, header[AT.moment_rownnz], nu)[k]
    columns = ints(data, header[AT.moment_colind], end)
    levers = reals(data, header[AT.actuator_moment], end)
    for at in range(start, end):
        force[columns[at]] += pull * levers[at]
