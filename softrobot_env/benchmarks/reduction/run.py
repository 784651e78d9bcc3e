"""The thesis' study of reduced models, on twins of the rig, and what is better (sec. 3.3.3)."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, thread_time
from typing import Any

import numpy as np

from softrobot_env.benchmarks.reduction.data import Followed, RigData
from softrobot_env.benchmarks.reduction.models import (
    MODELS,
    OURS,
    PHYSICAL,
    THESIS_MODEL,
    Model,
    Records,
)
from softrobot_env.benchmarks.reduction.rows import (
    DataRow,
    LoopRow,
    OrderRow,
    PathRow,
    Row,
    SpectrumRow,
)
from softrobot_env.control.reduced.environment import preview_times
from softrobot_env.core.artifacts import write_arrays
from softrobot_env.core.interfaces import Policy
from softrobot_env.core.jobs import Progress, run_in_processes
from softrobot_env.evaluation.metrics import approached_metrics
from softrobot_env.evaluation.runner import Case
from softrobot_env.evaluation.runner import run as run_episode
from softrobot_env.learned.reduction import (
    THESIS,
    FitError,
    Record,
    ReducedModel,
    Settings,
    fit,
    spectrum,
)
from softrobot_env.robots import RIG
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.artifacts import fingerprint
from softrobot_env.tasks import make_task
from softrobot_env.training.ssm import learn, trusted

#: Rigs: without friction and errors; the twin that settings were chosen on; and three others.
TWINS: tuple[int | None, ...] = (None, 0, 1, 2, 3)
SHOWN = 0

#: Goals and the thesis' errors [m] of the mean over both paths, by period [s].
GOALS = {
    THESIS_MODEL: {10.0: 8e-3, 4.0: 24e-3, 2.0: 24e-3},
    OURS: {10.0: 2e-3, 4.0: 2e-3, 2.0: 2e-3, 1.0: 8e-3},
}
PRINTED = {10.0: 8e-3, 4.0: 24e-3, 2.0: 24e-3}
LOOP_GOALS = {1.0: 3e-3}

#: What Fig. 3.14 varies, delays of two outputs.
SHAPE_ORDERS, DELAYS = (1, 2, 3, 4), (5, 6, 7, 8, 9)
#: Minutes and orders of ours.
MINUTES, ORDERS = (2.0, 5.0, 10.0, 30.0), (1, 2, 3, 4)

_LOOPS, _PERIODS = ("ssm_mpc", "ssm_lq", "hybrid_feedback"), (5.0, 1.0)
_PREDICTED = 25.0  # s
_TIMED = 5  # predictions, of which the fastest counts
_LOST = 10.0  # m, from where on a prediction is said to diverge


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Learn models of rigs, predict paths that they have not seen, and control by them.

    Args:
        quick: One rig, little motion, two models.
        progress: Called with (description, done, total), or None.
    """
    if quick:
        return _rig(SHOWN, True)
    tasks = [
        (f"rig {'without errors' if t is None else t}", partial(_rig, t, False)) for t in TWINS
    ]
    tasks.append(("orders", partial(_orders, SHOWN)))
    tasks.append(("amount of motion", partial(_amounts, SHOWN)))
    return [row for rows in run_in_processes(tasks, progress) for row in rows]


def _rig(twin: int | None, quick: bool) -> list[Row]:
    """All models of a rig on all paths, and closed loops."""
    data = RigData(twin, quick)
    followed = data.paths()
    rows: list[Row] = [_spectrum(data)]
    ours = None
    for name in list(MODELS)[:2] if quick else MODELS:
        decays, forced = data.thesis if name == THESIS_MODEL else data.ours
        begin = perf_counter()
        try:
            model: Model | None = MODELS[name](decays, forced)
        except FitError:
            model = None
        time = perf_counter() - begin
        ours = model if name == OURS else ours
        rows += [_path(name, twin, model, path, time, data.unseen[0]) for path in followed]
    if not quick:
        rows += [
            _row(PHYSICAL, twin, real, _laps(beam), None, None)
            for real, beam in zip(followed, data.paths("pcc"), strict=True)
        ]
    if isinstance(ours, ReducedModel):
        decays, forced = data.ours
        rows += _loops(twin, ours, [*decays, *forced], quick)
    return rows


def _spectrum(data: RigData) -> SpectrumRow:
    decays = data.thesis[0]
    found = spectrum(decays, THESIS.delays, 4)
    slow = found.eigenvalues[0]
    return SpectrumRow(
        data.twin,
        float(-slow.real),
        float(abs(slow.imag)),
        found.separation,
        *((decays[0].outputs, _oscillation(data.excited)) if data.twin == SHOWN else ()),
    )


def _oscillation(record: Record) -> np.ndarray:
    change = (record.inputs[:, :1] - record.inputs[0, 0]) * robot_inputs(RIG).input_scale[0]
    return np.hstack([record.outputs, change])


def _laps(path: Followed) -> np.ndarray:
    return path.record.outputs[path.begin :]


def _path(
    name: str, twin: int | None, model: Model | None, path: Followed, time: float, long: Record
) -> PathRow:
    """Predict a path, from some samples of the rest before it."""
    if model is None:
        return _row(name, twin, path, None, time, None)
    ahead = 20 + model.delays - 1
    rows = slice(path.begin - ahead, None)
    part = Record(path.record.outputs[rows], path.record.inputs[rows], path.record.period)
    predicted = model.predict_record(part)[ahead - model.delays + 1 :]
    count = round(_PREDICTED / long.period)
    cut = Record(long.outputs[:count], long.inputs[:count], long.period)
    return _row(name, twin, path, predicted, time, _time(model, cut))


