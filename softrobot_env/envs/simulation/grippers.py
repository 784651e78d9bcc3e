"""Many simulations of a gripper, each with its own bar and fingers, and their observations.

Observables are those of the fingers in turn, and contacts.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import pi
from typing import TYPE_CHECKING

import numpy as np
from gymnasium import spaces
from numpy import ndarray

from softrobot_env.core.interfaces import Seen
from softrobot_env.robots.parameters import Gripper
from softrobot_env.robots.sensors import Sensor
from softrobot_env.scene import assembly
from softrobot_env.scene.chain import mean_curvature, station_strain
from softrobot_env.scene.contacts import links_of
from softrobot_env.scene.objects import Capsule
from softrobot_env.scene.timestep import TimestepWarning
from softrobot_env.tasks.gripper import GripTask

from ..config import EnvConfig
from ..observations.table import (
    OBSERVABLES,
    Entries,
    Sizes,
    Sources,
    VectorView,
    chosen,
    speed_limit,
    symmetric,
)
from ..reference import PLANE
from .batch import Batch

if TYPE_CHECKING:  # compiled code takes time to load
    from softrobot_env.sensing.array import SensorArray

#: Name of the bar among objects.
BAR = "bar"

#: Its axis lies along y.
_ACROSS = (-pi / 2, 0.0, 0.0)

#: [m], initial height of a free bar above its seat.
_GAP = 1e-4


def bar(gripper: Gripper, task: GripTask, diameter: float, **look: tuple[float, ...]) -> Capsule:
    """The bar of a task, where it lies between straight fingers."""
    return Capsule(
        name=BAR,
        radius=diameter / 2,
        length=task.length,
        turn=_ACROSS,
        mass=float(np.mean(task.mass)) if task.free else None,
        position=(0.0, 0.0, gripper.seat(diameter / 2) + _GAP * task.free),
        **look,
    )


class GripperBatch(Batch):
    """Simulations of a gripper.

    The stiffness of contact pairs is that for the bar of mean mass.

    Attributes:
        gripper, task: The gripper and its task.
        bends: (nq, pieces) [1/m], from hinge angles to mean curvatures of all fingers' pieces.
    """

    def __init__(
        self,
        gripper: Gripper,
        task: GripTask,
        config: EnvConfig,
        fineness: assembly.Resolution,
    ) -> None:
        """Build the simulations.

        Args:
            gripper, task: The gripper and its task.
            config: Number, threads, observables, and pieces and timestep if not those of the
                fineness.
            fineness: Resolution of the model.
        """
        self.gripper, self.task = gripper, task
        nominal = bar(gripper, task, float(np.mean(task.diameter)))
        scene = assembly.gripper_scene(
            gripper,
            (nominal,),
            contacts=fineness.contacts,
            control_period=config.control_period,
            pieces=config.pieces or fineness.pieces_of(gripper),
            timestep=config.timestep,
            felt_along=SENSORS in seen_by(config),
        )
        built = assembly.build_assembly(scene)
        if config.timestep is None and fineness.longer > 1:
            longer = fineness.longer * built.timestep.timestep
            with warnings.catch_warnings():  # about the requested timestep
                warnings.simplefilter("ignore", TimestepWarning)
                built = assembly.build_assembly(scene.with_timestep(longer))
        super().__init__(built, config.num_envs, config.threads)
        model, expand = built.model, self._batch.expand
        self._body, self._geom = model.body(BAR).id, model.geom(f"{BAR}_shape").id
        pairs = enumerate(zip(model.pair_geom1, model.pair_geom2, strict=True))
        self._pairs = [k for k, geoms in pairs if self._geom in geoms]
        self._size, self._bound, self._box = map(expand, ("geom_size", "geom_rbound", "geom_aabb"))
        self._mass, self._inertia = expand("body_mass"), expand("body_inertia")
        self._place, self._friction = expand("body_pos"), expand("pair_friction")
        self._springs, self._dampers = expand("jnt_stiffness"), expand("dof_damping")
        self._arms, self.gravity = expand("wrap_prm"), expand("opt.gravity")
        self._forces = self._batch.bind("xfrc_applied")
        self._measure()

    def _measure(self) -> None:
        scene, parts = self.scene, self.scene.parts.values()
        rows = []
        for part in parts:
            own = mean_curvature(
                part.scene.model, part.scene.layout, part.scene.config.robot.pieces
            )
            row = np.zeros((len(own), scene.model.nq))
            row[:, part.q] = own
            rows.append(row)
        self.bends = np.concatenate(rows).T
        places = [scene.model.sensor(f"{name}/{assembly.FELT}").adr[0] for name in scene.parts]
        self._felt = np.array(places)[:, None] + np.arange(3)
        self._links = [links_of(scene.model, part.member.prefix) for part in parts]
        self._pressed: dict[int, ndarray] = {}

    @property
    def curvature(self) -> ndarray:
        """(n, pieces) [1/m], means over the pieces of all fingers in turn."""
        return self.qpos @ self.bends

    @property
    def felt(self) -> ndarray:
        """(n, fingers, 3) [N], force of each finger on the bar."""
        return self.sensordata[:, self._felt]

    def pressed(self, finger: int) -> ndarray:
        """(n, links, 3) [N], force of each link of a finger on the bar.

        Raises:
            KeyError: The scene was not built with `felt_along`.
        """
        if finger not in self._pressed:
            first = [
                self.scene.model.sensor(assembly.felt_by(geom)).adr[0]
                for geom in self._links[finger]
            ]
            self._pressed[finger] = np.array(first)[:, None] + np.arange(3)
        return self.sensordata[:, self._pressed[finger]]

    def links(self, finger: int) -> ndarray:
        """(links, 2) [m], arc lengths at the ends of each link of a finger."""
        return np.array(list(self._links[finger].values()))

    @property
    def place(self) -> ndarray:
        """Position (n, 3) [m] of the bar."""
        if self.task.free:
            return self.qpos[:, -7:-4].copy()
        return self._place[:, self._body].copy()

    def start(self, which: ndarray, sampled: dict[str, ndarray]) -> None:
        """Start simulations `which` (k,), with straight fingers and sampled values.

        Args:
            which: (k,) int, increasing.
            sampled: By names from `tasks.gripper.SAMPLED`, (k,) or per finger (k, fingers).
        """
        radius = sampled["diameter"] / 2
        self._shape(which, radius, sampled["mass"])
        for pair in self._pairs:
            self._friction[which, pair, :2] = sampled["friction"][:, None]
        self._make_fingers(which, sampled["modulus"], sampled["arm"])
        heights = np.array([self.gripper.seat(r) + _GAP * self.task.free for r in radius])
        q = np.tile(self.scene.model.qpos0, (len(which), 1))
        if self.task.free:
            q[:, -5] = heights
        self._place[which, self._body, 2] = heights
        self._batch.set_const(which)
        self.reset(which, q, np.zeros((len(which), self.scene.model.nu)))

    def _shape(self, which: ndarray, radius: ndarray, mass: ndarray) -> None:
        half, geom = self.task.length / 2, self._geom
        self._size[which, geom, 0] = radius
        self._bound[which, geom] = radius + half
        self._box[which, geom, 3:5] = radius[:, None]
        self._box[which, geom, 5] = radius + half
        if self.task.free:
            self._mass[which, self._body] = mass
            self._inertia[which, self._body] = _inertia(mass, radius, 2 * half)

    def _make_fingers(self, which: ndarray, modulus: ndarray, arm: ndarray) -> None:
        model, tendon = self.scene.model, 0
        for k, part in enumerate(self.scene.parts.values()):
            joints = model.dof_jntid[part.v]
            stiff = modulus[:, k, None]
            self._springs[np.ix_(which, joints)] = model.jnt_stiffness[joints] * stiff
            self._dampers[which, part.v] = model.dof_damping[part.v] * stiff
            count = len(part.scene.config.robot.tendons)
            ends = model.tendon_adr[tendon] + np.append(
                0, model.tendon_num[tendon:][:count].cumsum()
            )
            wraps = slice(ends[0], ends[-1])
            self._arms[which, wraps] = model.wrap_prm[wraps] * arm[:, k, None]
            tendon += count

    def push(self, forces: ndarray, accelerations: ndarray) -> None:
        """Pull the bars with forces (n, 3) [N], and accelerate the palms by (n, 3) [m/s2].

        In the frame of an accelerated palm, everything feels the opposite acceleration, from the
        second timestep of the next period on: the first still uses the previous gravity.
        """
        self._forces[:, 6 * self._body : 6 * self._body + 3] = forces
        self.gravity[:] = np.array(self.gripper.gravity) - accelerations


def _inertia(mass: ndarray, radius: ndarray, length: float) -> ndarray:
    """(k, 3) [kg m2] of uniform capsules: a cylinder, and half a ball on each end."""
    ball = mass * (4 / 3 * radius) / (length + 4 / 3 * radius)
    rod = mass - ball
    along = rod * radius**2 / 2 + ball * 2 / 5 * radius**2
    across = rod * (radius**2 / 4 + length**2 / 12)
    across += ball * (2 / 5 * radius**2 + length**2 / 4 + 3 / 8 * length * radius)
    return np.stack([across, across, along], axis=1)


# ---------------------------------------------------------------- observations

#: Observables of `table.OBSERVABLES` for fingers, and those only grippers have.
SENSORS = "sensors"
CONTACT, ACTION = "contact", "previous_action"
KNOWN = ("curvature", "curvature_rate", "tendon_tension", SENSORS, CONTACT, ACTION)

#: [N], bound of the force of a finger on the bar, and its typical size.
_MOST, _USUAL = 1e3, 2.0


@dataclass(frozen=True)
class _Finger:
    """Measurements (n, size) of one finger of n grippers, like `table.Measured`."""

    batch: GripperBatch
    part: assembly.Part
    bends: ndarray
    sensors: Callable[[], ndarray] | None

    def curvature(self) -> ndarray:
        return self.batch.qpos[:, self.part.q] @ self.bends

    def curvature_rate(self) -> ndarray:
        return self.batch.qvel[:, self.part.v] @ self.bends

    def tendon_tension(self) -> ndarray:
        return self.batch.actuator_force[:, self.part.u].copy()


class GripperView:
    """Observations of n grippers.

    Attributes:
        space: Of one gripper's observation, a dict of float64 or one float32 vector.
        layout: Slices of the vector by name; None for a dict.
    """

    def __init__(
        self,
        batch: GripperBatch,
        config: EnvConfig,
        action: Callable[[], ndarray],
        sensors: "FingerSensors | None" = None,
    ) -> None:
        """Build a view.

        Args:
            batch: The observed grippers.
            config: Names from `KNOWN`, or "all": all except `sensors`, which cost time; and whether
                an observation is one vector.
            action: Function that returns the current actions, (n, inputs).
            sensors: Of the fingers, if they are observed.

        Raises:
            ValueError: No name, an unknown name or a repeated one.
        """
        self._reads, boxes, entries = {}, {}, []
        for name in seen_by(config):
            self._reads[name], boxes[name], scale = _observable(name, batch, action, sensors)
            entries.append(Entries(name, name, 0.0, scale))
        self.space, self.layout, self._view = spaces.Dict(boxes), None, None
        if config.is_for_learning:
            self._view = view = VectorView(boxes, entries)
            self.space, self.layout = view.space, view.layout

    def __call__(self) -> Seen:
        """New observations, stacked."""
        seen = {name: read() for name, read in self._reads.items()}
        return seen if self._view is None else self._view(seen)


def seen_by(config: EnvConfig) -> tuple[str, ...]:
    """Names of the requested observables; ValueError for bad ones."""
    return chosen(config.observe, KNOWN, [name for name in KNOWN if name != SENSORS])


def _observable(
    name: str, batch: GripperBatch, action: Callable[[], ndarray], sensors: "FingerSensors | None"
) -> tuple[Callable[[], ndarray], spaces.Box, ndarray]:
    """Function that reads an observable, its box and its typical sizes."""
    parts = batch.scene.parts.values()
    if name == CONTACT:
        most = np.full(len(parts), _MOST)
        box = spaces.Box(np.zeros_like(most), most, dtype=np.float64)
        return lambda: np.linalg.norm(batch.felt, axis=-1), box, np.full(len(parts), _USUAL)
    if name == ACTION:
        return action, symmetric(batch.scene.n_inputs, 1.0), np.full(batch.scene.n_inputs, 0.5)
    observable, first = OBSERVABLES[name], 0
    reads, low, high, scale = [], [], [], []
    for k, part in enumerate(parts):
        robot = part.scene.config.robot
        bends = batch.bends[part.q, first : first + robot.pieces]
        first += robot.pieces
        read = None if sensors is None else partial(sensors.reading, k)
        finger = _Finger(batch, part, bends, read)
        reads.append(observable.read(Sources(finger, None, action)))  # grippers have no reference
        sizes = Sizes(robot, part.scene.layout, robot.pieces, speed_limit(robot), 1, PLANE)
        box = observable.space(sizes)
        low.append(box.low)
        high.append(box.high)
        scale.append(np.broadcast_to(observable.scale(sizes), box.shape))
    ends = map(np.concatenate, (low, high))
    return (
        lambda: np.concatenate([read() for read in reads], axis=1),
        spaces.Box(*ends, dtype=np.float64),
        np.concatenate(scale),
    )


#: Distance between the seeds of noise and specimens of a gripper's fingers.
_APART = 1_000_003


@dataclass(frozen=True)
class _Kind:
    """Identical fingers, whose sensors are read together.

    Attributes:
        array: Sensors of all of them, gripper by gripper.
        fingers: Their indices.
    """

    array: "SensorArray"
    fingers: tuple[int, ...]


class FingerSensors:
    """Readings of the sensors of all fingers, including the effect of the bar's force on each."""

    def __init__(self, batch: GripperBatch, control_period: float) -> None:
        """Sensors that have not been started.

        Raises:
            ValueError: A finger carries no sensors.
        """
        from softrobot_env.sensing.array import SensorArray

        self._batch, self._parts = batch, list(batch.scene.parts.values())
        alike: dict[tuple, list[int]] = {}
        for k, part in enumerate(self._parts):
            robot, weights = part.scene.config.robot, part.scene.layout.weights
            if not robot.sensors:
                raise ValueError(f"finger {part.member.name!r} carries no sensors to observe")
            if part.scene.model.nq != part.scene.model.nv:
                raise ValueError(f"finger {part.member.name!r} twists: its sensors are not read")
            alike.setdefault((robot.sensors, tuple(weights.tolist())), []).append(k)
        # Strains of hinges are linear in the angles.
        self._strains = [
            station_strain(part.scene.model, part.scene.layout, np.eye(part.scene.model.nq))
            for part in self._parts
        ]
        self._shares = [
            shares(batch.links(k), part.scene.config.robot.sensors)
            for k, part in enumerate(self._parts)
        ]
        self._kinds = []
        for (sensors, weights), fingers in alike.items():
            edges = np.concatenate([[0.0], np.cumsum(weights)])
            array = SensorArray(sensors, edges, control_period, batch.count * len(fingers))
            self._kinds.append(_Kind(array, tuple(fingers)))

    def reading(self, finger: int) -> ndarray:
        """(n, size), see `robots.sensors.Sensor`."""
        kind = next(kind for kind in self._kinds if finger in kind.fingers)
        return kind.array.reading[kind.fingers.index(finger) :: len(kind.fingers)].copy()

    def start(self, which: ndarray, scale: ndarray, specimen: ndarray, seeds: ndarray) -> None:
        """Start grippers `which` (k,).

        Args:
            which: Their indices.
            scale: (k,) of the usual imperfections.
            specimen: (k,) int, seeds of the differences of their sensors.
            seeds: (k,) int, of noise.
        """
        for kind in self._kinds:
            shape, rows = self._shape(kind)[0], _rows(which, kind)
            built, noise = [], []
            for errors, number, seed in zip(scale, specimen, seeds, strict=True):
                for k in kind.fingers:
                    sensors = self._parts[k].scene.config.robot.sensors
                    own = int(number) + _APART * k
                    built.append([s.with_imperfections(float(errors), own) for s in sensors])
                    noise.append(int(seed) + _APART * k)
            kind.array.start(rows, built, noise, shape[rows])

    def look(self, which: ndarray | None = None) -> None:
        """Advance to the next control instant, all grippers or `which` (k,)."""
        for kind in self._kinds:
            shape, touch = self._shape(kind)
            kind.array.look(shape, None if which is None else _rows(which, kind), touch)

    def _shape(self, kind: _Kind) -> tuple[ndarray, ndarray]:
        """Shapes (n, cells, 3) [1/m] of its fingers, and contact forces (n, sensors) [N]."""
        shapes, touches = [], []
        for k in kind.fingers:
            posture = self._parts[k].posture(self._batch.qpos)
            shapes.append(np.tensordot(posture, self._strains[k], 1))
            touches.append(np.sqrt((self._batch.pressed(k) ** 2).sum(axis=2)) @ self._shares[k])
        return tuple(
            np.stack(each, axis=1).reshape(-1, *each[0].shape[1:]) for each in (shapes, touches)
        )


def shares(links: ndarray, sensors: Sequence[Sensor]) -> ndarray:
    """Shares (links, sensors) of links, between arc lengths (links, 2) [m], on sensors."""
    low, high = links.T[..., None]
    ends = np.array([(sensor.begin, sensor.end) for sensor in sensors]).T
    both = np.minimum(high, ends[1]) - np.maximum(low, ends[0])
    return np.clip(both, 0.0, None) / (high - low)


def _rows(which: ndarray, kind: _Kind) -> ndarray:
    count = len(kind.fingers)
    return (which[:, None] * count + np.arange(count)).ravel()
