"""The spiral under a turning tip force (2.79): Fig. 2.19 to 2.22, Tab. 2.2 and 2.3."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from softrobot_env.beams import signals
from softrobot_env.beams.model import BeamModel, IntegrationError, Motion
from softrobot_env.benchmarks.accuracy.cases.spiral import DURATION, PERIOD, ROBOT, force, loads
from softrobot_env.benchmarks.thesis import values
from softrobot_env.benchmarks.thesis.cost import METHODS, TOLERANCE
from softrobot_env.benchmarks.thesis.rows import MODELS, Row, build, make_row
from softrobot_env.benchmarks.timing import best_of

_SHOWN = 4  # of the compared instants, between those in the rows
_ACCURATE = 1e-6  # tolerance of curves
_REFERENCE = 1e-9  # tolerance of references of Tab. 2.2
_REPEATS = 3
_DENSE = 1501  # instants of references of Tab. 2.2

#: Tolerances tried for the adaptive solvers of Tab. 2.2, from loose to strict.
_TOLERANCES = tuple(10.0 ** (-k / 2) for k in range(2, 15))
_MOST_STEPS = 400_000  # of an explicit solver

_OWN = "distance to the model's own converged motion"
_BETWEEN = f"{_OWN}, the tip moving straight from step to step"
_UNEVEN = "19 equal steps; the audit's numbers probably include the tip after 3 s"
_FIRST = "ours starts with a thousandth of the motion"
_EXCHANGED = "the thesis' columns of ode15s and ode45 are exchanged for this model (audit)"


def spiral_model(model: str, n: int) -> BeamModel:
    """Spatial model of the stiff set, without gravity (audit), with forces on its tip."""
    return build(model, ROBOT, n, loads(), planar=False)


@dataclass(frozen=True)
class Curve:
    """Tip (301, 3) [m] of an accurate simulation of a model with n pieces."""

    model: str
    n: int
    tip: np.ndarray

    def distances(self, other: np.ndarray) -> tuple[float, float]:
        """Mean and largest distance [m] to another tip (301, 3) [m]."""
        return _mean_and_largest(self.tip - other)


def _mean_and_largest(difference: np.ndarray) -> tuple[float, float]:
    distance = np.linalg.norm(difference, axis=1)
    return float(distance.mean()), float(distance.max())


def _simulate(beam: BeamModel, samples: Any = PERIOD, **options: Any) -> Motion:
    return beam.simulate(DURATION, _signal(), samples=samples, **options)


def _signal() -> signals.Signal:
    return signals.smooth(force, DURATION)


def curve(model: str, n: int) -> Curve:
    """Accurate simulation of a model."""
    beam = spiral_model(model, n)
    return Curve(model, n, beam.tip(_simulate(beam, tolerance=_ACCURATE).q))


# ---------------------------------------------------------------- Fig. 2.20 to 2.22


def curve_rows(curves: list[Curve]) -> list[Row]:
    """Fig. 2.20 to 2.22, the finest curve of each model making up the mean of the three."""
    finest = [max((c for c in curves if c.model == m), key=lambda c: c.n) for m in MODELS]
    mean = np.mean([c.tip for c in finest], axis=0)
    rows = []
    for each in curves:
        rows += _distance_rows(each, mean, each in finest)
        rows += _size_rows(each)
    shown = [c for c in curves if c.n == values.CHOSEN[c.model]]
    for model, n, tip in [*((c.model, c.n, c.tip) for c in shown), ("mean of models", None, mean)]:
        for k in range(0, len(tip), _SHOWN):
            x, y, _ = tip[k]
            rows.append(make_row("2.21", "spiral", model, n, "tip_x_m", x, ("time_s", k * PERIOD)))
            rows.append(make_row("2.22", "spiral", model, n, "tip_y_m", y, ("tip_x_m", x)))
    return rows


def _distance_rows(each: Curve, mean: np.ndarray, finest: bool) -> list[Row]:
    """Distances to the mean of the models; bounds of the thesis for some."""
    found = each.distances(mean)
    audit = values.SPIRAL_DISTANCE.get((each.model, each.n), (None, None))
    thesis, note = (None, None), None
    if finest:
        thesis = values.FINEST_BOUND
        note = "PCC has no shear, which separates the models by more than the thesis states (audit)"
    elif values.CHOSEN[each.model] == each.n:
        thesis = values.CHOSEN_BOUND
    if audit[0] is not None:
        mean_of = "the audit's mean includes ANCF with 8 pieces"
        note = mean_of if note is None else f"{note}; {mean_of}"
    names = "mean_distance_m", "largest_distance_m"
    return [
        make_row("2.20", "spiral", each.model, each.n, *pair, thesis=limit, audit=known, note=note)
        for *pair, limit, known in zip(names, found, thesis, audit, strict=True)
    ]


def _size_rows(each: Curve) -> list[Row]:
    """Largest radius, and the tip at the end where the audit gives it."""
    known = values.SPIRAL_RADIUS[each.model].get(each.n)
    if known is None:
        return []
    radius = np.max(np.linalg.norm(each.tip[:, :2], axis=1))
    key = each.model, each.n
    rows = [make_row("2.22", "spiral", *key, "largest_radius_m", radius, audit=known)]
    for name, found, expected in zip(
        "xyz", each.tip[-1], values.SPIRAL_TIP.get(key, ()), strict=False
    ):
        rows.append(make_row("2.22", "spiral", *key, f"last_tip_{name}_m", found, audit=expected))
    return rows


# ---------------------------------------------------------------- Fig. 2.19


def time_rows(model: str, pieces: tuple[int, ...]) -> list[Row]:
    """Fig. 2.19: computation times at the thesis' relative tolerance, solver included."""
    method, rows = METHODS[model], []
    for n in pieces:
        beam = spiral_model(model, n)
        time, _ = _timed(beam, method=method, tolerance=TOLERANCE)
        rows.append(make_row("2.19", method, model, n, "computation_time_s", time))
    if model == "ancf":
        fast = [r.n for r in rows if r.y < DURATION]
        most = "most_pieces_in_real_time", max(fast, default=0)
        known = {"thesis": values.REALTIME_ANCF_SPIRAL}
        known |= {"note": f"out of up to {pieces[-1]} pieces"}
        rows.append(make_row("2.19", method, model, None, *most, **known))
    return rows


