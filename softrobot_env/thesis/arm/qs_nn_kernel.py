"""The decision of the quasi-static network as machine code."""

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel
from softrobot_env.control.base import NOT_COMPUTED, NOT_FINITE
from softrobot_env.control.limits import finite
from softrobot_env.learned.inference import forward


@kernel
def _outside(workspace: ndarray, target: ndarray) -> bool:
    """Whether a place (2,) [m] is none of a workspace (n_sectors, 2) [m]."""
    sectors = len(workspace)
    share = (np.arctan2(target[0], target[1]) + np.pi) / (2 * np.pi)
    nearest, farthest = workspace[min(int(share * sectors), sectors - 1)]
    distance = np.sqrt(target[0] * target[0] + target[1] * target[1])
    return not nearest <= distance <= farthest


@kernel
def _limit(wanted: ndarray, action: ndarray, far: bool) -> int:
    """Write an action (m,) in [-1, 1] and say what `QuasiStaticNetwork.says` has about it."""
    limited, total = False, 0.0
    for j in range(len(wanted)):
        action[j] = min(max(wanted[j], -1.0), 1.0)
        limited |= abs(wanted[j]) > 1.0
        total += wanted[j]
    return limited + 2 * far if np.isfinite(total) else NOT_COMPUTED


@kernel
def decide(
    parameters: ndarray,
    sizes: ndarray,
    workspace: ndarray,
    observed: ndarray,
    actions: ndarray,
    codes: ndarray,
) -> None:
    """Write actions and codes, for observables in the order of the network's inputs.

    Args:
        parameters, sizes: Of the network, see `learned.inference.parameters_of`.
        workspace: (n_sectors, 2) [m], see `learned.quasi_static.workspace`, with the margin.
        observed, actions, codes: See `memoryless.Decide`.
    """
    width, m = sizes[0], sizes[-1]
    wanted = np.empty(m)
    for k in range(len(codes)):
        row, codes[k] = observed[k * width : (k + 1) * width], NOT_FINITE
        if finite(row):
            forward(row, parameters, sizes, wanted)
            far = _outside(workspace, row[2:4])
            codes[k] = _limit(wanted, actions[k * m : (k + 1) * m], far)