def _time(model: Model, record: Record) -> float:
    """Time [s] of a prediction, the shortest of some."""
    times = []
    for _ in range(_TIMED):
        begin = perf_counter()
        model.predict_record(record)
        times.append(perf_counter() - begin)
    return min(times)


def _row(
    name: str,
    twin: int | None,
    path: Followed,
    predicted: np.ndarray | None,
    fit_time: float | None,
    predict_time: float | None,
) -> PathRow:
    measured = _laps(path)
    known = predicted is not None and bool(np.abs(predicted).max() < _LOST)
    mean = float(np.linalg.norm(predicted - measured, axis=1).mean()) if known else None
    largest = float(np.linalg.norm(measured - path.record.outputs[0], axis=1).max())
    return PathRow(
        model=name,
        twin=twin,
        path=path.path,
        period=path.period,
        mean=mean,
        nmte=None if mean is None else mean / largest,
        goal=GOALS.get(name, {}).get(path.period),
        thesis=PRINTED.get(path.period) if name == THESIS_MODEL else None,
        fit_time=fit_time,
        predict_time=predict_time,
        measured=measured if twin == SHOWN else None,
        predicted=predicted if twin == SHOWN and known else None,
    )


def _loops(
    twin: int | None, model: ReducedModel, records: Sequence[Record], quick: bool
) -> list[Row]:
    """Triangles by what was learned of this rig; and by the best of the other laws, on twin 0."""
    rows: list[Row] = []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "ssm.npz"
        learned = trusted(model, records)
        write_arrays(path, {**learned.arrays(), **fingerprint(RIG)})
        for policy in _LOOPS[:1] if quick else _LOOPS:
            reduced = policy.startswith("ssm")
            if not reduced and twin != SHOWN:
                continue  # it acts on identified parameters, which are shipped of this twin alone
            for period in _PERIODS[1:] if quick else _PERIODS:
                task = make_task("triangle", period=period)
                case = Case(task, policy, twin=twin)
                if reduced:
                    scene = {"control_period": model.period}
                    scene["preview"] = preview_times(model.period, model.lag)
                    case = replace(case, given={"weights": path}, scene=scene)
                rows.append(_loop(case, LOOP_GOALS.get(period) if reduced else None))
    return rows


class _Clocked:
    """A policy and how long each of its decisions computed, whatever else the machine did then.

    Attributes:
        times: [s] of the decisions of the last episode, the time that the thread was at work.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self.times: list[float] = []
        self._calls = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._policy, name)

    def predict(self, observation: Any, state: Any = None, *others: Any) -> tuple[Any, Any]:
        if state is None:
            self.times, self._calls = [], 0
        begin = thread_time()
        found = self._policy.predict(observation, state, *others)
        taken = thread_time() - begin
        if self._calls % getattr(self._policy, "hold", 1) == 0:
            self.times.append(taken)
        self._calls += 1
        return found


def _loop(case: Case, goal: float | None) -> LoopRow:
    with closing(case.environment()) as env:
        clocked = _Clocked(case.make_policy(env.control_period))
        rollout = run_episode(case, env, clocked).rollout
    errors = approached_metrics(rollout, case.task.trajectory)
    return LoopRow(
        policy=case.policy,
        twin=case.twin,
        period=case.task.option("period"),
        mean=errors.e_mean_tracking,
        largest=errors.e_max_tracking,
        goal=goal,
        decision=float(np.median(clocked.times)),
        longest=float(np.percentile(clocked.times, 99)),
        failure=rollout.failure,
    )


def _rms(model: Model | None, records: Records) -> float | None:
    """(3.23) over records, None where one diverges."""
    if model is None:
        return None
    gaps = [model.predict_record(r) - r.outputs[model.delays - 1 :] for r in records]
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.concatenate([np.sum(gap**2, axis=1) for gap in gaps])
        return float(np.sqrt(squares.mean())) if np.isfinite(squares).all() else None


def _orders(twin: int) -> list[Row]:
    """Fig. 3.14."""
    data, rows = RigData(twin), []
    for delays in DELAYS:
        for order in SHAPE_ORDERS:
            try:
                model = fit(*data.thesis, replace(THESIS, delays=delays, shape_order=order))
            except FitError:
                model = None
            rows.append(OrderRow(twin, order, 2 * delays, _rms(model, data.unseen)))
    return rows


def _amounts(twin: int) -> list[Row]:
    """Ours with less motion to learn from, and of other orders."""
    data = RigData(twin)
    decays, forced = data.ours
    cases = [(minutes, 3) for minutes in MINUTES] + [(MINUTES[-1], o) for o in ORDERS if o != 3]
    rows = []
    for minutes, order in cases:
        share = minutes / MINUTES[-1]
        some = forced[: max(1, round(share * len(forced)))]
        few = decays[:: max(1, round(1 / share))]
        begin = perf_counter()
        try:
            how = Settings(order=order, input_order=order)
            model = learn(few, some, how, lower=False)
        except ValueError:
            model = None
        time, predict_time = perf_counter() - begin, None
        if model is not None:
            predict_time = _time(model, data.unseen[0])
        rows.append(DataRow(twin, minutes, order, _rms(model, data.unseen), time, predict_time))
    return rows
