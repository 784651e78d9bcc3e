"""Robust regularised least squares, undetermined combinations, and realistic uncertainties.

Residuals along a path are correlated: a model error at one row persists at the next. The effective
number of residuals is that of rows over the integrated correlation time, by which the weight of the
data is reduced.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.linalg import cholesky, eigh, inv, solve
from scipy.stats import t as student_t

from softrobot_env.core.continuation import Damping, descend

from ..errors import centred, size
from .model import Simulated, StaticModel

_STEPS = 25
_LEAST = 1e-4  # relative decrease of the cost at which a search ends
_ROUGH = 3e-3  # for searches whose weights change afterwards
_DAMPING, _RULE = 1e-3, Damping(factor=5, least=1e-7, tries=6)
_OUTLYING = 5.0  # standard deviations beyond which a residual is an outlier
_ROUNDS = 2  # of weights from residuals
_REPEATS = 30  # until a deviation and the number of parameters that it determines agree

#: 95 % of a normal distribution lie within so many standard deviations.
NORMAL_95 = 1.959964

#: Called after each step with its number and RMS [m].
ProgressCallback = Callable[[int, float], None]


@dataclass(frozen=True)
class Weights:
    """Weights of the residuals.

    Attributes:
        scale: [m], beyond which a row has decreasing weight (soft L1).
        deviation: [m], standard deviation of a coordinate for independent rows: larger than the
            true one by the root of their correlation time.
        correlation: Correlation time of residuals, in rows.
    """

    scale: float
    deviation: float
    correlation: float = 1.0


@dataclass(frozen=True)
class Fit:
    """Result of a search.

    Attributes:
        x: (p,) parameters, zero if not free.
        free: (p,) bool.
        simulated: The model's result there.
        weights: Weights of the residuals.
        root: (f, f), root of the prior's covariance of the free parameters, which are root @ white.
        information: (f, f), information of the data about white; that of the prior is the identity.
        covariance: (p, p) of the parameters; that of the prior for those not free.
        steps: Number of steps.
    """

    x: ndarray
    free: ndarray
    simulated: Simulated
    weights: Weights
    root: ndarray
    information: ndarray
    covariance: ndarray
    steps: int

    @property
    def deviation(self) -> ndarray:
        """(p,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))


