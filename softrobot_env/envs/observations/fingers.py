"""What an agent can observe of a gripper: the observables of its fingers in turn, and contacts."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium import spaces

from softrobot_env.core.interfaces import Seen
from softrobot_env.envs.observations.table import (
    OBSERVABLES,
    Sizes,
    Sources,
    speed_limit,
    symmetric,
)
from softrobot_env.envs.simulation.grippers import GripperBatch
from softrobot_env.scene.assembly import Part

if TYPE_CHECKING:  # compiled code takes time to load
    from softrobot_env.envs.simulation.finger_sensors import FingerSensors

#: Observables of `table.OBSERVABLES` that fingers have, and those of the gripper alone.
SENSORS = "sensors"
OF_FINGERS = ("curvature", "curvature_rate", "tendon_tension", SENSORS)
CONTACT, ACTION = "contact", "previous_action"
KNOWN = (*OF_FINGERS, CONTACT, ACTION)

#: [N], bound of the force of a finger on the bar, and its usual size.
_MOST, _USUAL = 1e3, 2.0


@dataclass(frozen=True)
class _Finger:
    """Measurements (n, size) of one finger of n grippers, as `table.Measured` has them."""

    batch: GripperBatch
    part: Part
    bends: np.ndarray
    sensors: Callable[[], np.ndarray] | None

    def curvature(self) -> np.ndarray:
        return self.batch.qpos[:, self.part.q] @ self.bends

    def curvature_rate(self) -> np.ndarray:
        return self.batch.qvel[:, self.part.v] @ self.bends

    def tendon_tension(self) -> np.ndarray:
        return self.batch.actuator_force[:, self.part.u].copy()


class GripperView:
    """Observations of n grippers.

    Attributes:
        space: Of one gripper's observation, a dict of float64 or one float32 vector.
        layout: Slices of the vector by name; None of a dict.
    """

    def __init__(
        self,
        batch: GripperBatch,
        observe: tuple[str, ...],
        as_vector: bool,
        action: Callable[[], np.ndarray],
        sensors: "FingerSensors | None" = None,
    ) -> None:
        """A view.

        Args:
            batch: What is observed.
            observe: Names out of `KNOWN`, or "all": all but `sensors`, which cost time.
            as_vector: Whether an observation is one vector.
            action: Function that returns the actions in force, (n, inputs).
            sensors: Of the fingers, if they are observed.

        Raises:
            ValueError: No name, an unknown or a repeated one.
        """
        self._reads, boxes, scales = {}, {}, []
        for name in _checked(observe):
            self._reads[name], boxes[name], scale = _observable(name, batch, action, sensors)
            scales.append(scale)
        ends = np.cumsum([0, *(box.shape[0] for box in boxes.values())]).tolist()
        self.layout = None
        if as_vector:
            self.layout = {n: slice(*ends[k : k + 2]) for k, n in enumerate(boxes)}
        self._scale = np.concatenate(scales)
        self.space = spaces.Dict(boxes) if not as_vector else self._vector_space(boxes)

    def _vector_space(self, boxes: dict[str, spaces.Box]) -> spaces.Box:
        low, high = (
            self._vector([getattr(box, end) for box in boxes.values()]) for end in ("low", "high")
        )
        far = np.float32(np.inf)
        return spaces.Box(np.nextafter(low, -far), np.nextafter(high, far))

    def _vector(self, parts: list[np.ndarray]) -> np.ndarray:
        """As `vector.VectorView` has it: asinh(x / scale), of order 1 and never cut off."""
        return np.arcsinh(np.concatenate(parts, axis=-1) / self._scale).astype(np.float32)

    def __call__(self) -> Seen:
        """New observations, stacked."""
        if self.layout is not None:
            return self._vector([read() for read in self._reads.values()])
        return {name: read() for name, read in self._reads.items()}


def observes(observe: Any, name: str) -> bool:
    """Whether an observable is among those that are asked for."""
    return name in _checked(observe)


def _checked(observe: Any) -> tuple[str, ...]:
    if isinstance(observe, str):
        every = tuple(name for name in KNOWN if name != SENSORS)
        observe = every if observe == "all" else (observe,)
    names = tuple(observe) if np.iterable(observe) else ()
    if not names or not set(names) <= set(KNOWN) or len(set(names)) < len(names):
        raise ValueError(f"observe needs distinct names out of {', '.join(KNOWN)}; got {observe!r}")
    return names


def _observable(
    name: str,
    batch: GripperBatch,
    action: Callable[[], np.ndarray],
    sensors: "FingerSensors | None",
) -> tuple[Callable[[], np.ndarray], spaces.Box, np.ndarray]:
    """How an observable is read, its box and its usual sizes."""
    count = len(batch.scene.parts)
    if name == CONTACT:
        box = spaces.Box(np.zeros(count), np.full(count, _MOST), dtype=np.float64)
        return lambda: np.linalg.norm(batch.felt, axis=-1), box, np.full(count, _USUAL)
    if name == ACTION:
        box = symmetric(batch.scene.n_inputs, 1.0)
        return action, box, np.full(batch.scene.n_inputs, 0.5)
    observable, sizes = OBSERVABLES[name], [_sizes(part) for part in batch.scene.parts.values()]
    boxes = [observable.space(s) for s in sizes]
    fingers = _fingers(batch, sensors)
    reads = [observable.read(Sources(f, _no_reference, action)) for f in fingers]
    low, high = (np.concatenate([getattr(box, end) for box in boxes]) for end in ("low", "high"))
    scale = [
        np.broadcast_to(observable.scale(s), b.shape) for s, b in zip(sizes, boxes, strict=True)
    ]
    read = partial(_together, reads)
    return read, spaces.Box(low, high, dtype=np.float64), np.concatenate(scale)


def _together(reads: list[Callable[[], np.ndarray]]) -> np.ndarray:
    return np.concatenate([read() for read in reads], axis=1)


def _no_reference(column: str) -> Callable[[], np.ndarray]:
    raise ValueError(f"a gripper follows no reference, and has no {column}")


def _fingers(batch: GripperBatch, sensors: "FingerSensors | None") -> list[_Finger]:
    first, out = 0, []
    for k, part in enumerate(batch.scene.parts.values()):
        pieces = part.scene.config.robot.pieces
        read = None if sensors is None else partial(sensors.reading, k)
        out.append(_Finger(batch, part, batch.bends[part.q, first : first + pieces], read))
        first += pieces
    return out


def _sizes(part: Part) -> Sizes:
    robot = part.scene.config.robot
    return Sizes(robot, part.scene.layout, robot.pieces, speed_limit(robot), 1, slice(0, 3, 2))
