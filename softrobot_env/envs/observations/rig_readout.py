"""What can be measured of the running test rig: exactly, and by its camera."""

from collections import deque
from collections.abc import Callable
from math import ceil, hypot

import mujoco
import numpy as np

from softrobot_env.envs.observations.rig import FARTHEST
from softrobot_env.envs.reference import TOP
from softrobot_env.envs.simulation.mujoco import Simulation
from softrobot_env.envs.simulation.servos import Servos
from softrobot_env.robots import RobotParams
from softrobot_env.robots.twin import FRAME
from softrobot_env.scene.chain import mean_curvature


class RigReadout:
    """Exact measurements of a simulation.

    Attributes:
        tip: [x, y] [m] of the head's output point as plain numbers.
        curvature: (2 pieces,) [1/m], beta and gamma of the robot's pieces, each the mean over the
            piece; a new array at every `update`.
        tendon_tension: Function that returns a new array (n_tendons,) [N], as really applied.
    """

    def __init__(self, simulation: Simulation, robot: RobotParams, servos: Servos) -> None:
        """Bind to a simulation of `robot` and the servos that drive it."""
        self._data = data = simulation.data
        self._servos = servos
        layout, self._model = simulation.scene.layout, simulation.model
        self._per_angle = mean_curvature(self._model, layout, robot.pieces)
        self._per_angle_fine = mean_curvature(self._model, layout, layout.pieces)
        self._tip_position = data.sensordata[0:3][TOP]
        self._tip_velocity = data.sensordata[3:6][TOP]
        self.tendon_tension = data.actuator_force.copy
        self._curvature_limit = robot.curvature_limit
        self.update()

    def sources(self) -> dict[str, Callable[[], np.ndarray]]:
        """Function by observable; no array is given out for two control instants."""
        return {
            "tip_position": self._tip_position.copy,
            "tip_velocity": self._tip_velocity.copy,
            "curvature": lambda: self.curvature,
            "curvature_rate": lambda: self._per_angle.dot(self._data.qvel),
            "tendon_tension": self.tendon_tension,
            "tendon_length": lambda: self._servos.reading,
        }

    def tendon_length(self) -> np.ndarray:
        """(n_tendons,) [m] pulled in by the servos' horns."""
        return self._servos.horn.copy()

    def update(self) -> str | None:
        """Measure anew; return what left the documented workspace, or None."""
        # The forces lag the state by a timestep where they depend on it.
        mujoco.mj_fwdActuation(self._model, self._data)
        angles = self._data.qpos
        self.tip = self._tip_position.tolist()
        self.curvature = self._per_angle.dot(angles)
        fine = self._per_angle_fine.dot(angles)
        # The norm bounds all pieces, so the exact check runs only near the limit.
        if hypot(*fine.tolist()) > self._curvature_limit:
            return self._sharp_bend(np.hypot(fine[0::2], fine[1::2]))
        return None

    def _sharp_bend(self, curvature: np.ndarray) -> str | None:
        piece = int(np.argmax(curvature))
        if curvature[piece] <= self._curvature_limit:
            return None
        return (
            f"left the workspace: curvature {curvature[piece]:.4g} 1/m of the chain's piece "
            f"{piece + 1} is beyond {self._curvature_limit:g} 1/m at t = {self._data.time:.3f} s"
        )


class Camera:
    """A camera that sees late and not exactly, one picture per `FRAME` on average.

    Each is taken at the first control instant after it is due: from one to the next it is a whole
    number of control periods, the one below or above a `FRAME`, and one where a period is longer.

    Attributes:
        position: (2,) [m], what the newest picture at hand says.
        velocity: (2,) [m/s], by difference to the picture before, over the time between them.
    """

    def __init__(self, noise: float, delay: int, control_period: float, seed: int) -> None:
        """A camera with noise of standard deviation `noise` [m], `delay` control periods late."""
        self._noise, self._delay, self._period = noise, delay, control_period
        self._frame = FRAME / control_period
        self._generator = np.random.default_rng(seed)
        self._instant, self._due = -1, 0.0
        self._undeveloped: deque[tuple[int, np.ndarray]] = deque()
        self._taken, self.position, self.velocity = -1, np.zeros(2), np.zeros(2)

    def start(self, tip: np.ndarray) -> None:
        """Look at a tip at rest at (2,) [m] until there are two pictures."""
        for _ in range(self._delay + 2 * ceil(self._frame)):
            self.see(tip)

    def see(self, tip: np.ndarray) -> None:
        """Come to the next control instant, with the tip at (2,) [m]."""
        self._instant += 1
        if self._instant >= self._due:
            self._due += self._frame
            self._undeveloped.append((self._instant, self._photograph(tip)))
        if self._undeveloped and self._undeveloped[0][0] <= self._instant - self._delay:
            self._develop(*self._undeveloped.popleft())

    def _photograph(self, tip: np.ndarray) -> np.ndarray:
        normal = self._generator.standard_normal(2)
        return tip + self._noise * np.clip(normal, -FARTHEST, FARTHEST)

    def _develop(self, taken: int, seen: np.ndarray) -> None:
        passed = (taken - self._taken) * self._period
        self.velocity = (seen - self.position) / passed
        self.position, self._taken = seen, taken


class CameraReadout:
    """Measurements with the tip as a camera sees it; the attributes stay what they are without."""

    def __init__(self, readout: RigReadout, camera: Camera) -> None:
        """Look through a camera; every `update` is its next control instant."""
        self._readout, self._camera = readout, camera
        self.tendon_tension, self.tendon_length = readout.tendon_tension, readout.tendon_length
        self.tip, self.curvature = readout.tip, readout.curvature

    def sources(self) -> dict[str, Callable[[], np.ndarray]]:
        """Function by observable; no array is given out for two control instants."""
        return self._readout.sources() | {
            "tip_position": lambda: self._camera.position.copy(),
            "tip_velocity": lambda: self._camera.velocity.copy(),
        }

    def truth(self) -> dict[str, np.ndarray]:
        """Tip position [m] as it is, for `info`."""
        return {"tip_position": np.array(self.tip)}

    def update(self) -> str | None:
        """Measure anew; return what left the documented workspace, or None."""
        outside = self._readout.update()
        self.tip, self.curvature = self._readout.tip, self._readout.curvature
        self._camera.see(np.array(self.tip))
        return outside
