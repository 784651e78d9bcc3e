"""The observables of agents: each with its size, bounds, unit, source and noise.

An agent sees a dict of them in SI units, or one vector of order 1 (`VectorView`), as learning
libraries expect.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import NamedTuple, Protocol

import numpy as np
from gymnasium import spaces
from numpy import ndarray

from softrobot_env.core.arrays import HostArrays, namespace
from softrobot_env.core.interfaces import Seen
from softrobot_env.core.registry import Registry
from softrobot_env.core.vector_reading import Reading
from softrobot_env.robots import RobotParams
from softrobot_env.scene.integration.layout import HUGE_FORCE
from softrobot_env.scene.quadrature import HingeLayout
from softrobot_env.scene.timestep import slowest
from softrobot_env.sensing.optics import readings

#: Fastest reference that an environment accepts, in lengths of the straight robot per second, and
#: the largest acceleration, in lengths per second squared.
REFERENCE_SPEED, REFERENCE_ACCELERATION = 10.0, 1000.0

#: Factor of the measurable speed on the one that a robot's material, tendons and weight can cause:
#: varied robots are faster, and so is the tip of a whip.
SPEED_ROOM = 30.0

#: Typical sizes: lateral motion of a tip, over the reach [1], and bend of the whole robot [rad].
_SWAY, _BEND = 0.05, 2.0

#: Least scale of tendon lengths, over the robot's length: for tendons that no bend pulls in.
_SHORTEST = 1e-3

Read = Callable[[], ndarray]


def speed_limit(robot: RobotParams) -> float:
    """Speed [m/s] of the tip beyond which an episode fails.

    Bending waves with strains that fold the material move it about as fast as sound, sqrt(E / rho),
    in the section where that is fastest. Full tensions along the length, and a fall over twice the
    reach, add their energy.
    """
    pull = sum(tendon.tension_limit for tendon in robot.tendons) * robot.length / robot.mass
    fall = float(np.linalg.norm(robot.gravity)) * 2 * robot.reach
    sound = max(part.youngs_modulus / part.density for part in robot.backbone.sections)
    return SPEED_ROOM * sqrt(sound + 2 * (pull + fall))


def curvature_rate_limit(robot: RobotParams, speed: float) -> float:
    """Rate [1/(m s)] of curvature beyond which an episode fails.

    That of a wave with the robot's largest curvature and the length of its radius, at the limit of
    speed [m/s].
    """
    return speed * robot.curvature_limit**2


@dataclass(frozen=True)
class Sizes:
    """What the shapes and bounds of observables depend on.

    Attributes:
        robot: The robot that is observed.
        layout: Hinges of its chain.
        pieces: Number of pieces whose curvature is observed.
        speed: [m/s], limit of the tip's speed.
        directions: Numbers of curvatures of a piece: 1 in a plane, 2 in space, 3 with torsion.
        axes: Coordinates of positions among x, y and z, a slice of (3,).
        n_preview: Number of preview times.
        n_inputs: Number of actions.
        pulled: Largest length [m] that servos pull in, if they drive the tendons.
        tip_room: [m] by which a measured tip may lie beyond the robot's reach.
        speed_room: [m/s] by which a measured speed may lie beyond the limit.
        strain: Largest axial strain [1] of the robot's model.
        noise: Room for noise, in standard deviations of the sensors at scale 1.
    """

    robot: RobotParams
    layout: HingeLayout
    pieces: int
    speed: float
    directions: int
    axes: slice
    n_preview: int = 1
    n_inputs: int = 1
    pulled: float | None = None
    tip_room: float = 0.0
    speed_room: float = 0.0
    strain: float = 0.0
    noise: float = 0.0

    @property
    def dimensions(self) -> int:
        """Number of coordinates of a position."""
        return len(range(3)[self.axes])

    @cached_property
    def frequency(self) -> float:
        """About the robot's first angular frequency [rad/s]."""
        return slowest(self.robot, self.robot.drive.kind == "length")

    @property
    def origin(self) -> ndarray:
        """(dimensions,) [m], where the robot is clamped."""
        base = self.robot.base
        return np.zeros(self.dimensions) if base is None else np.array(base.position[self.axes])


