"""Places on a robot in a posture, how they move, its curvature, and how long its tendons are."""

from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy import ndarray

from .chain import TIP_SITE
from .statics import finite
from .tendons import full_length

if TYPE_CHECKING:
    from .build import Scene


class Kinematics:
    """A robot in postures of a compiled model, of it alone or of several robots.

    Attributes:
        model: The compiled model.
        scene: Of the robot alone.
    """

    model: mujoco.MjModel
    scene: "Scene"

    def posture(self, q: ndarray) -> ndarray:
        """The robot's part (nq,) or (T, nq) of postures of the model."""
        return np.asarray(q)

    def numbers(self, bodies: ndarray) -> ndarray:
        """Numbers (k,) in the model of bodies (k,) of the robot alone."""
        return bodies

    def positions(self, q: ndarray, stations: ndarray, offsets: ndarray | None = None) -> ndarray:
        """Material points (k, 3) or (T, k, 3) [m] in postures (nq,) or (T, nq) of the model.

        Args:
            q: [rad].
            stations: (k,) [m] from 0 to the robot's length. One on a hinge belongs to the link
                above it.
            offsets: (k, 2) [m] in the section; on the centreline unless given.

        Raises:
            ValueError: A point is off the robot, or the shapes do not fit.
        """
        return self._at(q, *self._places(stations, offsets))

    def tip(self, q: ndarray) -> ndarray:
        """Tip (3,) or (T, 3) [m] for q (nq,) or (T, nq); with a head, its output point."""
        site = self.scene.model.site(TIP_SITE)
        return self._at(q, self.numbers(site.bodyid), site.pos[None])[..., 0, :]

    def velocities(self, q: ndarray, v: ndarray, stations: ndarray) -> ndarray:
        """Velocity (k, 3) [m/s] of the centreline at arc lengths (k,) [m] in state q, v."""
        model = self.model
        data, jacobian = mujoco.MjData(model), np.empty((3, model.nv))
        data.qpos[:], v = finite("q", q, (model.nq,)), finite("v", v, (model.nv,))
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        bodies, points = self._places(stations, None)
        out = np.empty((len(bodies), 3))
        for row, number, point in zip(out, bodies, points, strict=True):
            place = data.xpos[number] + data.xmat[number].reshape(3, 3) @ point
            mujoco.mj_jac(model, data, jacobian, None, place, number)
            row[:] = jacobian @ v
        return out

    def curvature(self, q: ndarray) -> ndarray:
        """Mean curvature (pieces, 3) [1/m] about x, y and z of each piece at q (nq,).

        Of the rotation vectors by which its stations turn, whatever hinges they have.
        """
        model, layout = self.scene.model, self.scene.layout
        data, out = self._alone(q), np.zeros((layout.pieces, 3))
        first = model.body("link0").id
        for link, piece in enumerate(layout.piece, first):
            turn = np.empty(3)
            mujoco.mju_subQuat(turn, data.xquat[link], data.xquat[model.body_parentid[link]])
            out[piece] += turn
        return out / layout.sizes[:, None]

    def tendon_length(self, q: ndarray) -> ndarray:
        """(n_tendons,) [m] inside the robot at q (nq,)."""
        robot = self.scene.config.robot
        length = self._alone(q).ten_length[: len(robot.tendons)]
        return length + full_length(robot, self.scene.model)

    def _alone(self, q: ndarray) -> mujoco.MjData:
        """The robot alone in a posture of the model."""
        model = self.scene.model
        data = mujoco.MjData(model)
        data.qpos[:] = finite("q", self.posture(q), (model.nq,))
        mujoco.mj_fwdPosition(model, data)
        return data

    def _places(self, stations: ndarray, offsets: ndarray | None) -> tuple[ndarray, ndarray]:
        """Bodies (k,) that carry points of the robot, and the points (k, 3) [m] in their axes."""
        robot, hinges = self.scene.config.robot, self.scene.layout.stations
        stations = robot.stations(stations, offsets)
        link = np.searchsorted(hinges, stations, side="right")
        points = np.zeros((len(stations), 3))
        points[:, 2] = stations - np.concatenate(([0.0], hinges))[link]
        if offsets is not None:
            points[:, :2] = offsets
        return self.numbers(link + (robot.base is not None)), points

    def _at(self, q: ndarray, bodies: ndarray, points: ndarray) -> ndarray:
        """Positions (k, 3) or (T, k, 3) [m] of points (k, 3) of bodies (k,)."""
        model, series = self.model, np.atleast_2d(np.asarray(q, float))
        if series.shape[1:] != (model.nq,):
            raise ValueError(f"need postures of {model.nq} numbers each, got {np.shape(q)}")
        data, out = mujoco.MjData(model), np.empty((len(series), len(bodies), 3))
        for posture, row in zip(series, out, strict=True):
            data.qpos[:] = posture
            mujoco.mj_kinematics(model, data)
            axes = data.xmat[bodies].reshape(-1, 3, 3)
            row[:] = data.xpos[bodies] + (axes @ points[:, :, None])[:, :, 0]
        return out if np.ndim(q) == 2 else out[0]
