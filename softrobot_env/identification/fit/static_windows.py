"""Rows at rest from a recording of a moving robot: the ends of periods without a new command."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy import ndarray

from softrobot_env.recordings import Recording
from softrobot_env.recordings.recording import since_begin

_SHORTEST = 0.3  # s without a new command
_MEASURED = 0.25  # share of a rest, at its end, that is averaged
_STILL = 0.01  # way of a marker over that end, over its whole range
_JUMP = 0.5  # share of the way between two static windows that is made in one row
_LITTLE = 0.02  # change of a command, over its range, that lets nothing go
_SAME = 1e-3  # change of a command, over its range

#: Fewest windows for a static identification.
FEWEST = 8


def at_rest(recording: Recording, dithered: ndarray | None = None) -> Recording:
    """One row for each rest: the command, and markers averaged over its end.

    A run that begins with a motion has its first row as well, without markers.

    If the robot was released on the way to a rest, or did not move straight there, another run
    begins, and the marker is ignored: its tendons may rest anywhere within their friction. A rest
    in which a marker still moves by more than a hundredth of its range is ignored.

    Args:
        recording: Of a moving robot, or of one at rest in every row.
        dithered: (t,) bool, rows of windows that follow a dither; by default none. There the robot
            is as if without friction, and each is a separate run.

    Raises:
        ValueError: There are fewer than `FEWEST` of them.
    """
    loose = np.zeros(len(recording.times), bool) if dithered is None else dithered
    if recording.static:
        return _in_runs(recording, recording.begins | loose)
    rows, markers = [], []
    span = np.maximum(np.ptp(recording.commands, axis=0), 1e-12)
    reach = np.nanmax(np.ptp(np.nan_to_num(recording.markers), axis=0))
    new = _new_commands(recording, span)
    for begin, end in zip([0, *new], [*new, len(recording.times)], strict=True):
        lasted = recording.times[end - 1] - recording.times[begin]
        if lasted < _SHORTEST and recording.begins[begin]:  # friction remembers from where it moved
            rows.append(begin)
            markers.append(np.full_like(recording.markers[begin], np.nan))
        if lasted < _SHORTEST:
            continue
        measured = recording.times[end - 1] - max(_MEASURED * lasted, 0.05)
        last = np.arange(begin, end)[recording.times[begin:end] >= measured]
        seen = np.nan_to_num(recording.markers[last])
        if np.nanmax(np.ptp(seen, axis=0)) > _STILL * reach + 4 * _noise(seen):
            continue
        rows.append(last[0])  # the robot may already move in the last ones
        markers.append(recording.markers[last].mean(axis=0))
    known = sum(np.isfinite(seen).any() for seen in markers)
    if known < FEWEST:
        raise ValueError(
            f"the robot moves and rests {known} times in the recording, fewer than {FEWEST}: "
            "record pulls with rests (`softrobot robot record --kinds pulls`), or say static = "
            "true in the header if it moved so slowly that every row is at rest"
        )
    jumped, apart = _jumps(recording, np.array(rows), span), loose[rows][1:]
    seen = np.array(markers)
    seen[1:][jumped & ~apart] = np.nan
    found, header = recording.part(np.array(rows)), recording.header.with_markers(may_be_lost=True)
    found = replace(found, header=replace(header, static=True), markers=seen)
    return _in_runs(found, found.begins | np.append(False, jumped | apart))


def _in_runs(recording: Recording, begins: ndarray) -> Recording:
    """The recording with runs that begin at some rows (t,) bool."""
    runs = np.cumsum(begins) - begins[0]
    return replace(recording, runs=runs, times=since_begin(recording.times, runs))


def _new_commands(recording: Recording, span: ndarray) -> list[int]:
    """Rows whose command is another than the last new one, however slowly it came to that."""
    last, found, begins = recording.commands[0], [], recording.begins
    for row, command in enumerate(recording.commands):
        other = row > 0 and begins[row]
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


def _noise(seen: ndarray) -> float:
    """[m], standard deviation by differences of neighbours."""
    return float(np.abs(np.diff(seen, axis=0)).std()) if len(seen) > 2 else 0.0
