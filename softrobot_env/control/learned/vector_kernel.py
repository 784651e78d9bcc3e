"""The decision of a network as machine code: features, layers, limits and status in one."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.beams.numerics.compilation import kernel, structure
from softrobot_env.learned.inference import forward

from ..base import FINE, NOT_COMPUTED, NOT_FINITE, SATURATED, UNREACHABLE
from ..limits import finite


@structure
class NetworkLaw(NamedTuple):
    """A network, and what lies between it and observations and actions; see `neural.Encoding`.

    Attributes:
        width: Number of all entries that are observed.
        before, target: Where the action in force and the reference begin among them.
        base: (d,) [m], where the robot is clamped, in the reference's coordinates; empty where it
            does not matter how far that is.
        reach: [m], largest distance of a reference from there.
        take, less, origin, scale, gain, largest, change, steepness: See `neural.Encoding`.
        parameters, sizes: Of the network, see `learned.inference.parameters_of`.
    """

    width: int
    before: int
    target: int
    base: ndarray
    reach: float
    take: ndarray
    less: ndarray
    origin: ndarray
    scale: ndarray
    gain: ndarray
    largest: float
    change: float
    steepness: float
    parameters: ndarray
    sizes: ndarray


@kernel
def _features(law: NetworkLaw, observed: ndarray, out: ndarray) -> None:
    """Write what the network sees (k,) of observables (size,) in SI units."""
    for i in range(len(out)):
        value = observed[law.take[i]]
        if law.less[i] >= 0:
            value -= observed[law.less[i]]
        value = (value - law.origin[i]) / law.scale[i]
        if law.gain[i] > 0:
            value = law.gain[i] * np.arcsinh(value)
        out[i] = np.float32(min(max(value, -law.largest), law.largest))


@kernel
def _decide(
    law: NetworkLaw, observed: ndarray, seen: ndarray, given: ndarray, action: ndarray
) -> int:
    """Write the action (m,) for finite observables; `seen` and `given` are the network's ends."""
    _features(law, observed, seen)
    forward(seen, law.parameters, law.sizes, given)
    code, total = FINE, 0.0
    for i in range(len(action)):
        wanted = min(max(given[i], -1.0), 1.0)
        if law.steepness > 0:
            wanted = np.sinh(law.steepness * wanted)
        if law.change > 0:
            wanted = min(max(observed[law.before + i], -1.0), 1.0) + law.change * wanted
        action[i] = min(max(wanted, -1.0), 1.0)
        if abs(wanted) > 1.0:
            code = SATURATED
        total += given[i]
    if not np.isfinite(total):
        return NOT_COMPUTED
    square = 0.0
    for i in range(len(law.base)):
        square += (observed[law.target + i] - law.base[i]) ** 2
    return UNREACHABLE if np.sqrt(square) > law.reach else code


@kernel
def decide(law: NetworkLaw, observed: ndarray, actions: ndarray, codes: ndarray) -> None:
    """Write actions and codes of `status`, for observables, see `memoryless.Decide`."""
    width, m = law.width, law.sizes[-1]
    seen, given = np.empty(law.sizes[0]), np.empty(m)
    for k in range(len(codes)):
        row, codes[k] = observed[k * width : (k + 1) * width], NOT_FINITE
        if finite(row):
            codes[k] = _decide(law, row, seen, given, actions[k * m : (k + 1) * m])