def correlation_time(error: ndarray, runs: ndarray) -> float:
    """Correlation time of errors (t, k, 3) in rows: 1 + 2 sum of correlations up to the first zero.

    Rows of different runs count as uncorrelated.
    """
    values = np.nan_to_num(centred(error)).reshape(len(error), -1)
    total = float(np.sum(values**2))
    if total == 0 or len(values) < 4:
        return 1.0
    time = 1.0
    for lag in range(1, len(values) // 4 + 1):
        same = runs[lag:] == runs[:-lag]
        share = float(np.sum(values[lag:][same] * values[:-lag][same])) / total
        if share <= 0.05:
            break
        time += 2 * share
    return time


def clustered(
    slopes: ndarray, left: ndarray, normal: ndarray, variance: float, runs: ndarray
) -> ndarray:
    """Covariance of least squares due to noise and to model errors.

    Model errors pull each run in another direction. The scatter of the runs shows their effect:
    N^-1 (sum of g g') N^-1 over the gradients g of w runs (Liang and Zeger, Biometrika 73, 1986),
    times w / (w - 1), and, because runs are few, Student's t of w - 1 over the normal quantile. A
    single run has no scatter: then only the noise is counted.

    Args:
        slopes: (t, ..., p) derivatives of residuals; NaN where unknown.
        left: (t, ...) residuals.
        normal: (p, p) matrix N of the normal equations, a prior's part included.
        variance: Of the residuals, the weight of N.
        runs: (t,) index of each row's run.
    """
    noise = inv(normal)
    pulls = []
    for run in np.unique(runs):
        rows = runs == run
        known = np.isfinite(left[rows]) & np.isfinite(slopes[rows]).all(axis=-1)
        pulls.append(slopes[rows][known].T @ left[rows][known] / variance)
    if (count := len(pulls)) == 1:
        return noise
    scatter = np.array(pulls) - np.mean(pulls, axis=0)
    few = float(student_t.ppf(0.975, count - 1)) / NORMAL_95
    return noise + few**2 * count / (count - 1) * noise @ (scatter.T @ scatter) @ noise


def with_blocks(fit: Fit, blocks: ndarray) -> Fit:
    """A fit whose covariance includes the disagreement of blocks (t,) of rows, see `clustered`."""
    found, weights, by = fit.simulated, fit.weights, np.ix_(fit.free, fit.free)
    square = np.nansum(found.error**2, axis=-1, keepdims=True) / weights.scale**2
    left = found.error / np.sqrt(1 + square)
    normal = inv(fit.covariance[by])
    covariance = fit.covariance.copy()
    covariance[by] = clustered(found.slopes, left, normal, weights.deviation**2, blocks)
    return replace(fit, covariance=covariance)


class _Point(NamedTuple):
    """Parameters (p,), the simulated rows, and their cost."""

    x: ndarray
    simulated: Simulated
    cost: float


def search(
    model: StaticModel,
    x: ndarray,
    free: ndarray,
    weights: Weights,
    *,
    used: ndarray | None = None,
    has_friction: bool = True,
    steps: int = _STEPS,
    least: float = _LEAST,
    show: ProgressCallback | None = None,
) -> Fit:
    """Levenberg-Marquardt method for the robust cost and the prior.

    Args:
        model: The robot.
        x: (p,) start.
        free: (p,) bool, parameters to change.
        weights: Of the rows.
        used: (t,) bool, rows whose markers are used; by default all.
        has_friction: Whether to include friction.
        steps: Largest number of steps.
        least: Relative decrease of the cost at which it ends.
        show: Called after each step.
    """
    prior, by = model.unknowns.prior, np.ix_(free, free)
    root, mean = cholesky(prior[by]), model.unknowns.mean[free]

    def at(x: ndarray) -> _Point:
        found = model.simulate(x, free, has_friction=has_friction)
        away = solve(root, x[free] - mean)
        cost = _data_cost(found, weights, used) + 0.5 * float(np.sum(away**2))
        return _Point(x, found, cost)

    def normal(here: _Point) -> tuple[ndarray, ndarray]:  # in coordinates with a white prior
        information, gradient = _normal(here.simulated, weights, used)
        return root.T @ information @ root, root.T @ gradient

    def steps_from(here: _Point) -> Callable[[float], _Point]:
        white, right = normal(here)
        matrix = white + np.eye(len(root))
        right = right + solve(root, here.x[free] - mean)

        def step(damping: float) -> _Point:
            change = solve(matrix + damping * np.diag(np.diag(matrix)), right)
            there = here.x.copy()
            there[free] -= root @ change
            return at(there)

        return step

    damping, taken, here = _DAMPING, 0, at(x.copy())
    for step in range(steps):
        better, damping = descend(here, steps_from(here), damping, _RULE)
        if better is None:
            break
        gain, here, taken = here.cost - better.cost, better, step + 1
        if show is not None:
            show(taken, size(here.simulated.error))
        if gain < least * here.cost:
            break
    white, _ = normal(here)
    covariance = prior.copy()
    covariance[free] = covariance[:, free] = 0.0
    covariance[by] = root @ inv(white + np.eye(len(root))) @ root.T
    return Fit(here.x, free, here.simulated, weights, root, white, covariance, taken)


def fitted(
    model: StaticModel,
    x: ndarray,
    free: ndarray,
    start: Weights,
    show: ProgressCallback | None = None,
) -> Fit:
    """`search`, with weights from the residuals of a first search."""
    weights, fit = start, None
    for _ in range(_ROUNDS):
        fit = search(model, x if fit is None else fit.x, free, weights, least=_ROUGH, show=show)
        weights = weights_of(fit, model)
    assert fit is not None
    return search(model, fit.x, free, weights, show=show, steps=6, least=1e-3)


def pays(simple: Fit, other: Fit) -> bool:
    """Whether additional parameters are supported by the rows.

    By the Bayesian information criterion: each must reduce the cost by half of the logarithm of the
    number of independent residuals. Both fits use the weights of the simple one.
    """
    weights = simple.weights
    rows = np.isfinite(simple.simulated.error).sum() / weights.correlation
    price = 0.5 * (other.free.sum() - simple.free.sum()) * np.log(rows)
    gain = _data_cost(simple.simulated, weights) - _data_cost(other.simulated, weights)
    return bool(gain > price)


def _data_cost(found: Simulated, weights: Weights, used: ndarray | None = None) -> float:
    """Cost of the residuals: for small ones half of their squares over their variance."""
    square = np.nansum(found.error**2, axis=-1) / weights.scale**2
    if used is not None:
        square = square * used[:, None]
    return float(np.sum(np.sqrt(1 + square) - 1) * (weights.scale / weights.deviation) ** 2)


def weights_of(fit: Fit, model: StaticModel) -> Weights:
    """Weights from the residuals of a fit."""
    error = fit.simulated.error
    known = error[~np.isnan(error)]
    spread = 1.4826 * float(np.median(np.abs(known - np.median(known))))
    near = np.clip(known, -_OUTLYING * spread, _OUTLYING * spread)
    spread = max(spread, 0.5 * float(np.sqrt(np.mean(near**2))), 1e-9)
    # As weighted by the cost: uncorrelated outliers would hide the correlation of the rest.
    far = np.nansum(error**2, axis=-1, keepdims=True) / (2 * spread) ** 2
    time = correlation_time(error / np.sqrt(1 + far), model.recording.runs)
    shared = min(time, len(error) / 2)
    deviation = spread * float(np.sqrt(shared))
    return Weights(2 * spread, _unspoilt(deviation, known.size / shared, fit), time)


def _unspoilt(deviation: float, count: float, fit: Fit) -> float:
    """A deviation of residuals, corrected for the degrees of freedom of their fit.

    The parameters use up as many independent residuals as the data determine (MacKay, Neural
    Computation 4, 1992), which are fewer for a larger deviation: this takes a few rounds.
    """
    told = np.maximum(eigh(fit.information)[0], 0.0) * fit.weights.deviation**2
    square = deviation**2
    for _ in range(_REPEATS):
        taken = float(np.sum(told / (told + square)))
        square = deviation**2 + square * min(taken / count, 1.0)
    return float(np.sqrt(square))


def first_weights(model: StaticModel) -> Weights:
    """Weights before anything is known: a hundredth of the robot's length."""
    least = 0.01 * model.robot.length
    return Weights(2 * least, least)


@dataclass(frozen=True)
class Combination:
    """Parameters that the data determine only in combination, or not at all.

    Attributes:
        information: Of the data over that of the prior: below one the prior dominates.
        parts: Label and change, over the prior's spread, largest first.
    """

    information: float
    parts: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        terms = " ".join(f"{share:+.2f} ({label})" for label, share in self.parts)
        return f"{terms}: information {self.information:.2g} of the prior's"


def combinations(fit: Fit, labels: list[str], most: int = 12) -> list[Combination]:
    """Combinations of free parameters less informed by data than by the prior, least first.

    From the singular values of the derivatives, with parameters in units of the prior.
    """
    values, vectors = eigh(fit.information)
    names = [label for label, free in zip(labels, fit.free, strict=True) if free]
    found = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value >= 1 or len(found) == most:
            break
        vector = fit.root @ vector / np.sqrt(np.sum(fit.root**2, axis=1))
        order = np.argsort(-np.abs(vector))[:6]
        sign = np.sign(vector[order[0]])
        parts = tuple((names[i], float(sign * vector[i])) for i in order if abs(vector[i]) > 0.15)
        found.append(Combination(float(max(value, 0.0)), parts))
    return found


def _normal(found: Simulated, weights: Weights, used: ndarray | None) -> tuple[ndarray, ndarray]:
    """Information (f, f) of the data and gradient (f,) of their cost."""
    square = np.nansum(found.error**2, axis=-1) / weights.scale**2
    weight = 1 / np.sqrt(1 + square)
    if used is not None:
        weight = weight * used[:, None]
    slopes = np.where(np.isnan(found.error)[..., None], 0.0, found.slopes)
    flat = slopes.reshape(-1, slopes.shape[-1])
    weighted = (slopes * weight[..., None, None]).reshape(flat.shape)
    error = np.nan_to_num(found.error).ravel()
    scale = weights.deviation**2
    return flat.T @ weighted / scale, weighted.T @ error / scale
