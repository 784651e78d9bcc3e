"""A reduced model of a robot as built, learned from its motion: `softrobot train ssm`."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.linalg import norm
from scipy.signal import savgol_filter

from softrobot_env.control.reduced.policy import Learned
from softrobot_env.core.artifacts import write_arrays
from softrobot_env.core.interfaces import ProgressCallback, quiet
from softrobot_env.learned.reduction import (
    FitError,
    Record,
    ReducedModel,
    Refinement,
    Settings,
    check_stable,
    fit,
    refine,
    spectrum,
)
from softrobot_env.learned.reduction.records import delay_vectors
from softrobot_env.recordings import Recording, read_recording
from softrobot_env.robots import RobotParams, entry_of
from softrobot_env.robots.actuation import TendonMap, robot_inputs
from softrobot_env.robots.artifacts import fingerprint

from .motions import Plan, collect
from .request import Metrics, Quantity, TrainingRequest

#: What a robot does: half an hour, decays aside.
PLAN = Plan(minutes=30, amplitude=0.6, laps_amplitude=1.0)

#: Samples and degree of the polynomials that smooth outputs before the regression.
_SMOOTH = 7, 3

#: Lengths of stretches over the first mode's period.
_STRETCHES = (0.65, 1.9)

#: [1/s], how far inputs that stand for disturbances wander in the root of a second.
_WANDER = 0.03

#: Share of a recording that is kept to judge by, and [s] of a prediction of it.
_KEPT, _JUDGED = 0.15, 2.0

#: Largest error of such predictions, over how far the tip is from the middle.
_WRONG = 0.15

#: Largest difference of tensions that are the same, over the largest.
_SAME = 1e-3

#: Times that motion is collected, and how much smaller than before.
_TRIALS, _SMALLER = 3, 0.6


def learn(
    decays: Sequence[Record],
    forced: Sequence[Record],
    settings: Settings | None = None,
    refinement: Refinement | None = None,
    show: ProgressCallback = quiet,
) -> ReducedModel:
    """A model of measured motion: a regression on smoothed outputs, refined on stretches.

    Lower orders are tried where a model is unstable.

    Args:
        decays, forced: See `learned.reduction.fit`.
        settings, refinement: How.
        show: Shows the progress.

    Raises:
        FitError: What the data lack.
    """

    def progress(done: int, total: int, error: float) -> None:
        show(f"error {error:.3g} m over a stretch", done, total)

    settings = settings or Settings()
    clean = [smoothed(r) for r in decays], [smoothed(r) for r in forced]
    records = [*forced, *decays]

    def attempt(order: int) -> ReducedModel:
        how = replace(settings, order=order, input_order=min(order, settings.input_order))
        model = fit(*clean, how, stable=False)
        model = refine(model, records, refinement or _stretches(model), progress)
        check_stable(model, records)
        return model

    for order in range(settings.order, 1, -1):
        with suppress(ValueError):
            return attempt(order)
    return attempt(1)


def _stretches(model: ReducedModel) -> Refinement:
    """Stretches of the first mode's period, by the model's own modes."""
    slow = model.eigenvalues()
    frequency = np.abs(slow.imag)[np.abs(slow.imag) > 0]
    period = 2 * np.pi / frequency.min() if len(frequency) else 2 / np.abs(slow.real).min()
    shortest = 20 * model.period
    return Refinement(lengths=tuple(max(share * period, shortest) for share in _STRETCHES))


def smoothed(record: Record) -> Record:
    """With less noise: local polynomials, which do not shift in time."""
    return replace(record, outputs=savgol_filter(record.outputs, *_SMOOTH, axis=0))


def trusted(model: ReducedModel, records: Sequence[Record]) -> Learned:
    """A model with what it errs by, as records show."""
    clean = [smoothed(record) for record in records]
    late = model.delays - 1
    noise, process, inputs = [], [], []
    for record, better in zip(records, clean, strict=True):
        x, true = (model.encode(delay_vectors(r.outputs, model.delays)) for r in (record, better))
        v = model.acting(record.inputs)[late:]
        noise.append(x - true)
        then = model.states(true, np.stack([v, v], axis=1))[:, 1]
        process.append(true[1:] - then[:-1])
        inputs.append(v)
    n, m = model.dimension, model.basis.shape[1]
    whole = np.zeros((n + m, n + m))
    whole[:n, :n] = _covariance(process)
    whole[n:, n:] = _WANDER**2 * model.period * np.eye(m)
    moved = np.concatenate(inputs)
    floor = 1e-12 * np.eye(n) * np.square(model.scale[:n])
    far = max(norm(r.outputs - model.origin, axis=1).max() for r in records)
    return Learned(
        **model.arrays(),
        process=whole,
        noise=_covariance(noise) + floor,
        lower=moved.min(axis=0),
        upper=moved.max(axis=0),
        farthest=np.array(far),
    )


def _covariance(parts: Sequence[ndarray]) -> ndarray:
    """Of rows about zero; those far out, at the ends of records for instance, do not count."""
    rows = np.concatenate(parts)
    size = norm(rows / np.maximum(rows.std(axis=0), 1e-300), axis=1)
    rows = rows[size <= np.quantile(size, 0.99)]
    return rows.T @ rows / len(rows)


def records_of(recording: Recording, robot: RobotParams, axes: str) -> list[Record]:
    """A recording's runs: tips along axes, and the actions that make its commands.

    Raises:
        FitError: Rows at rest, markers that were lost, or times that are not evenly spaced.
        ValueError: Commands that are not those of the robot's drives.
    """
    if recording.static:
        raise FitError("the recording has rows at rest only; a reduced model learns from motion")
    actions = _actions(recording, robot)
    tips = recording.markers[:, -1][:, ["xyz".index(axis) for axis in axes]]
    found = []
    for run in np.unique(recording.runs):
        rows = recording.runs == run
        times = recording.times[rows]
        if len(times) < 2:
            continue
        period = float(np.median(np.diff(times)))
        even = np.arange(times[0], times[-1] + period / 2, period)
        if np.diff(times).max() > 1.5 * period:
            late = float(times[int(np.argmax(np.diff(times)))])
            raise FitError(
                f"run {run} has a gap of {np.diff(times).max():.3g} s after {late:.6g} s; samples "
                f"{period:.3g} s apart are needed"
            )
        if np.isnan(tips[rows]).any():
            raise FitError(f"run {run}: the marker at the tip was lost")
        place = np.minimum(np.searchsorted(times, even + 1e-9, side="right") - 1, len(times) - 1)
        outputs = np.stack([np.interp(even, times, column) for column in tips[rows].T], axis=1)
        found.append(Record(outputs, actions[rows][place], round(period, 6)))
    return found


def _actions(recording: Recording, robot: RobotParams) -> ndarray:
    """Actions (t, n_inputs) that make a recording's commands."""
    if recording.kind == "action":
        return recording.commands
    if recording.drive(robot) != robot.drive.kind:
        raise FitError(
            f"robot {robot.name!r} is driven by {robot.drive.kind}, the recorded one by "
            f"{recording.kind}"
        )
    inputs, controls = robot_inputs(robot), recording.controls(robot)
    reduced = controls
    if isinstance(inputs, TendonMap):
        reduced = (controls - inputs.command(np.zeros(inputs.n_inputs))) @ inputs.phi.T
        off = np.abs(inputs.command(reduced) - controls).max()
        if off > _SAME * max(float(np.abs(controls).max()), 1.0):
            raise FitError(
                f"the recorded tensions are up to {off:.3g} N from those that actions of "
                f"{robot.name!r} make: they resolve its redundancy in another way"
            )
    return inputs.to_actions(reduced)


