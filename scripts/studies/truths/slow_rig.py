"""Slow motion of the rig with dry friction of its tendons: something to measure (thesis sec. 3.2).

The rig is one piece of constant curvature, always in equilibrium. The drive pulls tendon k with
T_k = F_pre + c (s_k - s_geo,k), or nothing if it is slack; the tension F_k that acts on the rig
follows it across a gap, the friction R (Prandtl): it stays as it is while |F_k - T_k| < R, and is
dragged along at that distance otherwise.
"""

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel
from softrobot_env.thesis.rig.spatial_piece import RigPiece, add_static, make_rig_piece
from softrobot_env.thesis.rig.three_tendons import elastic_tendons
from softrobot_env.thesis.robots import RIG
from studies.truths.rig_piece import output

_STEP = 0.5e-3  # [m], largest change of a length in one step of the motion
_ITERATIONS = 50  # of Newton's method; three as a rule
_CONVERGED = 1e-11  # [rad]
_DIFFERENCE = 1e-5  # [rad], for the stiffness; its error slows the iteration, no more


#: Piece, and of its `ThreeTendons` arc, pretension and stiffness, and their friction: for kernels.
_Rig = tuple[RigPiece, ndarray, ndarray, ndarray, float]


class RigStatics:
    """The rig, with what has happened to it; call it to measure, as `visits.Measure`."""

    def __init__(self, friction: float = 0.3, noise: float = 0.3e-3, seed: int = 0) -> None:
        """Put the rig straight, with the tendons' pretension.

        Args:
            friction: R [N] of each tendon.
            noise: Standard deviation [m] of the camera on each coordinate.
            seed: Of the noise.
        """
        tendons = elastic_tendons(RIG)
        self._noise, self._rng = noise, np.random.default_rng(seed)
        own = tendons.arc, tendons.pretension, tendons.stiffness
        self._data: _Rig = (make_rig_piece(RIG), *own, float(friction))
        self._lengths, self._y = np.zeros(3), np.zeros(2)
        self._tension = tendons.pretension.copy()

    def __call__(self, lengths: ndarray) -> ndarray:
        """Outputs (n, 2) [m] after lengths (n, 3) [m], each on a straight line from the last one.

        Raises:
            RuntimeError: No equilibrium was found.
        """
        lengths = np.ascontiguousarray(lengths, dtype=float)
        outputs = np.empty((len(lengths), 2))
        done = _visit(self._data, lengths, self._lengths, self._y, self._tension, outputs)
        if done < len(lengths):
            raise RuntimeError(f"no equilibrium on the way to lengths {lengths[done]} m")
        return outputs + self._noise * self._rng.standard_normal(outputs.shape)


@kernel
def _visit(
    rig: _Rig, lengths: ndarray, now: ndarray, y: ndarray, tension: ndarray, outputs: ndarray
) -> int:
    """Set outputs (n, 2) and the state now (3,), y (2,), tension (3,); number of points reached."""
    point, jacobian = np.empty(3), np.empty((3, 2))
    for i in range(len(lengths)):
        start = now.copy()
        steps = int(np.ceil(np.max(np.abs(lengths[i] - start)) / _STEP))
        for k in range(1, steps + 1):
            now[:] = start + (lengths[i] - start) * (k / steps)
            if not _settle(rig, now, y, tension):
                return i
        output(rig[0], y, point, jacobian)
        outputs[i] = point[:2]
    return len(lengths)


@kernel
def _settle(rig: _Rig, lengths: ndarray, y: ndarray, tension: ndarray) -> bool:
    """Move y (2,) to the equilibrium and drag the tensions (3,) along; whether it was found."""
    inputs, dragged, give = rig[0].inputs, np.empty(3), np.empty(3)
    force, ahead, tangent = np.empty(2), np.empty(2), np.empty((2, 2))
    for _ in range(_ITERATIONS):
        _drag(rig, lengths, y, tension, dragged, give)
        _imbalance(rig, y, dragged, force)
        for j in range(2):
            y[j] += _DIFFERENCE
            _imbalance(rig, y, dragged, ahead)
            y[j] -= _DIFFERENCE
            for i in range(2):
                tangent[i, j] = (ahead[i] - force[i]) / _DIFFERENCE
                for k in range(3):
                    tangent[i, j] += inputs[i, k] * give[k] * inputs[j, k]
        d = tangent[0, 0] * tangent[1, 1] - tangent[0, 1] * tangent[1, 0]
        one = (tangent[1, 1] * force[0] - tangent[0, 1] * force[1]) / d
        two = (tangent[0, 0] * force[1] - tangent[1, 0] * force[0]) / d
        y[0] -= one
        y[1] -= two
        if abs(one) + abs(two) < _CONVERGED:
            tension[:] = dragged
            return True
    return False


@kernel
def _imbalance(rig: _Rig, y: ndarray, tension: ndarray, out: ndarray) -> None:
    """Set out (2,) [N m] to the force that holds y less that of the tensions."""
    for i in range(2):
        out[i] = 0.0
        for k in range(3):
            out[i] -= rig[0].inputs[i, k] * tension[k]
    add_static(rig[0], y, out)


@kernel
def _drag(
    rig: _Rig, lengths: ndarray, y: ndarray, before: ndarray, tension: ndarray, give: ndarray
) -> None:
    """Set the tensions (3,) [N] on the rig and by what stiffness (3,) [N/m] they follow it."""
    piece, arc, pretension, stiffness, friction = rig
    for k in range(3):
        short = (arc[k, 0] * y[1] - arc[k, 1] * y[0]) / piece.length
        pull = pretension[k] + stiffness[k] * (lengths[k] - short)
        pull = max(pull, 0.0)
        tension[k] = max(min(before[k], pull + friction), pull - friction, 0.0)
        moved = tension[k] != before[k] and pull > 0
        give[k] = stiffness[k] if moved else 0.0
