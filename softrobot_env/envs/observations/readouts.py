"""Measurements of a running simulation (a chain, many chains, a beam model), through sensors.

Every readout has the functions of `table.Measured`, which return new arrays, and

* `tip`: position of the tip, [m] as plain numbers or (n, 2);
* `bend`: its mean curvatures [1/m], a new array at every `update`;
* `true_length`: function that returns a new array of true tendon lengths [m];
* `truth`: function that returns the true state for `info`, None if sensors are exact;
* `shape()`: rotation (1 or n, cells, 3) [1/m] of the parts between `cells` of its plant, as an
  array of NumPy;
* `update()`: measure again; returns what left the documented workspace, or None.
"""

from collections import deque
from collections.abc import Callable
from functools import partial
from math import ceil, hypot, sqrt
from operator import add
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy import ndarray
from numpy.linalg import norm

from softrobot_env.core.arrays import HOST, like, namespace, on_host
from softrobot_env.core.interfaces import Measurement
from softrobot_env.robots import CAMERA_PERIOD, VARIATIONS, RobotParams
from softrobot_env.scene.build import Scene
from softrobot_env.scene.chain import mean_curvature, station_strain
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import Simulation

from ..simulation.batch import BatchSimulation
from .table import SENSOR_NOISE, Measured, Read, curvature_rate_limit

if TYPE_CHECKING:  # compiled code takes time to load
    from softrobot_env.sensing.array import SensorArray


#: Standard deviations at which noise is truncated, so that it has bounds.
FARTHEST = 6.0

#: Standard deviations at scale 1 that fit into the observation spaces.
NOISE_ROOM = VARIATIONS["sensor_noise"].range[1] * FARTHEST

#: Number of control instants, or pictures of many cameras, whose noise is sampled at once.
_BLOCK = 64


def left_workspace(what: str, time: float) -> str:
    """Text of a failure."""
    return f"left the workspace: {what} at t = {time:.3f} s"


def sharp_bend(curvature: ndarray, limit: float, time: float) -> str | None:
    """Message about the sharpest of the bends (pieces,) [1/m], if it exceeds the limit."""
    piece = int(np.argmax(np.abs(curvature)))
    if not abs(curvature[piece]) > limit:
        return None
    where = f"of piece {piece + 1} of {len(curvature)}"
    return left_workspace(
        f"curvature {curvature[piece]:.4g} 1/m {where} is beyond +-{limit:g} 1/m", time
    )


class _ChainMeasures:
    """How chains of a scene are measured, and the limits of their workspace.

    Attributes:
        mean: (k, nv) [1/m], from hinge angles to the observed mean curvatures, see
            `scene.chain.mean_curvature`.
        fine: The same for the chain's own pieces, to which the limit of curvature applies.
        directions: Numbers of curvatures of a piece: 1 in a plane, 2 in space, 3 with twist.
        curvature: [1/m], limit of any piece's bend, and of its twist.
        speed: [m/s], of the tip.
        turning: [rad/s], root of the sum of the squared hinge rates. No mean curvature of a piece
            changes faster than `curvature_rate_limit` below it.
        slow: [rad/s], like `turning`; below it the tip is within its speed limit, too.
    """

    def __init__(self, scene: Scene, robot: RobotParams, pieces: int, speed: float) -> None:
        model, layout = scene.model, scene.layout
        self.mean = self.fine = mean_curvature(model, layout, pieces)
        if pieces != layout.pieces:
            self.fine = mean_curvature(model, layout, layout.pieces)
        self.directions = len(self.mean) // pieces
        self.curvature, self.speed = robot.curvature_limit, speed
        self.turning = curvature_rate_limit(robot, speed) / float(norm(self.mean, axis=1).max())
        # No hinge has a longer lever arm than the reach: slow hinges mean a slow tip.
        self.slow = min(self.turning, self.speed / (robot.reach * sqrt(self.mean.shape[1])))

    def sharpness(self, fine: ndarray) -> ndarray:
        """The larger of bend and twist (..., pieces) [1/m], from curvatures (..., k) of pieces."""
        if self.directions == 1:
            return abs(fine)
        kind, parts = namespace(fine), abs(fine).reshape(*fine.shape[:-1], -1, self.directions)
        bend = kind.hypot(parts[..., 0], parts[..., 1])
        return bend if self.directions == 2 else kind.maximum(bend, parts[..., 2])

    def what_left(
        self, fine: ndarray, velocity: ndarray, rates: ndarray, time: float
    ) -> str | None:
        """Message about a value beyond the limits, or None.

        Args:
            fine: (k,) [1/m], curvatures of the chain's own pieces.
            velocity: (2,) or (3,) [m/s], of the tip.
            rates: (nv,) [rad/s], of the hinges.
            time: [s], for the text.
        """
        bend = fine if self.directions == 1 else self.sharpness(fine)
        sharp = sharp_bend(bend, self.curvature, time)
        if sharp is not None:
            return sharp
        for what, value, limit, unit in (
            ("tip speed", float(norm(velocity)), self.speed, "m/s"),
            ("norm of the hinge rates", float(norm(rates)), self.turning, "rad/s"),
        ):
            if value > limit:
                return left_workspace(f"{what} {value:.4g} {unit} is beyond {limit:.4g}", time)
        return None


