"""Sensors of the fingers of n grippers, each as it is built."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softrobot_env.envs.simulation.grippers import GripperBatch
from softrobot_env.robots.sensors import Sensor
from softrobot_env.scene.chain import station_strain
from softrobot_env.sensing.array import SensorArray

#: Noise and specimens of a gripper's fingers have seeds this far apart.
_APART = 1_000_003


@dataclass(frozen=True)
class _Kind:
    """Like fingers, whose sensors are read together.

    Attributes:
        bank: Of all of them, those of a gripper one after the other.
        fingers: Their numbers.
    """

    bank: SensorArray
    fingers: tuple[int, ...]


class FingerSensors:
    """What the sensors of all fingers read, with the force of the bar on each."""

    def __init__(self, batch: GripperBatch, control_period: float) -> None:
        """Sensors that are to be started.

        Raises:
            ValueError: A finger carries none.
        """
        self._batch, self._parts = batch, list(batch.scene.parts.values())
        alike: dict[tuple, list[int]] = {}
        for k, part in enumerate(self._parts):
            robot, weights = part.scene.config.robot, part.scene.layout.weights
            if not robot.sensors:
                raise ValueError(f"finger {part.member.name!r} carries no sensors to observe")
            if part.scene.model.nq != part.scene.model.nv:
                raise ValueError(f"finger {part.member.name!r} twists: its sensors are not read")
            alike.setdefault((robot.sensors, tuple(weights.tolist())), []).append(k)
        # Of hinges, strains are linear in the angles.
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
            bank = SensorArray(sensors, edges, control_period, batch.count * len(fingers))
            self._kinds.append(_Kind(bank, tuple(fingers)))

    def reading(self, finger: int) -> np.ndarray:
        """(n, size), see `robots.sensors.Sensor`."""
        kind = next(kind for kind in self._kinds if finger in kind.fingers)
        return kind.bank.reading[kind.fingers.index(finger) :: len(kind.fingers)].copy()

    def start(
        self, which: np.ndarray, scale: np.ndarray, specimen: np.ndarray, seeds: np.ndarray
    ) -> None:
        """Start grippers `which` (k,).

        Args:
            which: Their numbers.
            scale: (k,) of the usual imperfections.
            specimen: (k,) int, what the differences of their sensors are drawn from.
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
            kind.bank.start(rows, built, noise, shape[rows])

    def look(self, which: np.ndarray | None = None) -> None:
        """Come to the next control instant, all grippers or `which` (k,)."""
        for kind in self._kinds:
            shape, touch = self._shape(kind)
            kind.bank.look(shape, None if which is None else _rows(which, kind), touch)

    def _shape(self, kind: _Kind) -> tuple[np.ndarray, np.ndarray]:
        """Of its fingers shapes (n, cells, 3) [1/m] and contact (n, sensors) [N] on each sensor."""
        shapes, touches = [], []
        for k in kind.fingers:
            posture = self._parts[k].posture(self._batch.qpos)
            shapes.append(np.tensordot(posture, self._strains[k], 1))
            force = self._batch.pressed(k)
            touches.append(np.sqrt((force**2).sum(axis=2)) @ self._shares[k])
        return tuple(
            np.stack(each, axis=1).reshape(-1, *each[0].shape[1:]) for each in (shapes, touches)
        )


def shares(links: np.ndarray, sensors: Sequence[Sensor]) -> np.ndarray:
    """Shares (links, sensors) of links, between arc lengths (links, 2) [m], on sensors."""
    low, high = links.T[..., None]
    ends = np.array([(sensor.begin, sensor.end) for sensor in sensors]).T
    both = np.minimum(high, ends[1]) - np.maximum(low, ends[0])
    return np.clip(both, 0.0, None) / (high - low)


def _rows(which: np.ndarray, kind: _Kind) -> np.ndarray:
    count = len(kind.fingers)
    return (which[:, None] * count + np.arange(count)).ravel()
