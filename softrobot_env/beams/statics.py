"""Static equilibrium of any beam model, found along `softrobot_env.core.continuation`."""

from typing import TYPE_CHECKING

import numpy as np

from softrobot_env.beams.mechanics import bandwidth, residual
from softrobot_env.beams.numerics import band
from softrobot_env.beams.numerics.linearization import stiffness_band
from softrobot_env.core.continuation import Newton

if TYPE_CHECKING:
    from softrobot_env.beams.model import BeamModel

_SHARE = 1e-2  # step of the difference by the loads' share, which most forces are linear in


class LoadedModel:
    """A model under a share of its inputs, gravity and pretension."""

    def __init__(self, model: "BeamModel", u: np.ndarray) -> None:
        data, actuation = model.data, model.data.actuation
        self._whole = (data.gravity, actuation.pretension, u)
        self._part = tuple(x.copy() for x in self._whole)
        gravity, pretension, _ = self._part
        actuation = actuation._replace(pretension=pretension)
        self._data = model.static_data(data._replace(gravity=gravity, actuation=actuation))
        self._zero, self.scale, self.moved = np.zeros(model.n), data.scale, model.moved
        width = bandwidth(self._data)
        self._width, self._matrix = width, np.empty((model.n, 3 * width + 1))
        self._pivot = np.empty(model.n, dtype=np.int64)

    def _residual(self, q: np.ndarray, share: float) -> np.ndarray:
        for part, whole in zip(self._part, self._whole, strict=True):
            np.multiply(share, whole, out=part)
        out = np.empty_like(q)
        residual(self._data, q, self._zero, self._zero, self._part[2], out)
        return out

    def stiffness(self, q: np.ndarray) -> np.ndarray:
        """Derivative (n, n) of the forces that rest takes by q (n,), under full loads."""
        self._residual(q, 1.0)
        stiffness_band(self._data, q, self._part[2], self._matrix)
        dense = np.zeros((len(q), len(q)))
        for off in range(-self._width, self._width + 1):
            rows = np.arange(max(0, -off), min(len(q), len(q) - off))
            dense[rows, rows + off] = self._matrix[rows, off + self._width]
        return dense

    def newton(self, q: np.ndarray, share: float) -> Newton | None:
        """Newton's changes at q (n,), None where the stiffness is singular or not finite."""
        ahead = self._residual(q, share + _SHARE)
        missing = self._residual(q, share)
        stiffness_band(self._data, q, self._part[2], self._matrix)
        if not band.factor(self._matrix, self._width, self._pivot):
            return None
        found = Newton(-missing, (missing - ahead) / _SHARE)
        for x in found:
            band.solve(self._matrix, self._width, self._pivot, x)
        return found if all(np.all(np.isfinite(x)) for x in found) else None

    def again(self, q: np.ndarray, share: float) -> np.ndarray:
        """The change (n,) to balance the forces at q (n,), by the last factors."""
        change = -self._residual(q, share)
        band.solve(self._matrix, self._width, self._pivot, change)
        return change
