"""The decision of a small network as machine code: features, layers, limits and status in one."""

from typing import NamedTuple

import numpy as np

from softrobot_env.beams.numerics.compilation import kernel, structure
from softrobot_env.control.base import FINE, NOT_COMPUTED, NOT_FINITE, SATURATED, UNREACHABLE
from softrobot_env.control.limits import finite
from softrobot_env.learned.inference import forward


@structure
class NeuralLaw(NamedTuple):
    """A network, and what lies between it and observations and actions; see `neural`.

    Attributes:
        ends: Where each observable ends among all: tip, motion (any number of them), reference, its
            velocity, preview, action in force.
        coarse, fine: [m], scales of the error.
        motion: Scale of each entry of the motion, in its unit.
        velocity, ahead: [m/s, m], scales of the reference's velocity, and of the preview.
        action: [1], scale of the action in force.
        largest: [1], feature.
        gain, steepness: [1], the change of an action is gain sinh(steepness output).
        base: (d,) [m], where the robot is clamped, in the tip's coordinates.
        reach: [m], largest distance of a reference from there.
        parameters, sizes: Of the network, see `learned.inference.parameters_of`.
    """

    ends: np.ndarray
    coarse: float
    fine: float
    motion: np.ndarray
    velocity: float
    ahead: float
    action: float
    largest: float
    gain: float
    steepness: float
    base: np.ndarray
    reach: float
    parameters: np.ndarray
    sizes: np.ndarray


@kernel
def _features(law: NeuralLaw, observed: np.ndarray, out: np.ndarray) -> None:
    """Write what the network sees (n,) of observables (size,) in SI units."""
    ends, d = law.ends, law.ends[0]
    at = ends[-5]
    moved, reference, velocity = observed[d:at], observed[at : ends[-4]], observed[ends[-4] :]
    preview, previous = observed[ends[-3] : ends[-2]], observed[ends[-2] :]
    for i in range(d):
        error = reference[i] - observed[i]
        out[i] = error / law.coarse
        out[d + i] = np.arcsinh(error / law.fine) / 2
        out[2 * d + i] = velocity[i] / law.velocity
    at = 3 * d
    for i in range(len(preview)):
        out[at + i] = (preview[i] - reference[i % d]) / law.ahead
    at += len(preview)
    for i in range(len(moved)):
        out[at + i] = moved[i] / law.motion[i]
    at += len(moved)
    for i in range(len(previous)):
        out[at + i] = previous[i] / law.action
    for i in range(len(out)):
        out[i] = np.float32(min(max(out[i], -law.largest), law.largest))


@kernel
def _decide(
    law: NeuralLaw, observed: np.ndarray, seen: np.ndarray, given: np.ndarray, action: np.ndarray
) -> int:
    """Write the action (m,) for finite observables; `seen` and `given` are the network's ends."""
    _features(law, observed, seen)
    forward(seen, law.parameters, law.sizes, given)
    code, total = FINE, 0.0
    previous, reference = observed[law.ends[-2] :], observed[law.ends[-5] : law.ends[-4]]
    for i in range(len(action)):
        output = min(max(given[i], -1.0), 1.0)
        change = law.gain * np.sinh(law.steepness * output)
        wanted = min(max(previous[i], -1.0), 1.0) + change
        action[i] = min(max(wanted, -1.0), 1.0)
        if abs(wanted) > 1.0:
            code = SATURATED
        total += given[i]
    if not np.isfinite(total):
        return NOT_COMPUTED
    square = 0.0
    for i in range(len(reference)):
        square += (reference[i] - law.base[i]) ** 2
    return UNREACHABLE if np.sqrt(square) > law.reach else code


@kernel
def decide(law: NeuralLaw, observed: np.ndarray, actions: np.ndarray, codes: np.ndarray) -> None:
    """Write actions and codes of `status`, for observables, see `memoryless.Decide`."""
    width, m = law.ends[-1], law.sizes[-1]
    seen, given = np.empty(law.sizes[0]), np.empty(m)
    for k in range(len(codes)):
        row, codes[k] = observed[k * width : (k + 1) * width], NOT_FINITE
        if finite(row):
            codes[k] = _decide(law, row, seen, given, actions[k * m : (k + 1) * m])
