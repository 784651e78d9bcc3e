"""What can be measured of a running simulation."""

from collections.abc import Callable
from math import hypot
from typing import Any

import numpy as np

from softrobot_env.envs.disturbances import SENSOR_NOISE, SensorNoise
from softrobot_env.envs.reference import PLANE
from softrobot_env.envs.simulation.mujoco import Simulation
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


class NoisyReadout:
    """Measurements with noise; the attributes stay what they are without."""

    def __init__(self, readout: Any, noise: SensorNoise) -> None:
        """Add noise.

        Args:
            readout: `Readout`, or one like it.
            noise: Of one robot; every `update` advances it.
        """
        self._readout, self._noise = readout, noise
        self.tendon_tension, self.tendon_length = readout.tendon_tension, readout.tendon_length
        self.tip, self.curvature = readout.tip, readout.curvature

    def sources(self) -> dict[str, Callable[[], np.ndarray]]:
        """Function by observable; no array is given out for two control instants."""
        exact = self._readout.sources()
        return exact | {name: self._noisy(name, exact[name]) for name in SENSOR_NOISE}

    def _noisy(self, name: str, read: Callable[[], np.ndarray]) -> Callable[[], np.ndarray]:
        return lambda: read() + self._noise.on(name)[0]

    def truth(self) -> dict[str, np.ndarray]:
        """Tip position [m] and curvature [1/m] without noise, for `info`."""
        return {"tip_position": np.array(self.tip), "curvature": self.curvature}

    def update(self) -> str | None:
        """Measure anew; return what left the documented workspace, or None."""
        outside = self._readout.update()
        self.tip, self.curvature = self._readout.tip, self._readout.curvature
        self._noise.advance()
        return outside
