"""Robust regularised least squares, what it leaves open, and honest spreads.

Residuals along a path depend on each other: what the model lacks at one row it lacks at the next.
Their number that counts is that of rows over the integrated correlation time, by which the data's
weight is reduced.
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
_ROUGH = 3e-3  # of searches whose weights change afterwards
_DAMPING, _RULE = 1e-3, Damping(factor=5, least=1e-7, tries=6)
_OUTLYING = 5.0  # standard deviations, beyond which a residual says nothing of the rest
_ROUNDS = 2  # of weights from residuals
_REPEATS = 30  # until a deviation and the parameters determined by it agree

#: 95 % of a normal distribution lie within so many standard deviations.
NORMAL_95 = 1.959964

#: Called after each step with its number and RMS [m].
ProgressCallback = Callable[[int, float], None]


@dataclass(frozen=True)
class Weights:
    """How much residuals count.

    Attributes:
        scale: [m], beyond which a row counts less and less (soft L1).
        deviation: [m], standard deviation of a coordinate, as if rows were independent of each
            other: larger than the true one by the root of their correlation time.
        correlation: Rows that a residual lasts.
    """

    scale: float
    deviation: float
    correlation: float = 1.0


@dataclass(frozen=True)
class Fit:
    """What a search found.

    Attributes:
        x: (p,) parameters, zero where they were not free.
        free: (p,) bool.
        simulated: The model there.
        weights: By which.
        root: (f, f) of the prior's covariance, of free ones: they are root @ white.
        information: (f, f) of the data on white, of which the prior has the identity.
        covariance: (p, p) of the parameters, that of the prior where they were not free.
        steps: It took.
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
    """Rows that errors (t, k, 3) last: 1 + 2 the sum of their correlations, up to the first zero.

    Rows of different runs count as unrelated.
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
    """Covariance of least squares whose model lacks something: of noise, and of what it lacks.

    What the model lacks pulls each run another way. Their scatter shows how much that matters:
    N^-1 (sum of g g') N^-1 over the gradients g of w runs (Liang and Zeger, Biometrika 73, 1986),
    times w / (w - 1), and as runs are few by Student's t of w - 1 over the normal quantile. One
    run scatters nothing: then it is noise alone.

    Args:
        slopes: (t, ..., p) derivatives of residuals; NaN where unknown.
        left: (t, ...) residuals.
        normal: (p, p) matrix N of the normal equations, a prior's part included.
        variance: Of the residuals, by which N is weighted.
        runs: (t,) number of each row's run.
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
    """A fit whose covariance counts how blocks (t,) of rows disagree, see `clustered`."""
    found, weights, by = fit.simulated, fit.weights, np.ix_(fit.free, fit.free)
    square = np.nansum(found.error**2, axis=-1, keepdims=True) / weights.scale**2
    left = found.error / np.sqrt(1 + square)
    normal = inv(fit.covariance[by])
    covariance = fit.covariance.copy()
    covariance[by] = clustered(found.slopes, left, normal, weights.deviation**2, blocks)
    return replace(fit, covariance=covariance)


class _Point(NamedTuple):
    """Parameters (p,), what they make of some rows, and what that costs."""

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
    """Levenberg's and Marquardt's method on the robust cost and the prior.

    Args:
        model: The robot.
        x: (p,) where to begin.
        free: (p,) bool, which to change.
        weights: Of the rows.
        used: (t,) bool, rows whose markers count; all unless given.
        has_friction: Whether friction counts.
        steps: At most.
        least: Relative decrease of the cost at which it ends.
        show: Called after each.
    """
    prior, by = model.unknowns.prior, np.ix_(free, free)
    root, mean = cholesky(prior[by]), model.unknowns.mean[free]

    def at(x: ndarray) -> _Point:
        found = model.simulate(x, free, has_friction=has_friction)
        away = solve(root, x[free] - mean)
        cost = _data_cost(found, weights, used) + 0.5 * float(np.sum(away**2))
        return _Point(x, found, cost)

    def normal(here: _Point) -> tuple[ndarray, ndarray]:  # in coordinates whose prior is white
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
    """`search`, with weights from the residuals of a first one."""
    weights, fit = start, None
    for _ in range(_ROUNDS):
        fit = search(model, x if fit is None else fit.x, free, weights, least=_ROUGH, show=show)
        weights = weights_of(fit, model)
    assert fit is not None
    return search(model, fit.x, free, weights, show=show, steps=6, least=1e-3)


def pays(simple: Fit, other: Fit) -> bool:
    """Whether more parameters explain the rows so much better that they are there.

    By the Bayesian information criterion: each has to lessen the cost by half of the logarithm of
    the number of independent residuals. Both fits count by the weights of the simple one.
    """
    weights = simple.weights
    rows = np.isfinite(simple.simulated.error).sum() / weights.correlation
    price = 0.5 * (other.free.sum() - simple.free.sum()) * np.log(rows)
    gain = _data_cost(simple.simulated, weights) - _data_cost(other.simulated, weights)
    return bool(gain > price)


def _data_cost(found: Simulated, weights: Weights, used: ndarray | None = None) -> float:
    """What the residuals cost: half of their squares over their variance where they are small."""
    square = np.nansum(found.error**2, axis=-1) / weights.scale**2
    if used is not None:
        square = square * used[:, None]
    return float(np.sum(np.sqrt(1 + square) - 1) * (weights.scale / weights.deviation) ** 2)


def weights_of(fit: Fit, model: StaticModel) -> Weights:
    """Weights by the residuals of a fit."""
    error = fit.simulated.error
    known = error[~np.isnan(error)]
    spread = 1.4826 * float(np.median(np.abs(known - np.median(known))))
    near = np.clip(known, -_OUTLYING * spread, _OUTLYING * spread)
    spread = max(spread, 0.5 * float(np.sqrt(np.mean(near**2))), 1e-9)
    # As the cost sees them: outliers depend on nothing and would hide that the rest does.
    far = np.nansum(error**2, axis=-1, keepdims=True) / (2 * spread) ** 2
    time = correlation_time(error / np.sqrt(1 + far), model.recording.runs)
    shared = min(time, len(error) / 2)
    deviation = spread * float(np.sqrt(shared))
    return Weights(2 * spread, _unspoilt(deviation, known.size / shared, fit), time)


def _unspoilt(deviation: float, count: float, fit: Fit) -> float:
    """A deviation of residuals, larger by what their fit took of them.

    Of so many independent residuals the parameters take as many as the data determine (MacKay,
    Neural Computation 4, 1992), which are fewer where the deviation is larger: a few rounds.
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
    """Parameters that the data determine together only, or not at all.

    Attributes:
        information: Of the data over that of the prior: below one it is the prior that speaks.
        parts: Label and change, over the prior's spread, largest first.
    """

    information: float
    parts: tuple[tuple[str, float], ...]

    def __str__(self) -> str:
        terms = " ".join(f"{share:+.2f} ({label})" for label, share in self.parts)
        return f"{terms}: information {self.information:.2g} of the prior's"


def combinations(fit: Fit, labels: list[str], most: int = 12) -> list[Combination]:
    """Combinations of free parameters that the data say less of than the prior, least first.

    By singular values of the slopes, parameters in units of the prior.
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