def split_decays(records: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """Decays, under inputs that do not change, and other motion."""
    decays, others = [], []
    for record in records:
        (decays if np.ptp(record.inputs, axis=0).max() < 1e-9 else others).append(record)
    return decays, others


def judged(model: ReducedModel, records: Sequence[Record]) -> float:
    """Mean distance [m] between predicted and measured outputs, over predictions of 2 s."""
    need = round(_JUDGED / model.period) + model.delays + model.lag
    errors = []
    for record in records:
        for first in range(0, record.samples - need, need):
            part = slice(first, first + need)
            cut = Record(record.outputs[part], record.inputs[part], record.period)
            gap = model.predict_record(cut) - cut.outputs[model.delays - 1 :]
            with np.errstate(over="ignore", invalid="ignore"):
                errors.append(norm(gap, axis=1))
    return float(np.mean(np.concatenate(errors))) if errors else float("nan")


def run(request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Learn as requested and write the file."""
    given: dict[str, Any] = dict(request.settings)
    quick, robot = "quick" in given, request.robot
    settings = Settings(order=2, input_order=2) if quick else Settings()
    short = Refinement(lengths=(0.5,), iterations=2, stretches=50) if quick else None
    learned = partial(learn, settings=settings, refinement=short, show=show)
    figures: Metrics = []
    if "recording" in given:
        recording = read_recording(Path(given["recording"]))
        axes = entry_of(robot).axes or ("xz" if robot.moves_in_xz else "xyz")
        found = _judged(learned, *split_decays(records_of(recording, robot, axes)))
    else:
        plan = replace(PLAN, seed=request.seed)
        if quick:
            plan = replace(plan, decays=6, excited=2, minutes=3.0)
        twin = given.get("twin", entry_of(robot).twin)
        found, plan = _simulated(learned, robot, plan, twin, show)
        figures.append(("largest inputs, of the workspace's", f"{plan.laps_amplitude:.2g}"))
    model, decays, forced, error = found
    believed = trusted(model, [*forced, *decays])
    about = {"seed": request.seed} | ({"twin": given["twin"]} if "twin" in given else {})
    write_arrays(request.path, {**believed.arrays(), **fingerprint(robot), **about})
    if decays:
        figures.append(("spectrum", str(spectrum(decays, model.delays, model.dimension))))
    minutes = sum(r.samples for r in (*decays, *forced)) * model.period / 60
    return [
        ("learned from", f"{minutes:.1f} min"),
        *figures,
        ("lag of the inputs", f"{model.lag * model.period:.3g} s"),
        ("coordinates, order", f"{model.dimension}, {int(model.powers.sum(axis=1).max())}"),
        ("terms", str(model.coefficients.size)),
        ("mean error over 2 s, motion left out", Quantity(float(error), ".3g", "mm")),
    ]


#: `learn` with its settings.
_Learn = Callable[[Sequence[Record], Sequence[Record]], ReducedModel]

#: A model, what it was learned from, and its error [m].
_Found = tuple[ReducedModel, list[Record], list[Record], float]


def _simulated(
    learned: _Learn, robot: RobotParams, plan: Plan, twin: int | None, show: ProgressCallback
) -> tuple[_Found, Plan]:
    """A model of simulated motion; of smaller motion where larger one is not predicted."""
    for _ in range(_TRIALS - 1):
        try:
            return _judged(learned, *collect(robot, plan, twin, show)), plan
        except FitError:
            smaller = _SMALLER * plan.amplitude, _SMALLER * plan.laps_amplitude
            plan = replace(plan, amplitude=smaller[0], laps_amplitude=smaller[1])
    return _judged(learned, *collect(robot, plan, twin, show)), plan


def _judged(learned: _Learn, decays: list[Record], forced: list[Record]) -> _Found:
    """Learn from most of the motion, and judge by the rest of it.

    Raises:
        FitError: It is not predicted.
    """
    if not forced:
        raise FitError("there is no motion under changing inputs to learn from")
    if len(forced) == 1:
        one, cut = forced[0], round((1 - _KEPT) * forced[0].samples)
        parts = slice(0, cut), slice(cut, None)
        forced = [Record(one.outputs[part], one.inputs[part], one.period) for part in parts]
    kept = max(1, round(_KEPT * len(forced)))
    known, unseen = forced[:-kept], forced[-kept:]
    model = learned(decays, known)
    error = judged(model, unseen)
    moved = float(np.mean(np.concatenate([norm(r.outputs - model.origin, axis=1) for r in unseen])))
    if not error <= _WRONG * moved:
        raise FitError(
            f"predictions of {_JUDGED:g} s of motion that was left out err by {1e3 * error:.3g} mm "
            f"on average, where the tip is {1e3 * moved:.3g} mm from the middle: more, smaller or "
            "slower motion is needed"
        )
    return model, decays, known, error
