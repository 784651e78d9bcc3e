"""Records of the study of reduced models."""

from dataclasses import dataclass

import numpy as np

from softrobot_env.benchmarks.records import Record, for_pictures


@dataclass(frozen=True)
class PathRow(Record):
    """A path that a model predicts from rest and the inputs alone, two laps.

    Attributes:
        model: Its name.
        twin: Seed of the rig; None without friction and errors.
        path: "rectangle" or "circle".
        period: [s] of a lap.
        mean: [m], mean distance of predicted and measured tips; None where it diverges
            (10 m or more off).
        nmte: Mean distance over the largest distance of the tip from rest [1], the normalised mean
            trajectory error of Cenedese et al. (2022).
        goal: [m], of the mean over both paths, or None.
        thesis: [m], what the thesis prints, or None.
        fit_time: [s] to learn the model.
        predict_time: [s] for a prediction of 25 s.
        measured, predicted: (t, 2) [m].
    """

    model: str
    twin: int | None
    path: str
    period: float
    mean: float | None
    nmte: float | None
    goal: float | None
    thesis: float | None
    fit_time: float | None
    predict_time: float | None
    measured: np.ndarray | None = for_pictures()  # noqa: RUF009
    predicted: np.ndarray | None = for_pictures()  # noqa: RUF009


@dataclass(frozen=True)
class OrderRow(Record):
    """Fig. 3.14: a model with the thesis' settings but for two.

    Attributes:
        twin: As of `PathRow`.
        shape_order: n_w.
        p: Numbers in a delay vector.
        rms: [m], (3.23) over unseen random motion; None where a prediction diverges.
    """

    twin: int | None
    shape_order: int
    p: int
    rms: float | None


@dataclass(frozen=True)
class DataRow(Record):
    """Error against what is learned from, and against order.

    Attributes:
        twin: As of `PathRow`.
        minutes: Of motion under changing inputs.
        order: n_r, of coordinates and inputs together.
        rms: [m], (3.23) over unseen random motion; None where it diverges.
        fit_time, predict_time: [s], as of `PathRow`.
    """

    twin: int | None
    minutes: float
    order: int
    rms: float | None
    fit_time: float
    predict_time: float | None


@dataclass(frozen=True)
class LoopRow(Record):
    """A closed loop on the triangle (thesis sec. 5.4).

    Attributes:
        policy: Its name.
        twin: As of `PathRow`.
        period: [s] of a lap.
        mean, largest: [m], errors of the tip; None where the episode failed.
        goal: [m], of the mean, or None.
        decision: [s] of the processor, median of a decision.
        longest: [s], 99 of 100 are shorter.
        failure: What went wrong, or None.
    """

    policy: str
    twin: int | None
    period: float
    mean: float | None
    largest: float | None
    goal: float | None
    decision: float
    longest: float
    failure: str | None


@dataclass(frozen=True)
class SpectrumRow(Record):
    """Modes of a rig's decays.

    Attributes:
        twin: As of `PathRow`.
        decay, frequency: [1/s], [rad/s] of the slowest mode.
        separation: How many times as fast the modes left out decay.
        decay_path: One, (t, 2) [m].
        excited: (t, 3), a decay and the oscillation before it: x, y [m], and the change of the
            first tendon's length [m].
    """

    twin: int | None
    decay: float
    frequency: float
    separation: float
    decay_path: np.ndarray | None = for_pictures()  # noqa: RUF009
    excited: np.ndarray | None = for_pictures()  # noqa: RUF009


Row = PathRow | OrderRow | DataRow | LoopRow | SpectrumRow