class _Chains:
    """Exact measurements of a chain or of many."""

    truth = sensors = motor_force = anchor_tension = None

    def __init__(
        self,
        simulation: Simulation | BatchSimulation,
        robot: RobotParams,
        pieces: int,
        speed: float,
        axes: slice,
        servos: Servos | None = None,
    ) -> None:
        """Bind to a simulation, or to many.

        Args:
            simulation: Of `robot` or of variations of it.
            robot: The robot.
            pieces: Number of pieces whose curvature is measured.
            speed: [m/s], limit of the tip's speed.
            axes: Measured coordinates of the tip, among x, y and z.
            servos: Servos that drive the tendons by length; then the lengths pulled in are
                measured.
        """
        scene, arrays = simulation.scene, getattr(simulation, "arrays", HOST)
        self._simulation, self._arrays = simulation, arrays
        source = getattr(simulation, "data", simulation)
        self._measures = _ChainMeasures(scene, robot, pieces, speed)
        self._angles, self._rates = angles, _ = source.qpos, source.qvel
        self._tip, self._velocity = (source.sensordata[..., k : k + 3][..., axes] for k in (0, 3))
        self.shape = lambda: station_strain(
            scene.model, scene.layout, np.atleast_2d(arrays.host(angles))
        )
        self.tendon_tension = lambda: arrays.copy(source.actuator_force)
        if robot.has_capstan_friction:
            # Friction is that of the last step, with a slightly different tension.
            self.anchor_tension = lambda: np.maximum(
                source.actuator_force - simulation.tension_lost, 0.0
            )
        if servos is None:
            inside, full = source.ten_length[..., : len(robot.tendons)], simulation.full_length
            self.tendon_length = self.true_length = partial(add, inside, full)
        else:
            self.tendon_length = lambda: servos.reading
            self.true_length = lambda: servos.pulled
            if robot.drive.gain is not None:
                self.motor_force = lambda: arrays.copy(servos.effort)
        self._bind()
        self.update()

    # Functions stored by a readout must not refer to it: a cycle would keep its simulation and
    # model until Python collects cycles, hundreds of resets later.
    def curvature(self) -> ndarray:
        """(..., k) [1/m]."""
        return self.bend


class ChainReadout(_Chains):
    """Exact measurements of a chain, through views, without look-ups during a step."""

    def _bind(self) -> None:
        measures, rates = self._measures, self._rates
        self._mean, self._fine = mean, fine = measures.mean, measures.fine
        self._coarse = fine is not mean
        self._limit, self._slow = measures.curvature, measures.slow
        self.tip_position, self.tip_velocity = self._tip.copy, self._velocity.copy
        self.curvature_rate = partial(mean.dot, rates)
        self.tendon_tension = self._simulation.data.actuator_force.copy

    def update(self, _which: None = None) -> str | None:
        """Measure again; return what left the documented workspace, or None."""
        angles = self._angles
        self.tip = self._tip.tolist()
        self.bend = fine = self._mean.dot(angles)
        if self._coarse:
            fine = self._fine.dot(angles)
        # The norms bound all pieces and the tip, so the exact check runs only near the limits.
        if hypot(*fine.tolist()) > self._limit or hypot(*self._rates.tolist()) > self._slow:
            return self._measures.what_left(
                fine, self._velocity, self._rates, self._simulation.data.time
            )
        return None


