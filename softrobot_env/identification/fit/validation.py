"""Cross-validation by blocks of whole patterns: how far the result is off where it was not fitted.

Commands of the rows left out are still followed, since friction remembers; their markers are not
seen.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.processes import worker_processes
from softrobot_env.recordings import Recording
from softrobot_env.robots import RobotParams

from ..replay import mean_known
from .least_squares import Weights, search, size
from .model import StaticModel
from .residual import bends_of, trained
from .unknowns import Turned

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


class Setup(NamedTuple):
    """What is fitted, and where searches begin.

    Attributes:
        robot, recording, turned, known: See `StaticModel`.
        x: (p,) found with all rows.
        free: (p,) bool.
        weights: Of the rows.
    """

    robot: RobotParams
    recording: Recording
    turned: Turned
    known: Sequence[str]
    x: ndarray
    free: ndarray
    weights: Weights


def cross_validated(
    setup: Setup, residual: bool, show: Callable[[int, int], None]
) -> list[Validation]:
    """Fit without one block after the other, in two processes.

    Args:
        setup: What.
        residual: Whether a residual is learned as well.
        show: Called with how many of how many fits are done.
    """
    patterns = pattern_numbers(setup.recording)
    tasks = [(scheme, block) for scheme in SCHEMES for block in range(BLOCKS)]
    found: dict[Scheme, Validation] = {}
    with worker_processes(_PROCESSES) as pool:
        futures = [
            pool.submit(_without, setup, blocks_of(patterns, scheme) != block, residual)
            for scheme, block in tasks
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


def _without(setup: Setup, used: ndarray, residual: bool) -> tuple[ndarray, ndarray]:
    """Errors (t, k, 3) of all rows by a fit of those that are used, without and with residual."""
    robot, recording, turned, known, *start = setup
    model = StaticModel(robot, recording, turned, known=known)
    fit = search(model, *start, used=used, steps=_STEPS, least=_ENOUGH)
    error = fit.simulated.error
    if not residual:
        return error, error
    given = (bends_of(model, fit.simulated.turns), recording.commands, model.begins)
    learned = trained(*given, error, pattern_numbers(recording), used)
    return error, error if learned is None else error + learned.correction(*given)


def centred(error: ndarray) -> float:
    """RMS [m] of errors (t, k, 3) less the mean of each marker."""
    return size(error - mean_known(error))
