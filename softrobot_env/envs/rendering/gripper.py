"""Pictures of a gripper, with the shapes that its sensors tell over the true ones."""

from itertools import pairwise

import mujoco
import numpy as np

from softrobot_env.envs.rendering.opengl import OffscreenContext
from softrobot_env.envs.rendering.renderer import Lines
from softrobot_env.envs.simulation.grippers import GripperBatch, bar
from softrobot_env.robots.gripper import Gripper
from softrobot_env.robots.parameters import centerline
from softrobot_env.scene.assembly import build_assembly
from softrobot_env.scene.config import Appearance, Camera
from softrobot_env.scene.gripper import gripper_scene

_CAMERA = "front"
_MAX_GEOMS = 2000
_SENSED = np.array([0.05, 0.30, 0.90, 1.0], dtype=np.float32)  # red is a tendon that pulls
_BAR_RGBA = (0.55, 0.65, 0.6, 0.3)
_LINE = 0.0007  # m
_WIDER = 2.5  # lines of tendons, which are thin on fingers, than of robots alone
_BEFORE = 0.0045  # m towards the camera, so that a line is seen before its finger
_POINTS = 6  # of a piece


class GripperRenderer:
    """Renders into arrays.

    Attributes:
        diameter: [m], of the bar.
        metres: [m] from the lower to the upper edge of a picture.
    """

    def __init__(self, batch: GripperBatch, diameter: float, width: int, height: int) -> None:
        self.diameter = diameter
        gripper, task, config = batch.gripper, batch.task, batch.scene.config
        reach = max(finger.robot.reach for finger in gripper.fingers)
        self.metres = 1.6 * reach
        camera = Camera(_CAMERA, (0.0, 0.45 * reach), self.metres, 0.25)
        own = config.members[0].config
        self._scene = build_assembly(
            gripper_scene(
                gripper,
                (bar(gripper, task, diameter, rgba=_BAR_RGBA),),
                control_period=own.control_period,
                pieces=own.pieces,
                appearance=Appearance(surroundings=False),
                cameras=(camera,),
            )
        )
        self._gripper, model = gripper, self._scene.model
        parts = self._scene.parts.values()
        self._tendons = [
            (part.u, Lines(model, part.scene.config.robot, part.member.prefix, _WIDER))
            for part in parts
        ]
        self._data = mujoco.MjData(model)
        self._context = OffscreenContext(model, width, height)
        self._drawn = mujoco.MjvScene(model, _MAX_GEOMS)
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = model.camera(_CAMERA).id

    def draw(self, qpos: np.ndarray, tension: np.ndarray, curvature: np.ndarray) -> np.ndarray:
        """Picture (height, width, 3) uint8.

        Args:
            qpos: (nq,), posture of fingers and bar.
            tension: (n_tendons,) [N], of all fingers in turn.
            curvature: (pieces,) [1/m], of all fingers' pieces in turn, as sensors tell it.
        """
        model, data = self._scene.model, self._data
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        for own, tendons in self._tendons:
            tendons.show(tension[own])
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        option = mujoco.MjvOption()
        mujoco.mjv_updateScene(model, data, option, None, self._camera, everything, self._drawn)
        for points in finger_shapes(self._gripper, curvature):
            points[:, 1] -= _BEFORE
            for one, other in pairwise(points):
                self._line(one, other)
        return self._context.draw(self._drawn)

    def _line(self, one: np.ndarray, other: np.ndarray) -> None:
        scene = self._drawn
        if scene.ngeom == scene.maxgeom:
            return
        geom = scene.geoms[scene.ngeom]
        kind = mujoco.mjtGeom.mjGEOM_CAPSULE
        mujoco.mjv_initGeom(geom, kind, np.zeros(3), np.zeros(3), np.eye(3).ravel(), _SENSED)
        mujoco.mjv_connector(geom, kind, _LINE, one, other)
        scene.ngeom += 1

    def close(self) -> None:
        """Free the OpenGL context; closing twice is harmless."""
        self._context.close()


def finger_shapes(gripper: Gripper, curvature: np.ndarray) -> list[np.ndarray]:
    """Shapes (k, 3) [m] of the fingers, each piece an arc of its mean curvature (pieces,) [1/m]."""
    out, first = [], 0
    for finger in gripper.fingers:
        own = curvature[first : first + finger.robot.pieces]
        first += finger.robot.pieces
        points = centerline(finger.robot, own, _POINTS)
        out.append(np.array(finger.base.position) + points @ finger.base.axes.T)
    return out
