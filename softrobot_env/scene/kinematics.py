"""Places on a chain in a posture, how they move, and how long its tendons are."""

import mujoco
import numpy as np

from softrobot_env.robots import RobotParams
from softrobot_env.scene.chain import TIP_SITE
from softrobot_env.scene.quadrature import HingeLayout
from softrobot_env.scene.tendons import full_length


def places(
    robot: RobotParams, layout: HingeLayout, stations: np.ndarray, offsets: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Bodies (k,) that carry points of the robot, and the points (k, 3) [m] in their axes.

    Args:
        robot, layout: Of the chain. A station on a hinge belongs to the link above it.
        stations: (k,) [m] from 0 to the robot's length.
        offsets: (k, 2) [m] in the section; on the centreline if None.

    Raises:
        ValueError: A point is off the robot, or the shapes do not fit.
    """
    stations = robot.stations(stations, offsets)
    body = np.searchsorted(layout.stations, stations, side="right")
    points = np.zeros((len(stations), 3))
    points[:, 2] = stations - np.concatenate(([0.0], layout.stations))[body]
    if offsets is not None:
        points[:, :2] = offsets
    return body + (robot.base is not None), points


def positions(
    model: mujoco.MjModel, q: np.ndarray, body: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Positions (k, 3) or (T, k, 3) [m] of points (k, 3) of bodies (k,) at q (nq,) or (T, nq).

    Raises:
        ValueError: The postures are not of that shape.
    """
    series = np.atleast_2d(np.asarray(q, dtype=float))
    if series.shape[1:] != (model.nq,):
        raise ValueError(f"need postures of {model.nq} numbers each, got {np.shape(q)}")
    data, out = mujoco.MjData(model), np.empty((len(series), len(body), 3))
    for posture, row in zip(series, out, strict=True):
        data.qpos[:] = posture
        mujoco.mj_kinematics(model, data)
        axes = data.xmat[body].reshape(-1, 3, 3)
        row[:] = data.xpos[body] + (axes @ points[:, :, None])[:, :, 0]
    return out if np.ndim(q) == 2 else out[0]


def tips(model: mujoco.MjModel, q: np.ndarray) -> np.ndarray:
    """Tip (3,) or (T, 3) [m] in postures (nq,) or (T, nq): of a head, its output point."""
    site = model.site(TIP_SITE)
    return positions(model, q, site.bodyid, site.pos[None])[..., 0, :]


def velocities(
    model: mujoco.MjModel, q: np.ndarray, v: np.ndarray, body: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """Velocities (k, 3) [m/s] of points (k, 3) of bodies (k,) at q (nq,), v (nv,)."""
    data, jacobian = mujoco.MjData(model), np.empty((3, model.nv))
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    out = np.empty((len(body), 3))
    for row, number, point in zip(out, body, points, strict=True):
        place = data.xpos[number] + data.xmat[number].reshape(3, 3) @ point
        mujoco.mj_jac(model, data, jacobian, None, place, number)
        row[:] = jacobian @ v
    return out


def curvature(model: mujoco.MjModel, layout: HingeLayout, q: np.ndarray) -> np.ndarray:
    """Mean curvature (pieces, 3) [1/m] about x, y and z of each piece in a posture (nq,).

    Of the rotation vectors by which its stations turn, whatever hinges they have.
    """
    data, out = mujoco.MjData(model), np.zeros((layout.pieces, 3))
    data.qpos[:] = q
    mujoco.mj_kinematics(model, data)
    first = model.body("link0").id
    for station, piece in enumerate(layout.piece):
        turn = np.empty(3)
        link = first + station
        mujoco.mju_subQuat(turn, data.xquat[link], data.xquat[model.body_parentid[link]])
        out[piece] += turn
    return out / layout.sizes[:, None]


def tendon_lengths(model: mujoco.MjModel, robot: RobotParams, q: np.ndarray) -> np.ndarray:
    """Lengths (n_tendons,) [m] inside the robot in a posture (nq,)."""
    data = mujoco.MjData(model)
    data.qpos[:] = q
    for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon):
        compute(model, data)
    return data.ten_length[: len(robot.tendons)] + full_length(robot, model)
