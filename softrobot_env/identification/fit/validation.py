"""Cross-validation by contiguous blocks: the error on data that were not fitted.

Blocks are as long as the recording allows, because drift and lasting effects correlate consecutive
rows: interleaved pieces would be predicted better than any further recording. A left-out block is
simulated as a separate recording, with an unknown state of friction at its start.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy import ndarray

from softrobot_env.core.processes import chosen_processes, worker_processes
from softrobot_env.recordings import Recording

from .least_squares import Fit, search
from .model import StaticModel
from .residual import rows_of, trained

BLOCKS = 8
_CHUNKS = 40  # of a recording without runs and patterns
_FEW = 6  # blocks, below which those beside one that is left out are needed for the fit
_STEPS = 6
_PROCESSES, _LONG = 2, 500  # rows, from which on starting processes pays
_ENOUGH = 6e-3


@dataclass(frozen=True)
class Validation:
    """Errors of rows that were not fitted.

    Attributes:
        blocks: (t,) number of the block.
        error: (t, k, 3) [m] by physics alone, along the robot's axes.
        corrected: The same with the residual that was learned of the other blocks; None without.
    """

    blocks: ndarray
    error: ndarray
    corrected: ndarray | None


def blocks_of(recording: Recording) -> ndarray:
    """(t,) block of each row: whole runs, or whole patterns if runs are few, one after the other.

    If there are too few of either, pieces of the recording.
    """
    same = np.array([recording.begins, recording.begins])
    same[1, 1:] |= recording.patterns[1:] != recording.patterns[:-1]
    for begins in same:
        if begins.sum() >= BLOCKS:
            parts = np.cumsum(begins) - 1
            break
    else:
        parts = np.arange(len(recording.times)) * _CHUNKS // len(recording.times)
    rows = np.bincount(parts)
    middle = np.cumsum(rows) - rows / 2
    blocks = (middle / len(parts) * BLOCKS).astype(int)[parts]
    return np.unique(blocks, return_inverse=True)[1]


def fitted_without(blocks: ndarray, block: int) -> ndarray:
    """(t,) bool, rows of a fit without a block and its neighbours.

    Args:
        blocks: (t,) block of each row, numbered as they follow each other.
        block: That is left out.
    """
    beside = 1 if blocks.max() + 1 >= _FEW else 0
    return np.abs(blocks - block) > beside


def cross_validated(
    model: StaticModel, fit: Fit, residual: bool, show: Callable[[int, int], None]
) -> Validation:
    """Fit without each block and its neighbours in turn; if that is long, in two processes.

    Args:
        model: What is fitted.
        fit: Where searches begin, and by which weights.
        residual: Whether a residual is learned as well.
        show: Called with how many of how many fits are done.
    """
    without = partial(_without, model, (fit.x, fit.free, fit.weights), residual)
    blocks = blocks_of(model.recording)
    error = np.full_like(fit.simulated.error, np.nan)
    corrected = np.full_like(error, np.nan)
    parts = [(blocks == k, fitted_without(blocks, k)) for k in range(blocks.max() + 1)]
    long = len(blocks) >= _LONG
    with worker_processes(_PROCESSES) if long else chosen_processes() as pool:
        each = map if pool is None else pool.map
        results = each(without, *zip(*parts, strict=True))
        for number, ((held, _), found) in enumerate(zip(parts, results, strict=True), 1):
            error[held], corrected[held] = found
            show(number, len(parts))
    return Validation(blocks, error, corrected if residual else None)


def _without(
    model: StaticModel, start: tuple, residual: bool, held: ndarray, used: ndarray
) -> tuple[ndarray, ndarray]:
    """Errors (h, k, 3) of rows held back by a fit of those used, without and with residual."""
    fit = search(model, *start, used=used, steps=_STEPS, least=_ENOUGH)
    block = model.on(model.recording.part(held))
    found = block.simulate(fit.x)
    if not residual:
        return found.error, found.error
    blocks, error = blocks_of(model.recording), fit.simulated.error
    learned = trained(*rows_of(model, fit.simulated), error, blocks, used)
    change = 0.0 if learned is None else learned.correction(*rows_of(block, found))
    return found.error, found.error + change
