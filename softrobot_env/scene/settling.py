"""Rest of a scene with contacts, found by a damped motion."""

from math import pi

import mujoco
import numpy as np

from softrobot_env.equilibrium import EquilibriumError
from softrobot_env.robots import RobotParams

#: A scene rests if nothing moves by this share of the robot's length in a relaxation time.
_STILL = 1e-8

#: Most relaxation times until then.
_PATIENCE = 400


def settle(
    model: mujoco.MjModel,
    robot: RobotParams,
    first_period: float,
    ctrl: np.ndarray,
    start: np.ndarray,
) -> np.ndarray:
    """Posture (nq,) in which a scene without friction comes to rest under controls (nu,).

    The joints get so much damping, on top of their own, that all modes of the robot relax in the
    time of the first one; contacts keep theirs. What is found is an equilibrium of the scene as it
    is, and a stable one.

    Args:
        model: The compiled scene, a copy that is changed.
        robot: Its robot.
        first_period: [s].
        ctrl: (nu,).
        start: Posture (nq,) at rest to begin with.

    Raises:
        EquilibriumError: It diverged, or did not come to rest.
    """
    time = first_period / (2 * pi)
    model.dof_damping[:] += time * model.jnt_stiffness[model.dof_jntid]
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = start, ctrl
    mujoco.mj_forward(model, data)
    steps, still = max(1, round(time / model.opt.timestep)), _STILL * robot.length
    for _ in range(_PATIENCE):
        before = data.xpos.copy()
        mujoco.mj_step(model, data, steps)
        if any(warning.number for warning in data.warning):
            raise EquilibriumError("the scene diverged before it came to rest")
        if np.abs(data.xpos - before).max() < still:
            return data.qpos.copy()
    moved = np.abs(data.xpos - before).max()
    raise EquilibriumError(
        f"the scene did not come to rest: after {_PATIENCE * time:.3g} s something still moves at "
        f"{1e3 * moved / time:.3g} mm/s"
    )
