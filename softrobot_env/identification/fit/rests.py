"""Rows at rest out of a recording of a moving robot: the ends of times without a new command."""

from dataclasses import replace

import numpy as np

from softrobot_env.recordings import Recording

_SHORTEST = 0.3  # s without a new command
_MEASURED = 0.25  # share of a rest, at its end, that is averaged
_STILL = 0.01  # way of a marker over that end, over its whole range
_SAME = 1e-3  # change of a command, over its range

#: Fewest rests that a static identification takes.
FEWEST = 8


def at_rest(recording: Recording) -> Recording:
    """One row for each rest: the command, and markers averaged over its end.

    A rest in which a marker still moves by more than a hundredth of its range does not count.

    Raises:
        ValueError: There are fewer than `FEWEST` of them.
    """
    if recording.static:
        return recording
    rows, markers = [], []
    span = np.maximum(np.ptp(recording.commands, axis=0), 1e-12)
    reach = np.nanmax(np.ptp(_known(recording.markers), axis=0))
    moved = np.abs(np.diff(recording.commands, axis=0)) > _SAME * span
    new = np.flatnonzero(moved.any(axis=1) | (np.diff(recording.runs) != 0)) + 1
    for begin, end in zip([0, *new], [*new, len(recording.times)], strict=True):
        lasted = recording.times[end - 1] - recording.times[begin]
        if lasted < _SHORTEST:
            continue
        first = recording.times[end - 1] - max(_MEASURED * lasted, 0.05)
        last = np.arange(begin, end)[recording.times[begin:end] >= first]
        seen = _known(recording.markers[last])
        if np.nanmax(np.ptp(seen, axis=0)) > _STILL * reach + 4 * _noise(seen):
            continue
        rows.append(last[-1])
        markers.append(recording.markers[last].mean(axis=0))
    if len(rows) < FEWEST:
        raise ValueError(
            f"the robot moves and rests {len(rows)} times in the recording, fewer than {FEWEST}: "
            "record pulls with rests (`softrobot robot record --kinds pulls`), or say static = "
            "true in the header if it moved so slowly that every row is at rest"
        )
    return still(recording.part(np.array(rows)), np.array(markers))


def still(recording: Recording, markers: np.ndarray) -> Recording:
    """The recording with other markers (t, k, 3) [m], of a robot at rest in every row."""
    return replace(recording, markers=markers, header=replace(recording.header, static=True))


def _known(markers: np.ndarray) -> np.ndarray:
    return np.where(np.isnan(markers), 0.0, markers)


def _noise(seen: np.ndarray) -> float:
    """[m], standard deviation by differences of neighbours."""
    return float(np.abs(np.diff(seen, axis=0)).std()) if len(seen) > 2 else 0.0
