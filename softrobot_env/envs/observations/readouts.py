"""What is measured of a running simulation: a chain, many chains, a beam model, with noise.

Every readout has the functions of `table.Measured`, which return new arrays, and

* `tip`: where the tip is, [m] as plain numbers or (n, 2);
* `bend`: its mean curvatures [1/m], a new array at every `update`;
* `true_length`: function that returns a new array of tendon lengths [m] as they are;
* `truth`: function that returns what `info` tells of the true state, None if sensors are exact;
* `update()`: measure anew; what left the documented workspace, or None.
"""

from collections.abc import Callable
from math import hypot, sqrt
from typing import Any

import mujoco
import numpy as np

from softrobot_env.envs.disturbances import SensorNoise
from softrobot_env.envs.observations.table import (
    SENSOR_NOISE,
    Measured,
    Read,
    curvature_rate_limit,
)
from softrobot_env.envs.reference import PLANE
from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.envs.simulation.servos import Servos
from softrobot_env.interfaces import Measurement
from softrobot_env.robots import RobotParams
from softrobot_env.scene.chain import mean_curvature
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.tendons import full_length


def left_workspace(what: str, time: float) -> str:
    """Text of a failure."""
    return f"left the workspace: {what} at t = {time:.3f} s"


def sharp_bend(curvature: np.ndarray, limit: float, time: float) -> str | None:
    """The sharpest of the bends (pieces,) [1/m], if it is beyond the limit, as text."""
    piece = int(np.argmax(np.abs(curvature)))
    if not abs(curvature[piece]) > limit:
        return None
    where = f"of piece {piece + 1} of {len(curvature)}"
    return left_workspace(
        f"curvature {curvature[piece]:.4g} 1/m {where} is beyond +-{limit:g} 1/m", time
    )


class _Limits:
    """Within which a chain is in its documented workspace.

    Attributes:
        curvature: [1/m], of any piece.
        speed: [m/s], of the tip.
        turning: [rad/s], root of the sum of the squared hinge rates. No mean curvature of a piece
            changes faster than `curvature_rate_limit` below it.
        slow: [rad/s], as `turning`; below it the tip is within its limit, too.
    """

    def __init__(self, robot: RobotParams, speed: float, mean: np.ndarray) -> None:
        self.curvature, self.speed = robot.curvature_limit, speed
        most = float(np.linalg.norm(mean, axis=1).max())
        self.turning = curvature_rate_limit(robot, speed) / most
        # No hinge has a longer lever than the reach, so that slow hinges say that the tip is slow.
        self.slow = min(self.turning, self.speed / (robot.reach * sqrt(mean.shape[1])))

    def what_left(
        self, bend: np.ndarray, velocity: np.ndarray, rates: np.ndarray, time: float
    ) -> str | None:
        """What is beyond the limits, or None; bends (pieces,), of the tip (2,), of hinges (nv,)."""
        sharp = sharp_bend(bend, self.curvature, time)
        if sharp is not None:
            return sharp
        for what, value, limit, unit in (
            ("tip speed", float(np.linalg.norm(velocity)), self.speed, "m/s"),
            ("norm of the hinge rates", float(np.linalg.norm(rates)), self.turning, "rad/s"),
        ):
            if value > limit:
                return left_workspace(f"{what} {value:.4g} {unit} is beyond {limit:.4g}", time)
        return None


