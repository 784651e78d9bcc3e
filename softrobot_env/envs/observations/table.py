"""What an agent can observe: every quantity with its size, bounds, unit, source and noise, once.

An agent sees a dict of them in SI units, or one vector of order 1 (`VectorView`), as learning
libraries expect it.
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

#: Fastest reference an environment accepts, in lengths of the straight robot per second, and the
#: largest acceleration, in lengths per second squared.
REFERENCE_SPEED, REFERENCE_ACCELERATION = 10.0, 1000.0

#: Times the speed that a robot's material, tendons and weight can give, it may be measured: varied
#: robots are faster, and in whips the tip is.
SPEED_ROOM = 30.0

#: Usual sizes [1]: how far a tip sways, over the reach, and how far the whole robot bends [rad].
_SWAY, _BEND = 0.05, 2.0

#: Least scale of tendon lengths, over the robot's: that of tendons which no bend pulls in.
_SHORTEST = 1e-3

Read = Callable[[], ndarray]


def speed_limit(robot: RobotParams) -> float:
    """Speed [m/s] of the tip beyond which an episode fails.

    Bending waves whose strains fold the material move it about as fast as sound, sqrt(E / rho), in
    the section where it is fastest.
    Full tensions along the length, and the fall over twice the reach, add their energy.
    """
    pull = sum(tendon.tension_limit for tendon in robot.tendons) * robot.length / robot.mass
    fall = float(np.linalg.norm(robot.gravity)) * 2 * robot.reach
    sound = max(part.youngs_modulus / part.density for part in robot.backbone.sections)
    return SPEED_ROOM * sqrt(sound + 2 * (pull + fall))


def curvature_rate_limit(robot: RobotParams, speed: float) -> float:
    """Rate [1/(m s)] of curvature beyond which an episode fails.

    That of a wave of as much curvature as the robot takes, as long as its radius, at the limit of
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
        axes: Coordinates out of x, y and z that positions have, a slice of (3,).
        n_preview: Number of preview times.
        n_inputs: Number of actions.
        pulled: Largest length [m] that servos pull in, where they drive the tendons.
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
    """Functions of a plant that return new arrays, of one robot (size,) or of n (n, size)."""

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
        measured: What is measured of the plant.
        reference: Function from the name of a column of `reference.ReferenceTable` to a function
            that returns its row at this control instant.
        action: Function that returns the action in force.
    """

    measured: Measured
    reference: Callable[[str], Read]
    action: Read


@dataclass(frozen=True)
class Observable:
    """A quantity.

    Attributes:
        unit: In SI.
        space: Its box, bounds included.
        read: Where it comes from.
        scale: Its usual size about the middle of the box, of one robot or of each entry: that of
            wide motions at the first frequency.
        noise: Standard deviation of its sensor's noise of scale 1, new in every control period: a
            policy that looks more often can average more of it.
        usual: Of robots with which drives it is observed unless an environment is asked otherwise.
    """

    unit: str
    space: Callable[[Sizes], spaces.Box]
    read: Callable[[Sources], Read]
    scale: Callable[[Sizes], float | ndarray]
    noise: float = 0.0
    usual: tuple[str, ...] = ()


def known_of(robot: RobotParams) -> tuple[str, ...]:
    """Names of the observables that a robot has: those of parts only if it has these."""
    missing = {"sensors"} if not robot.sensors else set()
    if robot.drive.gain is None:
        missing.add("motor_force")
    if not robot.has_capstan_friction:
        missing.add("anchor_tension")
    return tuple(name for name in OBSERVABLES if name not in missing)


def usual_of(robot: RobotParams) -> tuple[str, ...]:
    """Names of the observables of an environment that is not asked for others."""
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
    """Up to what friction lets a tendon hold that was pulled by the most and then let go."""
    high = s.robot.of_tendons("tension_limit") * np.exp(s.robot.most_exponents)
    return spaces.Box(np.zeros_like(high), high, dtype=np.float64)


def _tendon_length(s: Sizes) -> spaces.Box:
    """Lengths inside the robot, or pulled in where servos drive the tendons."""
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
    """Of tendons, as far as the bend of usual size pulls them in, or half the servos' way."""
    if s.pulled is not None:
        return np.full(len(s.robot.tendons), s.pulled / 2)
    pulled = (t.straight_length * t.farthest * _bend_scale(s) for t in s.robot.tendons)
    return np.maximum(np.fromiter(pulled, float), _SHORTEST * s.robot.length)


