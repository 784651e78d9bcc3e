"""The decision of a network that reads a vector as machine code."""

from typing import NamedTuple

import numpy as np

from softrobot_env.beams.numerics.compilation import kernel, structure
from softrobot_env.control.base import FINE, NOT_COMPUTED, NOT_FINITE, SATURATED
from softrobot_env.control.limits import finite
from softrobot_env.learned.inference import forward


@structure
class VectorLaw(NamedTuple):
    """A network, and what lies between it and observations and actions; see `vector_network`.

    Attributes:
        width: Number of all entries that are observed.
        before: Where the inputs in force begin among them.
        take, origin, scale: See `Reading`.
        less: (k,), entry that is taken off, -1 where there is none.
        change: See `Reading`.
        parameters, sizes: Of the network, see `learned.inference.parameters_of`.
    """

    width: int
    before: int
    take: np.ndarray
    less: np.ndarray
    origin: np.ndarray
    scale: np.ndarray
    change: float
    parameters: np.ndarray
    sizes: np.ndarray


@kernel
def _decide(
    law: VectorLaw, observed: np.ndarray, seen: np.ndarray, given: np.ndarray, action: np.ndarray
) -> int:
    """Write the action (m,) for finite observables; `seen` and `given` are the network's ends."""
    for i in range(len(seen)):
        value = observed[law.take[i]]
        if law.less[i] >= 0:
            value -= observed[law.less[i]]
        seen[i] = np.float32(np.arcsinh((value - law.origin[i]) / law.scale[i]))
    forward(seen, law.parameters, law.sizes, given)
    code, total = FINE, 0.0
    for i in range(len(action)):
        wanted = min(max(given[i], -1.0), 1.0)
        if law.change > 0:
            wanted = min(max(observed[law.before + i], -1.0), 1.0) + law.change * wanted
            if abs(wanted) > 1.0:
                code = SATURATED
        action[i] = min(max(wanted, -1.0), 1.0)
        total += given[i]
    return code if np.isfinite(total) else NOT_COMPUTED


@kernel
def decide(law: VectorLaw, observed: np.ndarray, actions: np.ndarray, codes: np.ndarray) -> None:
    """Write actions and codes of `status`, for observables, see `memoryless.Decide`."""
    width, m = law.width, law.sizes[-1]
    seen, given = np.empty(law.sizes[0]), np.empty(m)
    for k in range(len(codes)):
        row, codes[k] = observed[k * width : (k + 1) * width], NOT_FINITE
        if finite(row):
            codes[k] = _decide(law, row, seen, given, actions[k * m : (k + 1) * m])
