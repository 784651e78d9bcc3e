"""An observation as one vector of order 1, as learning libraries expect it."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from gymnasium import spaces

from softrobot_env.core.arrays import HostArrays, namespace
from softrobot_env.core.vector_reading import Reading
from softrobot_env.envs.observations.table import OBSERVABLES, Sizes

#: Scales of the tracking error in a vector, over the robot's reach: of far away, and of near by.
FAR, NEAR = 0.1, 0.002

#: Scale of how far the reference moves within the preview, over the robot's reach.
_AHEAD = 0.05


class _Entries(NamedTuple):
    """Neighbours in a vector: asinh((`name` less `origin`) / scale).

    Attributes:
        label: What the entries are called.
        name: The observable.
        origin: Another observable, or numbers in its unit.
        scale: In its unit.
    """

    label: str
    name: str
    origin: str | np.ndarray
    scale: float | np.ndarray


class VectorView:
    """Reads an observation, a dict in SI units, as one float32 vector.

    Every entry is asinh(x / scale) of an x in SI units: like x / scale up to 1, like its logarithm
    beyond, so that nothing is cut off and all bounds are small. Scales are the robot's own
    (`table.Observable.scale`). Where the tip is observed too, the reference is its error, once over
    `FAR` and once over `NEAR`; the preview is what lies ahead of the reference.

    Attributes:
        space: Box (k,) of float32, with the bounds of the observables.
        layout: Slices of the vector by name.
        reading: What makes the vector of an observation.
    """

    def __init__(self, observed: spaces.Dict, sizes: Sizes) -> None:
        """A view of observations in a space, of a robot of these sizes."""
        self._names = tuple(observed)
        where = _slices({name: box.shape[0] for name, box in observed.items()})
        parts = _entries(observed, sizes)
        self.layout = _slices({part.label: observed[part.name].shape[0] for part in parts})
        places = {name: np.arange(own.start, own.stop) for name, own in where.items()}
        take = np.concatenate([places[part.name] for part in parts])
        origin, scale = np.zeros((2, len(take)))
        relative, less = np.zeros((2, 0), dtype=int)
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

    def _bounds(self, observed: spaces.Dict) -> spaces.Box:
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

    def __call__(self, observation: Mapping[str, np.ndarray]) -> np.ndarray:
        """Vectors (..., k) of observations (..., size)."""
        return self._read(observation, self.reading)

    def on(self, arrays: HostArrays) -> Callable[[Mapping[str, np.ndarray]], np.ndarray]:
        """The same for observations that are `arrays`."""
        reading = self.reading.on(arrays)
        return lambda observation: self._read(observation, reading)

    def _read(self, observation: Mapping[str, np.ndarray], reading: Reading) -> np.ndarray:
        parts = [observation[name] for name in self._names]
        kind = namespace(parts[0])
        return kind.asarray(reading(kind.concatenate(parts, axis=-1)), dtype=kind.float32)


def _slices(sizes: Mapping[str, int]) -> dict[str, slice]:
    """Where parts of these sizes lie, one behind the other."""
    ends = np.cumsum(list(sizes.values())).tolist()
    return {
        name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)
    }


def _entries(observed: spaces.Dict, sizes: Sizes) -> list[_Entries]:
    """What a vector holds of the observables of a space."""
    reach, parts = sizes.robot.reach, []
    for name, box in observed.items():
        middle, scale = (box.low + box.high) / 2, OBSERVABLES[name].scale(sizes)
        own = _Entries(name, name, middle, scale)
        if name == "reference" and "tip_position" in observed.spaces:
            far = _Entries("tracking_error", name, "tip_position", FAR * reach)
            parts += [far, far._replace(label="tracking_error_near", scale=NEAR * reach)]
        elif name == "reference_preview" and "reference" in observed.spaces:
            parts.append(own._replace(origin="reference", scale=_AHEAD * reach))
        else:
            parts.append(own)
    return parts