class ChainReadout:
    """Exact measurements of a chain, through views that look nothing up in a step."""

    truth = None

    def __init__(
        self,
        simulation: Simulation,
        robot: RobotParams,
        pieces: int,
        speed: float,
        axes: slice,
        servos: Servos | None = None,
    ) -> None:
        """Bind to a simulation.

        Args:
            simulation: The simulation, of `robot` or of a variation of it.
            robot: The robot.
            pieces: Number of pieces whose curvature is measured.
            speed: [m/s], limit of the tip's speed.
            axes: Coordinates of the tip that are measured.
            servos: What drives the tendons in length; measured are then the lengths pulled in.
        """
        self._data = data = simulation.data
        self._model, layout = simulation.model, simulation.scene.layout
        self._mean = mean = mean_curvature(self._model, layout, pieces)
        fine = None if pieces == layout.pieces else layout.pieces
        self._mean_fine = None if fine is None else mean_curvature(self._model, layout, fine)
        self._directions = len(self._mean) // pieces
        self._limits = _Limits(robot, speed, mean)
        self._limit, self._slow = robot.curvature_limit, self._limits.slow
        self._angles, self._rates = data.qpos, data.qvel
        rates = self._rates
        self._tip, self._velocity = data.sensordata[0:3][axes], data.sensordata[3:6][axes]
        self._driven_in_length = servos is not None
        self.tip_position, self.tip_velocity = self._tip.copy, self._velocity.copy
        self.curvature = lambda: self.bend
        self.curvature_rate = lambda: mean.dot(rates)
        self.tendon_tension = data.actuator_force.copy
        if servos is None:
            inside, length = data.ten_length[: len(robot.tendons)], full_length(robot)
            self.tendon_length = self.true_length = lambda: inside + length
        else:
            self.tendon_length, self.true_length = (
                lambda: servos.reading,
                lambda: servos.horn.copy(),
            )
        self.update()

    def update(self) -> str | None:
        """Measure anew; return what left the documented workspace, or None."""
        if self._driven_in_length:
            # The forces lag the state by a timestep where they depend on it.
            mujoco.mj_fwdActuation(self._model, self._data)
        angles = self._angles
        self.tip = self._tip.tolist()
        self.bend = bend = self._mean.dot(angles)
        if self._mean_fine is not None:
            bend = self._mean_fine.dot(angles)
        # The norms bound all pieces and the tip, so the exact check runs only near the limits.
        if hypot(*bend.tolist()) > self._limit or hypot(*self._rates.tolist()) > self._slow:
            if self._directions == 2:
                bend = np.hypot(bend[0::2], bend[1::2])
            return self._limits.what_left(bend, self._velocity, self._rates, self._data.time)
        return None


class BatchReadout:
    """Exact measurements of n planar chains.

    Attributes:
        outside: (n,) bool, which robots left the workspace, with what `what_left` says.
    """

    truth = None

    def __init__(self, simulation: BatchSimulation, robot: RobotParams, speed: float) -> None:
        """Bind to simulations of `robot` or of variations of it, with a limit of speed [m/s]."""
        self._simulation, scene = simulation, simulation.scene
        mean = mean_curvature(scene.model, scene.layout, scene.layout.pieces)
        self._mean, self._limits, straight = mean.T, _Limits(robot, speed, mean), full_length(robot)
        self._velocity = simulation.sensordata[:, 3:6][:, PLANE]
        inside = simulation.ten_length[:, : len(robot.tendons)]
        self._nobody = np.zeros(simulation.count, dtype=bool)
        self._nobody.flags.writeable = False
        self.tip_position = lambda: self.tip
        self.tip_velocity = lambda: self._velocity.copy()
        self.curvature = lambda: self.bend
        self.curvature_rate = lambda: simulation.qvel @ self._mean
        self.tendon_tension = simulation.actuator_force.copy
        self.tendon_length = self.true_length = lambda: inside + straight
        self.update()

    def update(self, _which: np.ndarray | None = None) -> None:
        """Measure anew."""
        self.tip = self._simulation.sensordata[:, 0:3][:, PLANE].copy()
        self.bend = bend = self._simulation.qpos @ self._mean
        limits, rates = self._limits, self._simulation.qvel
        # Any NaN fails the first tests, and then every robot is looked at by itself.
        gentle = _largest(bend) <= limits.curvature
        if gentle and _largest(rates) * sqrt(rates.shape[1]) <= limits.slow:
            self.outside = self._nobody
            return
        self.outside = (np.abs(bend) > limits.curvature).any(axis=1)
        self.outside |= np.linalg.norm(self._velocity, axis=1) > limits.speed
        self.outside |= np.linalg.norm(rates, axis=1) > limits.turning

    def what_left(self, robot: int, time: float) -> str | None:
        """What of one robot left the documented workspace, or None."""
        rates = self._simulation.qvel[robot]
        return self._limits.what_left(self.bend[robot], self._velocity[robot], rates, time)


def _largest(values: np.ndarray) -> float:
    """Largest absolute value, NaN if one is NaN."""
    return np.maximum.reduce(np.abs(values), axis=None)