_ALWAYS = ("tension", "length")

#: Every observable. Positions have the coordinates that the task names; curvatures are piece by
#: piece, of a spatial robot (beta, gamma) each, and torsion where it twists.
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

#: Those that "all" stands for: the sensors cost time and their noise draws from the environment's
#: generator, and what is registered is for those who ask for it.
EVERY = tuple(name for name in OBSERVABLES.registered() if name != "sensors")


def register_observable(name: str, observable: Observable, replace: bool = False) -> None:
    """Add an observable of simulated robots, or replace one; environments are asked for it by name.

    Its `read` gets measurements with the noise of their own sensors, of one robot (size,) or of
    many (n, size).

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
    """Names of the observables that an environment is asked for.

    Args:
        observe: Their names, or one name. Among them "all" stands for `every`: ("all", "sensors").
        known: Names that the environment has.
        every: Those that "all" stands for, if they are known.

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
    """Dict space of some of a robot's observables; arguments and errors as of `chosen`."""
    boxes = {}
    for name in chosen(observe, known):
        box, room = OBSERVABLES[name].space(sizes), sizes.noise * OBSERVABLES[name].noise
        if room:
            box = spaces.Box(box.low - room, box.high + room, dtype=box.dtype)
        boxes[name] = box
    return spaces.Dict(boxes)


#: The same entries, later ones too: a reset, which knows the names, need ask no plug-in.
_ENTRIES = OBSERVABLES.registered()


def reads(observed: spaces.Dict, sources: Sources) -> list[tuple[str, Read]]:
    """Names of the observables of a space, in its order, and what reads them."""
    return [(name, _ENTRIES[name].read(sources)) for name in observed]


def arrays(observation: Seen) -> list[ndarray]:
    """The arrays that an observation is made of."""
    return list(observation.values()) if isinstance(observation, dict) else [observation]


def each_of(observation: Seen, change: Callable[[ndarray], ndarray]) -> Seen:
    """An observation of changed arrays, such as copies of them."""
    if isinstance(observation, ndarray):
        return change(observation)
    return {name: change(value) for name, value in observation.items()}


#: Scales of the tracking error in a vector, over the robot's reach: of far away, and of near by.
FAR, NEAR = 0.1, 0.002

#: Scale of how far the reference moves within the preview, over the robot's reach.
_AHEAD = 0.05


class Entries(NamedTuple):
    """Neighbours in a vector: asinh((`name` less `origin`) / scale).

    Attributes:
        label: What the entries are called.
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

    Every entry is asinh(x / scale) of an x in SI units: like x / scale up to 1, like its logarithm
    beyond, so that nothing is cut off and all bounds are small. Scales are the robot's own
    (`Observable.scale`). Where the tip is observed too, the reference is its error, once over
    `FAR` and once over `NEAR`; the preview is what lies ahead of the reference.

    Attributes:
        space: Box (k,) of float32, with the bounds of the observables.
        layout: Slices of the vector by name.
        reading: What makes the vector of an observation.
    """

    def __init__(self, observed: Mapping[str, spaces.Box], parts: list[Entries]) -> None:
        """A view of observations in a space, one part of the vector behind the other."""
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
        # Rounding may not bring a vector out of its space.
        return spaces.Box(
            np.nextafter(least, -np.float32(np.inf)), np.nextafter(most, np.float32(np.inf))
        )

    def __call__(self, observation: Mapping[str, ndarray]) -> ndarray:
        """Vectors (..., k) of observations (..., size)."""
        return self._read(observation, self.reading)

    def on(self, arrays: HostArrays) -> Callable[[Mapping[str, ndarray]], ndarray]:
        """The same for observations that are `arrays`."""
        reading = self.reading.on(arrays)
        return lambda observation: self._read(observation, reading)

    def _read(self, observation: Mapping[str, ndarray], reading: Reading) -> ndarray:
        parts = [observation[name] for name in self._names]
        kind = namespace(parts[0])
        return kind.asarray(reading(kind.concatenate(parts, axis=-1)), dtype=kind.float32)


def _slices(sizes: Mapping[str, int]) -> dict[str, slice]:
    """Where parts of these sizes lie, one behind the other."""
    ends = np.cumsum(list(sizes.values())).tolist()
    return {
        name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)
    }


def entries(observed: spaces.Dict, sizes: Sizes) -> list[Entries]:
    """What a vector holds of the observables of a robot's space."""
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
