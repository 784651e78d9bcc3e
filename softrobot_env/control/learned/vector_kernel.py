"""The decision of a network as machine code: features, layers, limits and status in one."""

from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, structure
from softrobot_env.learned.inference import forward

from ..base import FINE, NOT_COMPUTED, NOT_FINITE, SATURATED, UNREACHABLE
from ..limits import finite


@structure
class NetworkLaw(NamedTuple):
    """A network, with the encoding of its observations and actions.

    Attributes:
        width: Number of observed entries.
        before, target: Indices at which the current action and the reference begin among them.
        base: (d,) [m], where the robot is clamped, in the reference's coordinates; empty if
            references are not checked against the reach.
        reach: [m], largest distance of a reference from the base.
        encoding: Its `neural.Encoding`.
        parameters, sizes: Of the network, see `learned.inference.parameters_of`.
    """

    width: int
    before: int
    target: int
    base: ndarray
    reach: float
    encoding: Any
    parameters: ndarray
    sizes: ndarray


@kernel
def _features(of: Any, observed: ndarray, out: ndarray) -> None:
    """Write the features (k,) of observables (size,) in SI units, by the network's `Encoding`."""
    for i in range(len(out)):
        value = observed[of.take[i]]
        if of.less[i] >= 0:
            value -= observed[of.less[i]]
        value = (value - of.origin[i]) / of.scale[i]
        if of.gain[i] > 0:
            value = of.gain[i] * np.arcsinh(value)
        out[i] = np.float32(min(max(value, -of.largest), of.largest))


@kernel
def _decide(
    law: NetworkLaw, observed: ndarray, seen: ndarray, given: ndarray, action: ndarray
) -> int:
    """Write the action (m,) for finite observables; `seen` and `given` are work arrays."""
    encoding = law.encoding
    _features(encoding, observed, seen)
    forward(seen, law.parameters, law.sizes, given)
    code, total = FINE, 0.0
    for i in range(len(action)):
        wanted = min(max(given[i], -1.0), 1.0)
        if encoding.steepness > 0:
            wanted = np.sinh(encoding.steepness * wanted)
        if encoding.change > 0:
            wanted = min(max(observed[law.before + i], -1.0), 1.0) + encoding.change * wanted
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
    """Write actions and status codes for observables, see `memoryless.Decide`."""
    width, m = law.width, law.sizes[-1]
    seen, given = np.empty(law.sizes[0]), np.empty(m)
    for k in range(len(codes)):
        row, codes[k] = observed[k * width : (k + 1) * width], NOT_FINITE
        if finite(row):
            codes[k] = _decide(law, row, seen, given, actions[k * m : (k + 1) * m])