class BatchReadout(_Chains):
    """Exact measurements of n chains, as arrays of the same kind as in their simulations.

    Attributes:
        outside: (n,) bool, which robots left the workspace, see `what_left`.
    """

    def _bind(self) -> None:
        simulation, measures, arrays = self._simulation, self._measures, self._arrays
        self._mean = self._fine = arrays.real(measures.mean.T)
        if measures.fine is not measures.mean:
            self._fine = arrays.real(measures.fine.T)
        self._gentle = measures.curvature / sqrt(measures.directions)
        self._slow = measures.slow / sqrt(simulation.qvel.shape[1])
        self._nobody = np.zeros(simulation.count, bool)
        self._nobody.flags.writeable = False
        mean, velocity = self._mean, self._velocity
        self.tip_velocity = lambda: arrays.copy(velocity)
        self.curvature_rate = lambda: arrays.real(simulation.qvel) @ mean

    def tip_position(self) -> ndarray:
        """(n, axes) [m]."""
        return self.tip

    def update(self, _which: ndarray | None = None) -> None:
        """Measure again."""
        simulation, measures, arrays = self._simulation, self._measures, self._arrays
        angles, rates = arrays.real(simulation.qpos), arrays.real(simulation.qvel)
        self.tip = arrays.copy(self._tip)
        self.bend = self._bends = angles @ self._mean
        if self._fine is not self._mean:
            self._bends = angles @ self._fine
        # Any NaN fails the first tests; then every robot is checked individually.
        if _largest(self._bends) <= self._gentle and _largest(rates) <= self._slow:
            self.outside = self._nobody
            return
        outside = (measures.sharpness(self._bends) > measures.curvature).any(axis=1)
        outside |= _norms(self._velocity) > measures.speed
        outside |= _norms(rates) > measures.turning
        self.outside = arrays.host(outside)

    def what_left(self, robot: int, time: float) -> str | None:
        """What left the documented workspace of one robot, or None."""
        own = (self._bends[robot], self._velocity[robot], self._simulation.qvel[robot])
        return self._measures.what_left(*map(self._arrays.host, own), time)


def _largest(values: ndarray) -> float:
    """Largest absolute value, NaN if one is NaN."""
    return abs(values).max()


def _norms(values: ndarray) -> ndarray:
    """Lengths (n,) of the rows of (n, k)."""
    return (values * values).sum(axis=1) ** 0.5