def _timed(beam: BeamModel, repeats: int = _REPEATS, **options: Any) -> tuple[float, Motion]:
    """Shortest computation time [s] of some simulations, and the motion; compiled before."""
    simulate = partial(beam.simulate, DURATION, _signal(), **options)
    simulate()
    return best_of(simulate, repeats)


# ---------------------------------------------------------------- Tab. 2.2 and 2.3


class _Contest:
    """A model of Tab. 2.2 and its converged motion."""

    def __init__(self, model: str) -> None:
        self.model, self.n = model, values.CHOSEN[model]
        self.beam = spiral_model(model, self.n)
        times = np.linspace(0.0, DURATION, _DENSE)
        motion = _simulate(self.beam, times, tolerance=_REFERENCE)
        self._reference = CubicSpline(times, self.beam.tip(motion.q))

    def row(self, case: str, figure: str, y_name: str, y: float | None, **others: Any) -> Row:
        """A row of one line of the tables; `others` as those of `make_row`."""
        return make_row(figure, case, self.model, self.n, y_name, y, **others)

    def errors(self, step: float | None = None, **options: Any) -> tuple[float, float]:
        """Mean and largest distance [m] at the samples or steps; infinite if it fails."""
        times, tip = self._tips(step, **options)
        return _mean_and_largest(tip - self._reference(times))

    def errors_between(self, step: float, **options: Any) -> tuple[float, float]:
        """The same over the whole motion, the tip moving straight from step to step."""
        times, tip = self._tips(step, **options)
        dense = np.linspace(0.0, DURATION, _DENSE)
        straight = np.stack([np.interp(dense, times, x) for x in tip.T], axis=1)
        return _mean_and_largest(straight - self._reference(dense))

    def _tips(self, step: float | None, **options: Any) -> tuple[np.ndarray, np.ndarray]:
        """Times (k,) [s] and tips (k, 3) [m]; nowhere, so to speak, if the simulation fails."""
        count = 300 if step is None else round(DURATION / step)
        times = np.linspace(0.0, DURATION, count + 1)
        try:
            motion = _simulate(self.beam, times, step=step, **options)
        except IntegrationError:
            return times, np.full((count + 1, 3), np.inf)
        return times, self.beam.tip(motion.q)

    def loosest_tolerance(self, method: str, accuracy: float) -> float | None:
        """First of the tolerances whose mean error is below an accuracy [m]."""
        options = {"method": method, "max_steps": _MOST_STEPS}
        for tolerance in _TOLERANCES:
            if self.errors(tolerance=tolerance, **options)[0] <= accuracy:
                return tolerance
        return None

    def fewest_steps(self, method: str, accuracy: float) -> int:
        """Number of steps of a fixed-step method with a mean error [m] below an accuracy."""

        def good(steps: int) -> bool:
            return self.errors_between(method=method, step=DURATION / steps)[0] <= accuracy

        low, high = 4, 8
        while not good(high):
            low, high = high, 2 * high
        # To one percent: finer distinctions do not change what the step says.
        while high - low > max(1, high // 100):
            middle = (low + high) // 2
            low, high = (low, middle) if good(middle) else (middle, high)
        return high


def table_rows(model: str, quick: bool = False) -> list[Row]:
    """Tab. 2.2 and 2.3 of one model; errors are means over the motion.

    Args:
        model: One of `MODELS`.
        quick: Without the strictest accuracy of implicit Euler and without the explicit solver of
            the stiff models.
    """
    contest = _Contest(model)
    rows = []
    explicit = model == "pcc" or not quick
    for index, method in enumerate(("sdirk4", "dormand_prince")[: 1 + explicit]):
        rows += _adaptive_rows(contest, method, index)
    for index, accuracy in enumerate(values.EULER_ACCURACIES[: 2 if quick else 3]):
        steps = contest.fewest_steps("implicit_euler", accuracy)
        case = f"implicit_euler, {1e3 * accuracy:g} mm"
        rows += _euler_rows(contest, case, steps, index)
    if model == "pcc":
        rows += _printed_step_rows(contest)
    return rows


def _adaptive_rows(contest: _Contest, method: str, column: int) -> list[Row]:
    accuracy = values.ADAPTIVE_ACCURACY
    put = partial(contest.row, f"{method}, {1e3 * accuracy:g} mm")
    time_thesis = values.TIMES[contest.model][column]
    smallest, largest = values.STEPS[contest.model][column]
    tolerance = contest.loosest_tolerance(method, accuracy)
    if tolerance is None:
        note = f"no tolerance reached the accuracy within {_MOST_STEPS} steps"
        return [put("tab2.2", "computation_time_s", None, thesis=time_thesis, note=note)]
    options = {"method": method, "tolerance": tolerance, "max_steps": _MOST_STEPS}
    time, motion = _timed(contest.beam, **options)
    mean, worst = contest.errors(**options)
    note = f"tolerance {tolerance:.1g}, {motion.steps} steps"
    exchanged = _FIRST if contest.model == "pcc" else f"{_FIRST}; {_EXCHANGED}"
    return [
        put("tab2.2", "computation_time_s", time, thesis=time_thesis, note=note),
        put("tab2.2", "mean_error_m", mean, thesis=accuracy, note=_OWN),
        put("tab2.2", "largest_error_m", worst, note=_OWN),
        put("tab2.3", "smallest_step_s", motion.smallest_step, thesis=smallest, note=exchanged),
        put("tab2.3", "largest_step_s", motion.largest_step, thesis=largest, note=exchanged),
    ]


def _euler_rows(contest: _Contest, case: str, steps: int, column: int) -> list[Row]:
    put, step = partial(contest.row, case), DURATION / steps
    time, _ = _timed(contest.beam, method="implicit_euler", step=step)
    mean, worst = contest.errors_between(method="implicit_euler", step=step)
    return [
        put("tab2.2", "computation_time_s", time, thesis=values.TIMES[contest.model][2][column]),
        put("tab2.2", "mean_error_m", mean, thesis=values.EULER_ACCURACIES[column], note=_BETWEEN),
        put("tab2.2", "largest_error_m", worst, note=_BETWEEN),
        put("tab2.3", "step_s", step, thesis=values.STEPS[contest.model][2][column]),
    ]


def _printed_step_rows(contest: _Contest) -> list[Row]:
    """Errors of implicit Euler at the printed steps, which show that Tab. 2.2 is in metres."""
    rows = []
    for step, audit, accuracy in zip(
        values.STEPS["pcc"][2], values.EULER_ERRORS, values.EULER_ACCURACIES, strict=True
    ):
        put = partial(contest.row, f"implicit_euler, {step:g} s")
        options = {"method": "implicit_euler", "step": step}
        mean, worst = contest.errors(**options)
        between, _ = contest.errors_between(**options)
        note = f"{_OWN} at the steps" + (f"; {_UNEVEN}" * (step == max(values.STEPS["pcc"][2])))
        rows += [
            put("tab2.2", "mean_error_m", mean, audit=audit[0], note=note),
            put("tab2.2", "largest_error_m", worst, audit=audit[1], note=note),
            put("tab2.2", "mean_error_between_m", between, thesis=accuracy, note=_BETWEEN),
        ]
    return rows
