"""What MuJoCo computes of a model in a posture."""

import mujoco
import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.registry import model_scene


def posed(model, q):
    """Data of a model at rest in a posture (nq,)."""
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    return data


def moved(model, q, turns):
    """A posture (nq,) moved on by turns (nv,) of its joints."""
    q = q.copy()
    mujoco.mj_integratePos(model, q, turns, 1.0)
    return q


def driving_force(model, q):
    """Forces (nv,) on the joints at rest in a posture (nq,): springs, drives, and weight."""
    data = posed(model, q)
    return data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias


def station_turns(model: mujoco.MjModel, q: ndarray) -> ndarray:
    """Rotation vectors (stations, 3) [rad] of a chain of hinges in a posture (nq,)."""
    turns = []
    for body in np.unique(model.jnt_bodyid):
        turn = Rotation.identity()
        for joint in np.flatnonzero(model.jnt_bodyid == body):
            turn *= Rotation.from_rotvec(model.jnt_axis[joint] * q[model.jnt_qposadr[joint]])
        turns.append(turn.as_rotvec())
    return np.array(turns)


def net_force(touches, name: str) -> ndarray:
    """Force (3,) [N] on what is called `name`, an object or a part of a robot."""
    parts = [x for x in touches if x.first != x.second]
    return sum(((x.first == name) - (x.second == name)) * x.force for x in parts) + np.zeros(3)


def rest_tip(robot, inputs: ndarray) -> ndarray:
    """Tip (3,) [m] of a robot at rest under inputs (n_inputs,), in a scene of its own."""
    scene = build_scene(model_scene(robot))
    controls = np.zeros(scene.n_inputs)
    controls[: len(robot.tendons)] = robot_inputs(robot).command(inputs)
    return scene.tip(scene.equilibrium(controls))
