"""Rows at rest out of a recording of a moving robot: the ends of times without a new command."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy import ndarray

from softrobot_env.recordings import Recording

_SHORTEST = 0.3  # s without a new command
_MEASURED = 0.25  # share of a rest, at its end, that is averaged
_STILL = 0.01  # way of a marker over that end, over its whole range
_JUMP = 0.5  # share of the way between two static windows that is made in one row
_LITTLE = 0.02  # change of a command, over its range, that lets nothing go
_SAME = 1e-3  # change of a command, over its range

#: Fewest windows that a static identification takes.
FEWEST = 8


def at_rest(recording: Recording, dithered: ndarray | None = None) -> Recording:
    """One row for each rest: the command, and markers averaged over its end.

    A run that begins with a motion has its first row as well, without markers.

    Where the robot was let go on the way to a rest, or did not go straight, another run begins, and
    the marker does not count: its tendons come to rest anywhere within their friction. A rest in
    which a marker still moves by more than a hundredth of its range does not count.

    Args:
        recording: Of a robot that moves, or in whose rows it rests.
        dithered: (t,) bool, rows of windows that dither went before; none unless given. There the
            robot is as if nothing rubbed, and each is a run of its own.

    Raises:
        ValueError: There are fewer than `FEWEST` of them.
    """
    loose = np.zeros(len(recording.times), bool) if dithered is None else dithered
    if recording.static:
        number = np.cumsum(np.append(False, (np.diff(recording.runs) != 0) | loose[1:]))
        return replace(recording, runs=number, times=_since(recording.times, number))
    rows, markers, runs = [], [], []
    span = np.maximum(np.ptp(recording.commands, axis=0), 1e-12)
    reach = np.nanmax(np.ptp(_known(recording.markers), axis=0))
    new = _new_commands(recording, span)
    for begin, end in zip([0, *new], [*new, len(recording.times)], strict=True):
        lasted = recording.times[end - 1] - recording.times[begin]
        first = begin == 0 or recording.runs[begin] != recording.runs[begin - 1]
        if lasted < _SHORTEST and first:  # from where it moved, which friction remembers
            rows.append(begin)
            runs.append(recording.runs[begin])
            markers.append(np.full_like(recording.markers[begin], np.nan))
        if lasted < _SHORTEST:
            continue
        measured = recording.times[end - 1] - max(_MEASURED * lasted, 0.05)
        last = np.arange(begin, end)[recording.times[begin:end] >= measured]
        seen = _known(recording.markers[last])
        if np.nanmax(np.ptp(seen, axis=0)) > _STILL * reach + 4 * _noise(seen):
            continue
        rows.append(last[0])  # the last ones may begin to go on
        runs.append(recording.runs[begin])
        markers.append(recording.markers[last].mean(axis=0))
    known = sum(np.isfinite(seen).any() for seen in markers)
    if known < FEWEST:
        raise ValueError(
            f"the robot moves and rests {known} times in the recording, fewer than {FEWEST}: "
            "record pulls with rests (`softrobot robot record --kinds pulls`), or say static = "
            "true in the header if it moved so slowly that every row is at rest"
        )
    jumped, apart = _jumps(recording, np.array(rows), span), loose[rows][1:]
    number = np.cumsum(np.append(False, (np.diff(runs) != 0) | jumped | apart))
    seen = np.array(markers)
    seen[1:][jumped & ~apart] = np.nan
    lost = tuple(replace(marker, may_be_lost=True) for marker in recording.header.marker)
    return Recording(
        header=replace(recording.header, static=True, marker=lost),
        times=_since(recording.times[rows], number),
        commands=recording.commands[rows],
        markers=seen,
        labels=recording.labels[rows],
        runs=number,
    )


def _new_commands(recording: Recording, span: ndarray) -> list[int]:
    """Rows whose command is another than the last new one, however slowly it came to that."""
    last, found = recording.commands[0], []
    for row, command in enumerate(recording.commands):
        other = row > 0 and recording.runs[row] != recording.runs[row - 1]
        if other or (np.abs(command - last) > _SAME * span).any():
            found.append(row)
            last = command
    return found


def _jumps(recording: Recording, rows: ndarray, span: ndarray) -> ndarray:
    """(t - 1,) bool, where friction ends anywhere between two windows.

    There the robot was let go, or did not go straight: its commands went beyond both.
    """
    found = []
    for begin, end in pairwise(rows):
        way = recording.commands[begin : end + 1] / span
        whole = np.abs(way[-1] - way[0])
        jumped = np.abs(np.diff(way, axis=0)).max() > _JUMP * whole.max() > _JUMP * _LITTLE
        ends = np.sort(way[[0, -1]], axis=0)
        beyond = np.maximum(ends[0] - way.min(axis=0), way.max(axis=0) - ends[1])
        found.append(bool(jumped or beyond.max() > _LITTLE))
    return np.array(found, bool)


def _since(times: ndarray, runs: ndarray) -> ndarray:
    """(t,) [s] since the first row of each run."""
    first = np.append(True, np.diff(runs) != 0)
    return times - times[first][runs]


def _known(markers: ndarray) -> ndarray:
    return np.where(np.isnan(markers), 0.0, markers)


def _noise(seen: ndarray) -> float:
    """[m], standard deviation by differences of neighbours."""
    return float(np.abs(np.diff(seen, axis=0)).std()) if len(seen) > 2 else 0.0