class Measured(Protocol):
    """Functions of a plant that return new arrays, (size,) for one robot or (n, size) for n."""

    tip_position: Read
    tip_velocity: Read
    curvature: Read
    curvature_rate: Read
    tendon_tension: Read
    tendon_length: Read
    sensors: Read | None
    motor_force: Read | None
    anchor_tension: Read | None


class Sources(NamedTuple):
    """Where observables come from: the plant, the reference at this instant, and the policy.

    Attributes:
        measured: Measurements of the plant.
        reference: Function from the name of a column of `reference.ReferenceTable` to a function
            that returns its row at this control instant.
        action: Function that returns the current action.
    """

    measured: Measured
    reference: Callable[[str], Read]
    action: Read


@dataclass(frozen=True)
class Observable:
    """An observable quantity.

    Attributes:
        unit: In SI.
        space: Its box, with bounds.
        read: Makes the function that reads it.
        scale: Its typical deviation from the middle of the box, one for all entries or one each:
            that of wide motions at the first frequency.
        noise: Standard deviation of its sensor's noise at scale 1, independent in every control
            period: a policy that samples more often can average more of it out.
        usual: Kinds of drives of the robots for which it is observed by default.
    """

    unit: str
    space: Callable[[Sizes], spaces.Box]
    read: Callable[[Sources], Read]
    scale: Callable[[Sizes], float | ndarray]
    noise: float = 0.0
    usual: tuple[str, ...] = ()


def known_of(robot: RobotParams) -> tuple[str, ...]:
    """Names of a robot's observables: those of optional parts only if it has them."""
    missing = {"sensors"} if not robot.sensors else set()
    if robot.drive.gain is None:
        missing.add("motor_force")
    if not robot.has_capstan_friction:
        missing.add("anchor_tension")
    return tuple(name for name in OBSERVABLES if name not in missing)


def usual_of(robot: RobotParams) -> tuple[str, ...]:
    """Names of the observables of an environment by default."""
    drive = robot.drive.kind
    return tuple(name for name, one in OBSERVABLES.registered().items() if drive in one.usual)


def symmetric(size: int, bound: float | ndarray) -> spaces.Box:
    """Box (size,) of float64 between -bound and bound."""
    high = np.broadcast_to(np.asarray(bound, np.float64), (size,))
    return spaces.Box(-high, high, dtype=np.float64)


def _positions(s: Sizes, points: int = 1, room: float = 0.0) -> spaces.Box:
    # The margin covers the rounding of a straight robot's tip.
    middle, far = np.tile(s.origin, points), s.robot.reach * (1 + 1e-9) + room
    return spaces.Box(middle - far, middle + far, dtype=np.float64)


def _vector(s: Sizes, bound: float) -> spaces.Box:
    return symmetric(s.dimensions, bound)


def _tendon_tension(s: Sizes) -> spaces.Box:
    limit = s.robot.of_tendons("tension_limit")
    return spaces.Box(np.zeros_like(limit), limit * (1 + 1e-9), dtype=np.float64)


def _anchor_tension(s: Sizes) -> spaces.Box:
    """Up to the tension that friction holds in a tendon pulled by the limit, then released."""
    high = s.robot.of_tendons("tension_limit") * np.exp(s.robot.most_exponents)
    return spaces.Box(np.zeros_like(high), high, dtype=np.float64)


def _tendon_length(s: Sizes) -> spaces.Box:
    """Lengths inside the robot, or lengths pulled in if servos drive the tendons."""
    if s.pulled is not None:
        return symmetric(len(s.robot.tendons), s.pulled)
    ends = s.robot.of_tendons("straight_length")
    moment_arm = s.robot.of_tendons("farthest")
    change = ends * moment_arm * s.robot.curvature_limit + s.strain * ends
    return spaces.Box(ends - change, ends + change, dtype=np.float64)


