"""What can be measured of a running simulation."""

from collections.abc import Callable
from math import hypot

import numpy as np

from softrobot_env.envs.reference import PLANE
from softrobot_env.envs.simulation import Simulation
from softrobot_env.robots import RobotParams
from softrobot_env.scene.tendons import straight_length


class Readout:
    """Measurements of a simulation, through views that look nothing up in a step.

    Attributes:
        tip: [x, z] [m] as plain numbers.
        curvature: (n_pieces,) [1/m], mean over each piece; a new array at every `update`.
        tendon_tension: Function that returns a new array (n_tendons,) [N], as really applied.
    """

    def __init__(self, simulation: Simulation, robot: RobotParams) -> None:
        """Bind to a simulation of `robot` or of a variation of it."""
        self._data = data = simulation.data
        layout = simulation.scene.layout
        # The mean curvature of a piece is the angle of its hinges over its length.
        self._hinge_angles = data.qpos.reshape(layout.pieces, -1)
        self._hinge_rates = data.qvel.reshape(layout.pieces, -1)
        self._per_length = np.full(self._hinge_angles.shape[1], 1 / layout.piece_length)
        self._tip_position = data.sensordata[0:3][PLANE]
        self._tip_velocity = data.sensordata[3:6][PLANE]
        self.tendon_tension = data.actuator_force.copy
        self._length = data.ten_length
        self._full_length = np.array([t.end - straight_length(t) for t in robot.tendons])
        self._curvature_limit = robot.curvature_limit
        self.update()

    def sources(self) -> dict[str, Callable[[], np.ndarray]]:
        """Function by observable; no array is given out for two control instants."""
        return {
            "tip_position": self._tip_position.copy,
            "tip_velocity": self._tip_velocity.copy,
            "curvature": lambda: self.curvature,
            "curvature_rate": lambda: self._hinge_rates.dot(self._per_length),
            "tendon_tension": self.tendon_tension,
            "tendon_length": self.tendon_length,
        }

    def tendon_length(self) -> np.ndarray:
        """(n_tendons,) [m] inside the robot."""
        return self._length + self._full_length

    def update(self) -> str | None:
        """Measure anew; return what left the documented workspace, or None."""
        self.tip = self._tip_position.tolist()
        self.curvature = curvature = self._hinge_angles.dot(self._per_length)
        # The norm bounds all entries, so the exact check runs only near the limit.
        if hypot(*curvature.tolist()) > self._curvature_limit:
            return self._sharp_bend()
        return None

    def _sharp_bend(self) -> str | None:
        piece = int(np.argmax(np.abs(self.curvature)))
        if abs(self.curvature[piece]) <= self._curvature_limit:
            return None
        return (
            f"left the workspace: curvature {self.curvature[piece]:.4g} 1/m of piece {piece + 1} "
            f"is beyond +-{self._curvature_limit:g} 1/m at t = {self._data.time:.3f} s"
        )
