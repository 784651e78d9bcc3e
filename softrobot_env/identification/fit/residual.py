"""A learned correction of what the physics does not explain: kernel regression near the data.

Its features are the simulated bends of each section, the direction from which they were reached
(the part of the bends that a dead band holds back), and the commands, each in units of its spread
over the data. Far from all rows the kernel, and with it the correction, is zero. Widths and weights
are chosen by cross-validation over contiguous blocks of the training data; "no correction" is one
of the choices. Errors at training rows are meaningless, since they can be made arbitrarily small:
only those of left-out blocks count.
"""

from dataclasses import dataclass
from itertools import product
from math import ceil
from pathlib import Path

import numpy as np
from numpy import ndarray
from numpy.linalg import solve

from softrobot_env.core.artifacts import read_arrays, write_arrays
from softrobot_env.recordings import Recording
from softrobot_env.robots import RobotParams

from .model import Simulated, StaticModel
from .unknowns import FRICTIONS

_WIDTHS = (0.7, 1.0, 1.5, 2.2, 3.2, 5.0)
_NOISES = (0.03, 0.1, 0.3, 1.0)
_MEMORY = (0.0, 1.0, 2.0)  # weight of where the robot came from
_BAND = 0.15  # of the spread of a bend, half width of the dead band
_FOLDS = 4
_MOST = 400  # rows to learn from; what lasts over several rows is in fewer
_FAR = 4.0  # widths from the nearest row, where the correction is zero

#: Name of the file beside an identified robot's.
RESIDUAL_FILE = "residual.npz"


@dataclass(frozen=True)
class Residual:
    """A correction of simulated markers.

    Attributes:
        middle, spread: (f,) of the features.
        parts: Numbers of bends and of commands among the features.
        band: (b,) half widths of the dead bands of the bends [rad].
        memory: Weight of what the bands hold back.
        width: Of the kernel.
        rows: (n, f) features of the data.
        weights: (n, 3 k) [m].
    """

    middle: ndarray
    spread: ndarray
    band: ndarray
    memory: float
    width: float
    rows: ndarray
    weights: ndarray

    def correction(self, bends: ndarray, commands: ndarray, begins: ndarray) -> ndarray:
        """The correction to add to simulated markers, (t, k, 3) [m], along the robot's axes.

        Args:
            bends, commands, begins: See `rows_of`.
        """
        features = self._scaled(_features(bends, commands, begins, self.band))
        out = np.zeros((len(features), self.weights.shape[1]))
        for begin in range(0, len(features), 500):
            part = slice(begin, begin + 500)
            square = _squares(features[part], self.rows) / self.width**2
            near = square.min(axis=1) < _FAR**2
            out[part] = near[:, None] * (np.exp(-square / 2) @ self.weights)
        return out.reshape(len(out), -1, 3)

    def _scaled(self, raw: ndarray) -> ndarray:
        scaled = (raw - self.middle) / self.spread
        held = len(self.band)
        scaled[:, held : 2 * held] *= self.memory
        return scaled

    def save(self, path: Path) -> None:
        """Write the arrays; no code is in the file."""
        write_arrays(path, {name: np.asarray(value) for name, value in vars(self).items()})


def read_residual(path: Path) -> Residual:
    """The correction in a file.

    Raises:
        ValueError: The file is damaged or not of this kind.
        OSError: It cannot be read.
    """
    arrays = read_arrays(path)
    arrays.check_finite()
    arrays.check_shapes({"rows": (None, None)})
    rows, features = arrays["rows"].shape
    shapes = {
        "memory": (),
        "width": (),
        "middle": (features,),
        "spread": (features,),
        "band": (None,),
        "rows": (rows, features),
        "weights": (rows, None),
    }
    arrays.check_shapes(shapes)
    if not (arrays["width"] > 0 and (arrays["spread"] > 0).all()):
        raise ValueError(f"{path}: width and spread must be positive")
    return Residual(**{n: arrays[n] if shape else float(arrays[n]) for n, shape in shapes.items()})