class BeamReadout:
    """Exact measurements of a beam model's simulation."""

    truth = None

    def __init__(
        self,
        simulation: Any,
        least: Measurement,
        most: Measurement,
        servos: Servos | None = None,
    ) -> None:
        """Bind to a simulation.

        Args:
            simulation: A `simulation.beam_plant.BeamSimulation`.
            least, most: Bounds of what is measured.
            servos: What drives the tendons in length; measured are then the lengths pulled in.
        """
        self._simulation = simulation
        self.tip_position = lambda: self._now.tip_position
        self.tip_velocity = lambda: self._now.tip_velocity
        self.curvature = lambda: self._now.curvature
        self.curvature_rate = lambda: self._now.curvature_rate
        if servos is None:
            self.tendon_tension = simulation.ctrl.copy
            # An observation and `info` may both hold it.
            self.tendon_length = self.true_length = lambda: self._now.tendon_length.copy()
        else:
            self.tendon_tension = lambda: simulation.plant.tension(simulation.q, simulation.ctrl)
            self.tendon_length = lambda: servos.reading
            self.true_length = lambda: servos.horn.copy()
        self._names = [(name, k) for name, high in most._asdict().items() for k in range(len(high))]
        self._low, self._high = np.concatenate(least), np.concatenate(most)
        self._limit = float(most.curvature[0])
        self._directions = len(most.curvature) // simulation.plant.robot.pieces
        self.update()

    def update(self) -> str | None:
        """Measure anew; return what left the documented workspace, or None."""
        simulation = self._simulation
        self._now = now = simulation.plant.measure(simulation.q, simulation.v)
        self.tip, self.bend = now.tip_position.tolist(), now.curvature
        values = np.concatenate(now)
        if not np.all((self._low <= values) & (values <= self._high)):
            return self._outside(values)
        return None if self._directions == 1 else self._sharp_bend()

    def _sharp_bend(self) -> str | None:
        """The sharpest bend of a piece, to whatever side, if it is beyond the limit."""
        bend = self.bend
        if self._directions == 2:
            bend = np.hypot(bend[0::2], bend[1::2])
        return sharp_bend(bend, self._limit, self._simulation.time)

    def _outside(self, values: np.ndarray) -> str:
        """What lies farthest beyond its bounds, by their width."""
        beyond = np.maximum(self._low - values, values - self._high) / (self._high - self._low)
        worst = int(np.argmax(np.where(np.isnan(beyond), np.inf, beyond)))
        (name, k), time = self._names[worst], self._simulation.time
        if name == "curvature" and (text := self._sharp_bend()):
            return text
        bounds = f"[{self._low[worst]:.4g}, {self._high[worst]:.4g}]"
        return left_workspace(f"{name}[{k}] = {values[worst]:.4g} is outside {bounds}", time)


class SensedReadout:
    """A readout some of whose sensors err; `tip`, `bend` and `true_length` stay what they are."""

    def __init__(self, readout: Any, seen: dict[str, Read], look: Callable[..., Any]) -> None:
        """Put sensors before a readout.

        Args:
            readout: The exact one.
            seen: What sensors show, by name.
            look: Brings them to the next control instant, with the true tip and the robots `which`.
        """
        self._exact, self._seen, self._look = readout, seen, look
        for name in (*Measured.__annotations__, "true_length"):
            setattr(self, name, seen.get(name, getattr(readout, name)))
        self.tip, self.bend = readout.tip, readout.bend

    def truth(self) -> dict[str, np.ndarray]:
        """Of tip position [m] and curvature [1/m] what sensors show otherwise, for `info`."""
        true = {"tip_position": np.array(self.tip), "curvature": self.bend}
        return {name: value for name, value in true.items() if name in self._seen}

    def update(self, which: np.ndarray | None = None) -> str | None:
        """Measure anew, and look at all robots or at `which` (k,); what left the workspace."""
        outside = self._exact.update()
        self.tip, self.bend = self._exact.tip, self._exact.bend
        self._look(self.tip, which)
        return outside


def noisy(readout: Any, noise: SensorNoise, robots: int | slice) -> SensedReadout:
    """A readout with noise of `robots`: 0 where it is of one robot, `slice(None)` of many."""

    def seen(name: str) -> Read:
        read = getattr(readout, name)
        return lambda: read() + noise.on(name)[robots]

    seen_by_name = {name: seen(name) for name in SENSOR_NOISE}
    return SensedReadout(readout, seen_by_name, lambda _, which: noise.advance(which))