def _position_scale(s: Sizes) -> float:
    return s.robot.reach / 2


def _speed_scale(s: Sizes) -> float:
    return _SWAY * s.robot.reach * s.frequency


def _bend_scale(s: Sizes) -> float:
    return _BEND / s.robot.length


def _length_scale(s: Sizes) -> ndarray:
    """Length by which a typical bend pulls tendons in, or half of the servos' travel."""
    if s.pulled is not None:
        return np.full(len(s.robot.tendons), s.pulled / 2)
    pulled = (t.straight_length * t.farthest * _bend_scale(s) for t in s.robot.tendons)
    return np.maximum(np.fromiter(pulled, float), _SHORTEST * s.robot.length)


_ALWAYS = ("tension", "length")

#: Every observable. Positions have the coordinates that the task names; curvatures are listed piece
#: by piece, (beta, gamma) each for a spatial robot, plus torsion if it twists.
OBSERVABLES: Registry[Observable] = Registry(
    "observable",
    {
        "tip_position": Observable(
            "m",
            lambda s: _positions(s, room=s.tip_room + s.strain * s.robot.length),
            lambda o: o.measured.tip_position,
            _position_scale,
            1e-4,
            _ALWAYS,
        ),
        "tip_velocity": Observable(
            "m/s",
            lambda s: _vector(s, s.speed + s.speed_room),
            lambda o: o.measured.tip_velocity,
            _speed_scale,
            5e-3,
            _ALWAYS,
        ),
        "curvature": Observable(
            "1/m",
            lambda s: symmetric(s.directions * s.pieces, s.robot.curvature_limit),
            lambda o: o.measured.curvature,
            _bend_scale,
            0.01,
            ("tension",),
        ),
        "curvature_rate": Observable(
            "1/(m s)",
            lambda s: symmetric(s.directions * s.pieces, curvature_rate_limit(s.robot, s.speed)),
            lambda o: o.measured.curvature_rate,
            lambda s: _bend_scale(s) * s.frequency,
            0.5,
            ("tension",),
        ),
        "tendon_tension": Observable(
            "N",
            _tendon_tension,
            lambda o: o.measured.tendon_tension,
            lambda s: s.robot.of_tendons("tension_limit") / 2,
        ),
        "tendon_length": Observable(
            "m",
            _tendon_length,
            lambda o: o.measured.tendon_length,
            _length_scale,
            usual=("length",),
        ),
        "anchor_tension": Observable(
            "N",
            _anchor_tension,
            lambda o: o.measured.anchor_tension,
            lambda s: s.robot.of_tendons("tension_limit") / 2,
        ),
        "motor_force": Observable(
            "N",
            lambda s: symmetric(
                len(s.robot.tendons), min(s.robot.drive.force_limit, HUGE_FORCE) * (1 + 1e-9)
            ),
            lambda o: o.measured.motor_force,
            lambda s: s.robot.of_tendons("tension_limit") / 2,
        ),
        "reference": Observable(
            "m", _positions, lambda o: o.reference("position"), _position_scale, usual=_ALWAYS
        ),
        "reference_velocity": Observable(
            "m/s",
            lambda s: _vector(s, REFERENCE_SPEED * s.robot.reach),
            lambda o: o.reference("velocity"),
            _speed_scale,
            usual=_ALWAYS,
        ),
        "reference_acceleration": Observable(
            "m/s2",
            lambda s: _vector(s, REFERENCE_ACCELERATION * s.robot.reach),
            lambda o: o.reference("acceleration"),
            lambda s: _speed_scale(s) * s.frequency,
            usual=("length",),
        ),
        "reference_preview": Observable(
            "m",
            lambda s: _positions(s, s.n_preview),
            lambda o: o.reference("preview"),
            _position_scale,
            usual=_ALWAYS,
        ),
        "sensors": Observable(
            "1 or rad",
            lambda s: spaces.Box(*readings(s.robot.sensors), dtype=np.float64),
            lambda o: o.measured.sensors,
            lambda s: 0.5,
        ),
        "previous_action": Observable(
            "1",
            lambda s: symmetric(s.n_inputs, 1.0),
            lambda o: o.action,
            lambda s: 0.5,
            0.0,
            _ALWAYS,
        ),
    },
)