class BeamReadout:
    """Exact measurements of a beam model's simulation."""

    truth = sensors = motor_force = anchor_tension = None

    def __init__(
        self, simulation: Any, least: Measurement, most: Measurement, servos: Servos | None = None
    ) -> None:
        """Bind to a simulation.

        Args:
            simulation: A `simulation.plants.BeamSimulation`.
            least, most: Bounds of the measurements.
            servos: Servos that drive the tendons by length; then the lengths pulled in are
                measured.
        """
        self._simulation, self._servos = simulation, servos
        self.shape = lambda: simulation.plant.shape(simulation.q)[None]
        if servos is None:
            self.tendon_tension = simulation.ctrl.copy
        else:
            self.tendon_tension = lambda: simulation.plant.tension(simulation.q, simulation.ctrl)
        self._names = [(name, k) for name, high in most._asdict().items() for k in range(len(high))]
        self._low, self._high = np.concatenate(least), np.concatenate(most)
        self._limit = float(most.curvature[0])
        self._directions = len(most.curvature) // simulation.plant.robot.pieces
        self.update()

    def update(self, _which: None = None) -> str | None:
        """Measure again; return what left the documented workspace, or None."""
        simulation = self._simulation
        self._now = now = simulation.plant.measure(simulation.q, simulation.v)
        self.tip, self.bend = now.tip_position.tolist(), now.curvature
        values = np.concatenate(now)
        if not np.all((self._low <= values) & (values <= self._high)):
            return self._outside(values)
        return None if self._directions == 1 else self._sharp_bend()

    def tip_position(self) -> ndarray:
        """(axes,) [m]."""
        return self._now.tip_position

    def tip_velocity(self) -> ndarray:
        """(axes,) [m/s]."""
        return self._now.tip_velocity

    def curvature(self) -> ndarray:
        """(k,) [1/m]."""
        return self._now.curvature

    def curvature_rate(self) -> ndarray:
        """(k,) [1/(m s)]."""
        return self._now.curvature_rate

    def tendon_length(self) -> ndarray:
        """(n_tendons,) [m], as measured; an observation and `info` may both hold it."""
        servos = self._servos
        return self._now.tendon_length.copy() if servos is None else servos.reading

    def true_length(self) -> ndarray:
        """(n_tendons,) [m]."""
        servos = self._servos
        return (self._now.tendon_length if servos is None else servos.horn).copy()

    def _sharp_bend(self) -> str | None:
        """Message about the sharpest bend of a piece, in any direction, if it exceeds the limit."""
        bend = self.bend
        if self._directions == 2:
            bend = np.hypot(bend[0::2], bend[1::2])
        return sharp_bend(bend, self._limit, self._simulation.time)

    def _outside(self, values: ndarray) -> str:
        """The value farthest beyond its bounds, relative to their width."""
        beyond = np.maximum(self._low - values, values - self._high) / (self._high - self._low)
        worst = int(np.argmax(np.where(np.isnan(beyond), np.inf, beyond)))
        (name, k), time = self._names[worst], self._simulation.time
        if name == "curvature" and (text := self._sharp_bend()):
            return text
        bounds = f"[{self._low[worst]:.4g}, {self._high[worst]:.4g}]"
        return left_workspace(f"{name}[{k}] = {values[worst]:.4g} is outside {bounds}", time)


#: True values that `info` contains if sensors show something else.
_TRUE = ("tip_position", "curvature")


class SensedReadout:
    """A readout with some imperfect sensors; `tip`, `bend` and `true_length` stay exact."""

    def __init__(self, readout: Any, seen: dict[str, Read], look: Callable[..., Any]) -> None:
        """Add sensors to a readout.

        Args:
            readout: The exact one.
            seen: Sensor values, by name.
            look: Advances them to the next control instant, given the true tip and the robots
                `which`.
        """
        self._exact, self._seen, self._look = readout, seen, look
        for name in (*Measured.__annotations__, "true_length"):
            setattr(self, name, seen.get(name, getattr(readout, name)))
        self.tip, self.bend = readout.tip, readout.bend
        if not seen.keys() & set(_TRUE):
            self.truth = readout.truth

    def truth(self) -> dict[str, ndarray]:
        """True tip position [m] and curvature [1/m] if sensors show others, for `info`."""
        tip = np.array(self.tip) if namespace(self.tip) is np else self.tip
        true = dict(zip(_TRUE, (tip, self.bend), strict=True))
        return {name: value for name, value in true.items() if name in self._seen}

    def update(self, which: ndarray | None = None) -> str | None:
        """Measure all robots or `which` (k,) again; returns what left the workspace."""
        outside = self._exact.update(which)
        self.tip, self.bend = self._exact.tip, self._exact.bend
        self._look(self.tip, which)
        return outside


def fitted(readout: Any, sensors: "SensorArray", robots: int | slice) -> SensedReadout:
    """An exact readout with the curvature sensors of `robots`, see `noisy`."""
    return SensedReadout(
        readout,
        {"sensors": lambda: like(sensors.reading[robots].copy(), readout.tip)},
        lambda _, which: sensors.look(readout.shape(), which),
    )


def _normal(generator: np.random.Generator, shape: tuple[int, ...]) -> ndarray:
    """Standard normal variates, truncated at `FARTHEST`."""
    return np.clip(generator.standard_normal(shape), -FARTHEST, FARTHEST)


