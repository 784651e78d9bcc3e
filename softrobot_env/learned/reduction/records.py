"""Motion to learn from: outputs and inputs at equal intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray


@dataclass(frozen=True)
class Record:
    """An uninterrupted motion.

    Attributes:
        outputs: z (t, o), what was measured.
        inputs: u (t, k), what the drives were commanded: row i acts from sample i to the next one.
        period: [s] between samples.
    """

    outputs: ndarray
    inputs: ndarray
    period: float

    def __post_init__(self) -> None:
        for name in ("outputs", "inputs"):
            array = np.ascontiguousarray(getattr(self, name), dtype=float)
            if array.ndim != 2:
                raise ValueError(f"record: {name} must have shape (samples, n), got {array.shape}")
            bad = np.argwhere(~np.isfinite(array))
            if len(bad):
                raise ValueError(
                    f"record: {name} must be finite, got {array[tuple(bad[0])]} in sample "
                    f"{bad[0][0]}, column {bad[0][1]}"
                )
            object.__setattr__(self, name, array)
        if len(self.outputs) != len(self.inputs):
            raise ValueError(
                f"record: as many samples of inputs as of outputs are needed, got "
                f"{len(self.inputs)} and {len(self.outputs)}"
            )
        if not 0 < self.period < np.inf:
            raise ValueError(f"record: period must be positive, got {self.period!r} s")

    @property
    def samples(self) -> int:
        """Number of samples."""
        return len(self.outputs)

    @property
    def end(self) -> ndarray:
        """(o,) where a decay ends: the mean over its last tenth."""
        return self.outputs[-max(1, self.samples // 10) :].mean(axis=0)


def check_alike(records: Sequence[Record]) -> None:
    """Raise ValueError unless there are records and all have the same columns and period."""
    if not records:
        raise ValueError("there is no record to learn from")
    first = records[0]
    for number, record in enumerate(records):
        columns = record.outputs.shape[1], record.inputs.shape[1]
        if columns != (first.outputs.shape[1], first.inputs.shape[1]):
            raise ValueError(
                f"record {number} has {columns[0]} outputs and {columns[1]} inputs, the first one "
                f"{first.outputs.shape[1]} and {first.inputs.shape[1]}"
            )
        if abs(record.period - first.period) > 1e-9 * first.period:
            raise ValueError(
                f"record {number} has a period of {record.period:g} s, the first one of "
                f"{first.period:g} s"
            )


def delay_vectors(outputs: ndarray, delays: int) -> ndarray:
    """Outputs (..., t, o) with their past: (..., t - delays + 1, delays * o), the newest first.

    Takens' embedding (thesis sec. 3.3.2), looking back so that a controller has it in time.
    """
    count = outputs.shape[-2] - delays + 1
    parts = [outputs[..., delays - 1 - k : delays - 1 - k + count, :] for k in range(delays)]
    return np.concatenate(parts, axis=-1)