#: Those included in "all": sensors cost time and their noise draws from the environment's
#: generator, and registered observables are for those who name them.
EVERY = tuple(name for name in OBSERVABLES.registered() if name != "sensors")


def register_observable(name: str, observable: Observable, replace: bool = False) -> None:
    """Add an observable of simulated robots, or replace one; environments use it by name.

    Its `read` gets measurements with the noise of their own sensors, (size,) for one robot or (n,
    size) for many.

    Raises:
        ValueError: The name is taken and `replace` is not set, or it has noise of its own.
    """
    if observable.noise:
        raise ValueError(f"observable {name!r}: only what sensors measure has noise, not more")
    OBSERVABLES.register(name, observable, replace)


#: Standard deviations of noise of scale 1 by observable; the others have none.
SENSOR_NOISE = {name: o.noise for name, o in OBSERVABLES.registered().items() if o.noise}


def chosen(
    observe: tuple[str, ...] | str, known: tuple[str, ...], every: Iterable[str] = EVERY
) -> tuple[str, ...]:
    """Names of the requested observables.

    Args:
        observe: Their names, or one name. "all" among them stands for `every`: ("all", "sensors").
        known: Names that the environment has.
        every: Those included in "all", if they are known.

    Raises:
        ValueError: No name, an unknown name or a repeated one.
    """
    every = [name for name in every if name in known]
    asked = (observe,) if isinstance(observe, str) else observe
    listed = tuple(asked) if np.iterable(asked) else ()
    names = tuple(n for name in listed for n in (every if name == "all" else [name]))
    if not names or not all(name in known for name in names) or len(set(names)) < len(names):
        raise ValueError(f"observe needs distinct names out of {', '.join(known)}; got {observe!r}")
    return names


def observation_space(
    observe: tuple[str, ...] | str, known: tuple[str, ...], sizes: Sizes
) -> spaces.Dict:
    """Dict space of some of a robot's observables; arguments and errors as in `chosen`."""
    boxes = {}
    for name in chosen(observe, known):
        box, room = OBSERVABLES[name].space(sizes), sizes.noise * OBSERVABLES[name].noise
        if room:
            box = spaces.Box(box.low - room, box.high + room, dtype=box.dtype)
        boxes[name] = box
    return spaces.Dict(boxes)


#: A view of the same registry that does not load plug-ins: a reset already knows the names.
_ENTRIES = OBSERVABLES.registered()


def reads(observed: spaces.Dict, sources: Sources) -> list[tuple[str, Read]]:
    """Names of the observables of a space, in its order, and the functions that read them."""
    return [(name, _ENTRIES[name].read(sources)) for name in observed]


def arrays(observation: Seen) -> list[ndarray]:
    """The arrays that an observation is made of."""
    return list(observation.values()) if isinstance(observation, dict) else [observation]


def each_of(observation: Seen, change: Callable[[ndarray], ndarray]) -> Seen:
    """An observation with a function applied to its arrays, such as a copy."""
    if isinstance(observation, ndarray):
        return change(observation)
    return {name: change(value) for name, value in observation.items()}


#: Scales of the tracking error in a vector, over the robot's reach: far from and near the
#: reference.
FAR, NEAR = 0.1, 0.002

#: Scale of the reference's motion within the preview, over the robot's reach.
_AHEAD = 0.05


class Entries(NamedTuple):
    """Consecutive entries of a vector: asinh((`name` - `origin`) / scale).

    Attributes:
        label: Name of the entries.
        name: The observable.
        origin: Another observable, or numbers in its unit.
        scale: In its unit.
    """

    label: str
    name: str
    origin: str | ndarray
    scale: float | ndarray