class SensorNoise:
    """White Gaussian noise of n robots' sensors, none until started.

    Normal variates beyond 6 standard deviations (one in 5e8) are set to 6. Every robot's noise
    depends only on its seed: noise is drawn for all observables, observed or not.
    """

    def __init__(self, count: int, sizes: dict[str, int]) -> None:
        """No noise for `count` robots, whose observables with sensors have these sizes."""
        each = list(sizes.values())
        ends = np.cumsum(each)
        self._columns = dict(zip(sizes, map(slice, ends - each, ends), strict=True))
        self._deviation = np.repeat([SENSOR_NOISE[name] for name in sizes], each)
        self._everyone = np.arange(count)
        self._scale = np.zeros(count)
        self._generators: list[np.random.Generator | None] = [None] * count
        self._rows = np.zeros((count, _BLOCK, len(self._deviation)))
        self._at = np.zeros(count, int)
        self._now = self._rows[:, 0]

    def start(self, robot: int, scale: float, seed: int | None) -> None:
        """Start a robot's episode with noise of a scale [1]; the seed is None if that is 0."""
        self._scale[robot] = scale
        self._generators[robot] = None if seed is None else np.random.default_rng(seed)
        self._rows[robot] = 0.0
        self._at[robot] = _BLOCK - 1  # the next instant draws

    def advance(self, which: ndarray | None = None) -> None:
        """Advance all robots, or `which` (k,) int, to the next control instant."""
        which = self._everyone if which is None else which
        self._at[which] += 1
        for robot in np.flatnonzero(self._at == _BLOCK).tolist():
            self._at[robot] = 0
            self._draw(robot)
        self._now = self._rows[self._everyone, self._at]

    def _draw(self, robot: int) -> None:
        generator = self._generators[robot]
        if generator is not None:
            normal = _normal(generator, self._rows.shape[1:])
            self._rows[robot] = normal * (self._scale[robot] * self._deviation)

    def on(self, name: str) -> ndarray:
        """Noise (n, size) on an observable of `observations.table` at this instant."""
        return self._now[:, self._columns[name]]

    @property
    def noisy(self) -> ndarray:
        """(n,) bool, which robots have noise."""
        return self._scale > 0


def noisy(readout: Any, noise: SensorNoise, robots: int | slice) -> SensedReadout:
    """A readout with noise of `robots`: 0 for a single one, `slice(None)` for many."""

    def seen(name: str) -> Read:
        read = getattr(readout, name)
        return lambda: (value := read()) + like(noise.on(name)[robots], value)

    seen_by_name = {name: seen(name) for name in SENSOR_NOISE}
    return SensedReadout(readout, seen_by_name, lambda _, which: noise.advance(which))


class Camera:
    """A camera with delay and noise, which takes one picture per `CAMERA_PERIOD` on average.

    Each picture is taken at the first control instant after it is due: pictures are a whole number
    of control periods apart, just below or above a `CAMERA_PERIOD`, and one if the control period
    is longer.

    Attributes:
        position: (coordinates,) [m], from the newest available picture.
        velocity: (coordinates,) [m/s], difference to the previous picture over the time between.
    """

    def __init__(
        self, noise: float, delay: int, control_period: float, coordinates: int = 2, seed: int = 0
    ) -> None:
        """A camera with noise of standard deviation `noise` [m], late by `delay` control periods.

        It measures so many coordinates.
        """
        self._noise, self._delay, self._period = noise, delay, control_period
        self._frame, self._coordinates = CAMERA_PERIOD / control_period, coordinates
        self._switch_on(seed)

    def _switch_on(self, seed: int) -> None:
        self._generator = np.random.default_rng(seed)
        self._instant, self._due = -1, 0.0
        self._undeveloped: deque[tuple[int, ndarray]] = deque()
        self._taken = -1
        self.position, self.velocity = np.zeros((2, self._coordinates))

    def start(self, _which: ndarray, seeds: list[int], tip: ndarray) -> None:
        """Take two pictures of a tip at rest at (1, coordinates) [m]."""
        self._switch_on(seeds[0])
        for _ in range(self._delay + 2 * ceil(self._frame)):
            self.see(tip[0])

    def see(self, tip: ndarray) -> bool:
        """Advance to the next control instant, with the tip at (coordinates,) [m].

        Returns:
            Whether there is a new picture.
        """
        self._instant += 1
        if self._instant >= self._due:
            self._due += self._frame
            normal = _normal(self._generator, self.position.shape)
            self._undeveloped.append((self._instant, tip + self._noise * normal))
        if not self._undeveloped or self._undeveloped[0][0] > self._instant - self._delay:
            return False
        taken, seen = self._undeveloped.popleft()
        self.velocity = (seen - self.position) / ((taken - self._taken) * self._period)
        self.position, self._taken = seen, taken
        return True

    @property
    def age(self) -> float:
        """Age [s] of the newest available picture."""
        return (self._instant - self._taken) * self._period


