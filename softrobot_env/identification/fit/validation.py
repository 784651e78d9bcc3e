"""Cross-validation by blocks of whole patterns: how far the result is off where it was not fitted.

Commands of the rows left out are still followed, since friction remembers; their markers are not
seen.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from numpy import ndarray

from softrobot_env.core.processes import worker_processes
from softrobot_env.recordings import Recording

from .least_squares import Fit, search
from .model import StaticModel
from .residual import rows_of, trained

#: How patterns are put into blocks: every fifth one, or a fifth of the recording in one piece.
Scheme = Literal["interleaved", "contiguous"]
SCHEMES: tuple[Scheme, ...] = ("interleaved", "contiguous")

BLOCKS = 5
_CHUNKS = 20  # of a recording without patterns
_STEPS = 6
_PROCESSES = 2
_ENOUGH = 6e-3


@dataclass(frozen=True)
class Validation:
    """Errors of rows that were not fitted.

    Attributes:
        scheme: Of the blocks.
        blocks: (t,) number of the block.
        error: (t, k, 3) [m] by physics alone, along the robot's axes.
        corrected: The same with the residual that was learned of the other blocks; None without.
    """

    scheme: Scheme
    blocks: ndarray
    error: ndarray
    corrected: ndarray | None


def pattern_numbers(recording: Recording) -> ndarray:
    """(t,) number of each row's pattern; a recording without gets pieces of equal size."""
    names = list(dict.fromkeys(recording.patterns.tolist()))
    if len(names) >= BLOCKS:
        where = {name: k for k, name in enumerate(names)}
        return np.array([where[name] for name in recording.patterns.tolist()])
    return np.arange(len(recording.times)) * _CHUNKS // len(recording.times)


def blocks_of(patterns: ndarray, scheme: Scheme) -> ndarray:
    """(t,) block of each row, from its pattern's number."""
    if scheme == "interleaved":
        return patterns % BLOCKS
    rows = np.bincount(patterns)
    middle = np.cumsum(rows) - rows / 2
    return (middle / len(patterns) * BLOCKS).astype(int)[patterns]


def cross_validated(
    model: StaticModel, fit: Fit, residual: bool, show: Callable[[int, int], None]
) -> list[Validation]:
    """Fit without one block after the other, in two processes.

    Args:
        model: What is fitted.
        fit: Where searches begin, and by which weights.
        residual: Whether a residual is learned as well.
        show: Called with how many of how many fits are done.
    """
    without = partial(_without, model, (fit.x, fit.free, fit.weights), residual)
    patterns = pattern_numbers(model.recording)
    tasks = [(scheme, block) for scheme in SCHEMES for block in range(BLOCKS)]
    found: dict[Scheme, Validation] = {}
    with worker_processes(_PROCESSES) as pool:
        futures = [
            pool.submit(without, blocks_of(patterns, scheme) != block) for scheme, block in tasks
        ]
        for number, ((scheme, block), future) in enumerate(zip(tasks, futures, strict=True), 1):
            error, corrected = future.result()
            show(number, len(tasks))
            if scheme not in found:
                rows = blocks_of(patterns, scheme)
                empty = np.full_like(error, np.nan)
                found[scheme] = Validation(scheme, rows, empty, empty.copy() if residual else None)
            held = found[scheme].blocks == block
            found[scheme].error[held] = error[held]
            if residual:
                found[scheme].corrected[held] = corrected[held]
    return list(found.values())


def _without(
    model: StaticModel, start: tuple, residual: bool, used: ndarray
) -> tuple[ndarray, ndarray]:
    """Errors (t, k, 3) of all rows by a fit of those that are used, without and with residual."""
    fit = search(model, *start, used=used, steps=_STEPS, least=_ENOUGH)
    error = fit.simulated.error
    if not residual:
        return error, error
    rows = rows_of(model, fit.simulated)
    learned = trained(*rows, error, pattern_numbers(model.recording), used)
    return error, error if learned is None else error + learned.correction(*rows)
