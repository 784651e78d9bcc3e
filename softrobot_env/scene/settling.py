"""Rest of a scene with contacts, found by a damped motion."""

from math import pi

import mujoco
import numpy as np

from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.robots import RobotParams

#: A scene rests if nothing moves by this share of the robot's length in a relaxation time, and no
#: speed [rad/s or m/s] times it is beyond this: contacts that chatter move nothing in the mean.
_STILL, _QUIET = 1e-9, 1e-5

#: Most relaxation times until then.
_PATIENCE = 200


def settle(
    model: mujoco.MjModel,
    robot: RobotParams,
    first_period: float,
    ctrl: np.ndarray,
    start: np.ndarray,
) -> np.ndarray:
    """Posture (nq,) in which a scene without friction comes to rest under controls (nu,).

    Everything is damped in proportion to its mass, the robot's first mode critically; joints and
    contacts keep their own damping. What is found is an equilibrium of the scene as it is, and a
    stable one. (More damping of the joints would be quicker, but MuJoCo finds the forces of
    contacts without it, and they would chatter.)

    Args:
        model: The compiled scene; it stays as it is.
        robot: Its robot.
        first_period: [s].
        ctrl: (nu,).
        start: Posture (nq,) at rest to begin with.

    Raises:
        EquilibriumError: It diverged, or did not come to rest.
    """
    time = first_period / (2 * pi)
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = start, ctrl
    mujoco.mj_forward(model, data)
    steps, still = max(1, round(time / model.opt.timestep)), _STILL * robot.length
    kept = 1 - 2 * model.opt.timestep / time
    for _ in range(_PATIENCE):
        before = data.xpos.copy()
        for _ in range(steps):
            mujoco.mj_step(model, data)
            data.qvel *= kept
        if any(warning.number for warning in data.warning):
            raise EquilibriumError("the scene diverged before it came to rest")
        moved, speed = np.abs(data.xpos - before).max(), np.abs(data.qvel).max()
        if moved < still and speed * time < _QUIET:
            return data.qpos.copy()
    raise EquilibriumError(
        f"the scene did not come to rest: after {_PATIENCE * time:.3g} s something still moves by "
        f"{1e3 * moved / time:.3g} mm/s, or contacts chatter (a shorter timestep may help)"
    )
