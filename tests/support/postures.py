"""What MuJoCo computes of a model in a posture."""

import mujoco


def posed(model, q):
    """Data of a model at rest in a posture (nq,)."""
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    return data