class Cameras:
    """Cameras of n robots, like `Camera` for each.

    Attributes:
        position, velocity: (n, coordinates) [m, m/s], see `Camera`.
    """

    def __init__(
        self, count: int, noise: float, delay: int, control_period: float, coordinates: int = 2
    ) -> None:
        """Cameras that have not been started; arguments as in `Camera`."""
        self._noise, self._delay, self._period = noise, delay, control_period
        self._frame = CAMERA_PERIOD / control_period
        self._everyone = np.arange(count)
        self._generators: list[np.random.Generator | None] = [None] * count
        self._normal = np.zeros((count, _BLOCK, coordinates))
        # Rings of pictures not yet available: at most one per instant.
        self._seen = np.zeros((count, delay + 1, coordinates))
        self._when = np.zeros((count, delay + 1), int)
        self._instant, self._due = np.zeros(count, int), np.zeros(count)
        self._pictures, self._developed = np.zeros((2, count), int)
        self._taken = np.zeros(count, int)
        self.position, self.velocity = np.zeros((2, count, coordinates))

    def start(self, which: ndarray, seeds: list[int], tip: ndarray) -> None:
        """Start cameras `which` (k,), each with a seed, for tips at rest at (k, coordinates)."""
        for i, seed in zip(which.tolist(), seeds, strict=True):
            self._generators[i] = np.random.default_rng(seed)
        self._instant[which] = self._taken[which] = -1
        self._due[which] = self._pictures[which] = self._developed[which] = 0
        self.position[which] = self.velocity[which] = 0.0
        tips = np.zeros_like(self.position)
        tips[which] = tip
        for _ in range(self._delay + 2 * ceil(self._frame)):
            self.see(tips, which)

    def see(self, tip: ndarray, which: ndarray | None = None) -> None:
        """Advance all cameras, or `which` (k,), to the next instant; tips (n, coordinates)."""
        which = self._everyone if which is None else which
        self._instant[which] += 1
        self._take(which[self._instant[which] >= self._due[which]], tip)
        # The oldest picture not yet available; if there is none, this is an older one.
        oldest = self._when[which, self._developed[which] % (self._delay + 1)]
        late = oldest <= self._instant[which] - self._delay
        self._develop(which[late & (self._developed[which] < self._pictures[which])])

    def _take(self, which: ndarray, tip: ndarray) -> None:
        """Take pictures of the tips `which` (k,) of all."""
        self._due[which] += self._frame
        number = self._pictures[which]
        place = number % (self._delay + 1)
        at = number % _BLOCK
        for i in which[at == 0].tolist():
            self._normal[i] = _normal(self._generators[i], self._normal.shape[1:])
        self._seen[which, place] = tip[which] + self._noise * self._normal[which, at]
        self._when[which, place] = self._instant[which]
        self._pictures[which] += 1

    def _develop(self, which: ndarray) -> None:
        """Make the next pictures of cameras `which` (k,) available."""
        place = self._developed[which] % (self._delay + 1)
        seen, taken = self._seen[which, place], self._when[which, place]
        passed = (taken - self._taken[which]) * self._period
        self.velocity[which] = (seen - self.position[which]) / passed[:, None]
        self.position[which], self._taken[which] = seen, taken
        self._developed[which] += 1


def filmed(readout: ChainReadout | BatchReadout, camera: Camera | Cameras) -> SensedReadout:
    """A readout of the tip through cameras; every `update` is their next control instant."""
    seen = {
        "tip_position": lambda: like(camera.position.copy(), readout.tip),
        "tip_velocity": lambda: like(camera.velocity.copy(), readout.tip),
    }
    if isinstance(camera, Cameras):
        return SensedReadout(readout, seen, lambda tip, which: camera.see(on_host(tip), which))
    return SensedReadout(readout, seen, lambda tip, _: camera.see(np.array(tip)))