def rows_of(model: StaticModel, found: Simulated) -> tuple[ndarray, ndarray, ndarray]:
    """Bends (t, b) [rad], commands (t, n) in SI units and begins (t,) bool of simulated rows.

    Bends are turns about x, then about y, of the stretches between ends of sections and tendons.
    """
    turns = np.stack([found.turns[:, 0::3], found.turns[:, 1::3]], axis=1)
    bends = np.add.reduceat(turns, model.stretches, axis=2).reshape(len(turns), -1)
    return bends, model.recording.commands, model.recording.begins


def corrected(residual: Residual, robot: RobotParams, recording: Recording) -> ndarray:
    """(t, k, 3) [m] in the world, to be added to a simulation of an identified robot's markers."""
    model = StaticModel(robot, recording, known=FRICTIONS)
    found = model.simulate(np.zeros(len(model.unknowns.spread)))
    return residual.correction(*rows_of(model, found)) @ robot.clamp.axes.T


def trained(
    bends: ndarray,
    commands: ndarray,
    begins: ndarray,
    error: ndarray,
    blocks: ndarray,
    used: ndarray | None = None,
) -> Residual | None:
    """Learn the correction; None if cross-validation shows that none helps.

    Args:
        bends, commands, begins: Of all rows, as they followed each other.
        error: (t, k, 3) [m], simulated less recorded; NaN where unknown.
        blocks: (t,) number of the block.
        used: (t,) bool, rows to learn from; all unless given.
    """
    band = _BAND * np.maximum(bends.std(axis=0), 1e-6)
    raw = _features(bends, commands, begins, band)
    target = -error.reshape(len(error), -1)
    target[:, np.isnan(target).all(axis=0)] = 0.0  # never measured: nothing to correct
    known = np.flatnonzero(np.isfinite(target).all(axis=1) & (True if used is None else used))
    known = known[:: ceil(len(known) / _MOST)]
    middle, spread = raw[known].mean(axis=0), raw[known].std(axis=0)
    spread = np.maximum(spread, 1e-9 + 1e-6 * np.abs(raw[known]).max(axis=0))
    held = bends.shape[1]
    number = np.unique(blocks[known], return_inverse=True)[1]
    fold = number * _FOLDS // (number.max() + 1)
    scaled, target = (raw[known] - middle) / spread, target[known]
    best, least = None, float(np.sum(target**2))
    for memory in _MEMORY:
        features = scaled.copy()
        features[:, held : 2 * held] *= memory
        square = _squares(features, features)
        for width, noise in product(_WIDTHS, _NOISES):
            matrix = np.exp(-square / 2 / width**2)
            left = _left(matrix, target, fold, noise)
            if left < 0.98 * least:
                best, least = (memory, width, features, matrix + noise * np.eye(len(matrix))), left
    if best is None:
        return None
    memory, width, features, matrix = best
    weights = solve(matrix, target)
    return Residual(middle, spread, band, memory, width, features, weights)


def _left(matrix: ndarray, target: ndarray, fold: ndarray, noise: float) -> float:
    """Sum of squares that corrections learned of other folds leave."""
    left = 0.0
    for k in range(_FOLDS):
        held, learned = fold == k, fold != k
        if not held.any() or not learned.any():
            continue
        inner = matrix[np.ix_(learned, learned)] + noise * np.eye(int(learned.sum()))
        weights = solve(inner, target[learned])
        left += float(np.sum((target[held] - matrix[np.ix_(held, learned)] @ weights) ** 2))
    return left


def _features(bends: ndarray, commands: ndarray, begins: ndarray, band: ndarray) -> ndarray:
    """(t, 2 b + n): bends, what dead bands hold back of them, and commands."""
    held, middle = np.zeros_like(bends), bends[0].copy()
    for t, bend in enumerate(bends):
        middle = bend.copy() if begins[t] else np.clip(middle, bend - band, bend + band)
        held[t] = bend - middle
    return np.concatenate([bends, held, commands], axis=1)


def _squares(a: ndarray, b: ndarray) -> ndarray:
    """(n, m) mean squared differences of features (n, f) and (m, f)."""
    square = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1)[None, :] - 2 * a @ b.T
    return np.maximum(square, 0.0) / a.shape[1] * 4
