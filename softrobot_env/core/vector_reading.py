"""How an observation is read as one vector of order 1, by arrays that a file can hold."""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy import ndarray

from .arrays import HostArrays, namespace
from .artifacts import Arrays

_READING, _RAW = "vector_", "sensors"


@dataclass(frozen=True)
class Reading:
    """asinh((x - origin) / scale) of entries x of an observation, some less another entry.

    Attributes:
        names: Observables, one behind the other.
        sizes: Their numbers of entries.
        take: (k,), which of all these entries the vector has.
        origin, scale: (k,), in the unit of each.
        relative: Entries of the vector that are differences.
        less: Of each of these, the entry of the observables that is taken off.
        period: [s] between two decisions.
        preview: [s], times ahead at which the reference is seen.
        change: [1], by which an action of 1 changes the input in force; 0 where actions are inputs.
    """

    names: ndarray
    sizes: ndarray
    take: ndarray
    origin: ndarray
    scale: ndarray
    relative: ndarray
    less: ndarray
    period: float = 0.0
    preview: ndarray | tuple[float, ...] = ()
    change: float = 0.0

    def __call__(self, flat: ndarray, less: ndarray | None = None) -> ndarray:
        """Vectors (..., k) of observables (..., size), differences to those of `less` if given."""
        picked = flat[..., self.take]
        if len(self.less):
            picked[..., self.relative] -= (flat if less is None else less)[..., self.less]
        return namespace(flat).arcsinh((picked - self.origin) / self.scale)

    def on(self, arrays: HostArrays) -> "Reading":
        """The same for observables that are `arrays`."""
        places = {n: arrays.index(getattr(self, n)) for n in ("take", "relative", "less")}
        values = {n: arrays.real(getattr(self, n)) for n in ("origin", "scale")}
        return replace(self, **places, **values)

    @property
    def environment(self) -> dict[str, Any]:
        """Keyword arguments of the environment that a policy needs."""
        needed = {"control_period": float(self.period), "preview": tuple(map(float, self.preview))}
        # Raw readings are shown only where they are asked for.
        return needed | ({"observe": ("all", _RAW)} if _RAW in self.names else {})

    def about(self) -> dict[str, ndarray]:
        """What the file of a network tells of its reading."""
        return {f"{_READING}{f.name}": np.asarray(getattr(self, f.name)) for f in fields(self)}


def reading_in(about: Arrays) -> Reading | None:
    """The reading that a file tells; None of a network that does not read vectors.

    Raises:
        ValueError: It is incomplete, or its entries lie outside the observables.
    """
    if f"{_READING}names" not in about:
        return None
    reading = Reading(**{f.name: about[f"{_READING}{f.name}"] for f in fields(Reading)})
    rows = "take", "origin", "scale", "relative", "less", "sizes", "preview"
    about.check_shapes(dict.fromkeys(rows, (None,)) | {"period": (), "change": ()}, _READING)
    equal = (
        len(reading.take) == len(reading.origin) == len(reading.scale),
        len(reading.names) == len(reading.sizes),
    )
    places = np.concatenate([reading.take, reading.less])
    inside = len(reading.relative) == len(reading.less) and np.all(
        (places >= 0) & (places < reading.sizes.sum())
    )
    if not (all(equal) and inside and np.all(reading.scale > 0) and reading.period > 0):
        raise ValueError(f"{about.path} tells no vector of its observables")
    return reading
