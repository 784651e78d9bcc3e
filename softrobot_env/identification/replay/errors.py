"""How far simulated markers are from recorded ones, over all and by pattern."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from softrobot_env.identification.replay.simulation import Replay, mean_known

#: Pattern of the row over all rows.
ALL = "all"


@dataclass(frozen=True)
class ErrorRow:
    """Errors of a pattern, or of all rows.

    The distance of simulated and recorded markers, as they are and with the mean error over all
    rows removed from each marker (one offset for all patterns).

    Attributes:
        pattern: Label of the rows, or "all".
        rows: Their number.
        failed: How many of them have no simulated position.
        rms, mean, max: [m]; None where all failed.
        rms_centred, mean_centred, max_centred: [m], mean offset removed.
        offset_x, offset_y, offset_z: [m], mean error; None where it was not measured.
    """

    pattern: str
    rows: int
    failed: int
    rms: float | None
    mean: float | None
    max: float | None
    rms_centred: float | None
    mean_centred: float | None
    max_centred: float | None
    offset_x: float | None
    offset_y: float | None
    offset_z: float | None

    def columns(self) -> dict[str, Any]:
        """The row as report.json has it."""
        return asdict(self)


def error_rows(replay: Replay) -> list[ErrorRow]:
    """Errors of all rows, then of each pattern in the order of its first row."""
    patterns = replay.recording.patterns
    whole = np.ones(len(patterns), dtype=bool)
    parts = {ALL: whole}
    if len(set(patterns)) > 1:
        parts |= {name: patterns == name for name in dict.fromkeys(patterns)}
    return [_row(name, replay, rows) for name, rows in parts.items()]


def _row(name: str, replay: Replay, rows: np.ndarray) -> ErrorRow:
    raw, centred = replay.distance[rows], replay.centred[rows]
    offset = [_number(x) for x in mean_known(replay.error[rows].reshape(-1, 3))]
    failed = int(np.isnan(replay.simulated[rows]).any(axis=(1, 2)).sum())
    return ErrorRow(name, len(raw), failed, *_sizes(raw), *_sizes(centred), *offset)


def _sizes(distance: np.ndarray) -> tuple[float | None, float | None, float | None]:
    known = distance[~np.isnan(distance)]
    if not known.size:
        return None, None, None
    return float(np.sqrt(np.mean(known**2))), float(known.mean()), float(known.max())


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)