class VectorView:
    """Reads an observation, a dict in SI units, as one float32 vector.

    Every entry is asinh(x / scale) of an x in SI units: linear in x / scale up to 1 and logarithmic
    beyond, so that nothing is clipped and all bounds are small. Scales belong to the robot
    (`Observable.scale`). If the tip is observed too, the reference enters as its error, once over
    `FAR` and once over `NEAR`, and the preview relative to the reference.

    Attributes:
        space: Box (k,) of float32, with the bounds of the observables.
        layout: Slices of the vector by name.
        reading: Description from which the vector of an observation is computed.
    """

    def __init__(self, observed: Mapping[str, spaces.Box], parts: list[Entries]) -> None:
        """A view of observations in a space, with the parts of the vector concatenated."""
        self._names = tuple(observed)
        where = _slices({name: box.shape[0] for name, box in observed.items()})
        self.layout = _slices({part.label: observed[part.name].shape[0] for part in parts})
        places = {name: np.arange(own.start, own.stop) for name, own in where.items()}
        take = np.concatenate([places[part.name] for part in parts])
        origin, scale = np.zeros((2, len(take)))
        relative, less = np.zeros((2, 0), int)
        for part in parts:
            own = self.layout[part.label]
            scale[own] = part.scale
            if isinstance(part.origin, str):
                here = np.arange(own.start, own.stop)
                relative = np.append(relative, here)
                less = np.append(less, np.resize(places[part.origin], len(here)))
            else:
                origin[own] = part.origin
        entries = np.array([box.shape[0] for box in observed.values()])
        names = np.array(self._names)
        self.reading = Reading(names, entries, take, origin, scale, relative, less)
        self.space = self._bounds(observed)

    def _bounds(self, observed: Mapping[str, spaces.Box]) -> spaces.Box:
        low, high = (
            np.concatenate([getattr(box, end) for box in observed.values()])
            for end in ("low", "high")
        )
        least, most = (
            self.reading(*ends).astype(np.float32) for ends in ((low, high), (high, low))
        )
        # Rounding must not take a vector out of its space.
        return spaces.Box(
            np.nextafter(least, -np.float32(np.inf)), np.nextafter(most, np.float32(np.inf))
        )

    def __call__(self, observation: Mapping[str, ndarray]) -> ndarray:
        """Vectors (..., k) of observations (..., size)."""
        return self._read(observation, self.reading)

    def on(self, arrays: HostArrays) -> Callable[[Mapping[str, ndarray]], ndarray]:
        """The same for observations made of `arrays`."""
        reading = self.reading.on(arrays)
        return lambda observation: self._read(observation, reading)

    def _read(self, observation: Mapping[str, ndarray], reading: Reading) -> ndarray:
        parts = [observation[name] for name in self._names]
        kind = namespace(parts[0])
        return kind.asarray(reading(kind.concatenate(parts, axis=-1)), dtype=kind.float32)


def _slices(sizes: Mapping[str, int]) -> dict[str, slice]:
    """Slices of concatenated parts of these sizes."""
    ends = np.cumsum(list(sizes.values())).tolist()
    return {
        name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)
    }


def entries(observed: spaces.Dict, sizes: Sizes) -> list[Entries]:
    """Entries of the vector for the observables of a robot's space."""
    reach, parts = sizes.robot.reach, []
    for name, box in observed.items():
        middle, scale = (box.low + box.high) / 2, OBSERVABLES[name].scale(sizes)
        own = Entries(name, name, middle, scale)
        if name == "reference" and "tip_position" in observed.spaces:
            far = Entries("tracking_error", name, "tip_position", FAR * reach)
            parts += [far, far._replace(label="tracking_error_near", scale=NEAR * reach)]
        elif name == "reference_preview" and "reference" in observed.spaces:
            parts.append(own._replace(origin="reference", scale=_AHEAD * reach))
        else:
            parts.append(own)
    return parts
