"""From records to a reduced model, by linear least squares."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import numpy as np
from numpy import ndarray
from scipy.linalg import lstsq
from scipy.signal import savgol_filter

from softrobot_env.core.records import Count, Positive, Range, Whole, check_fields

from .model import Coordinates, ReducedModel
from .polynomials import Monomials
from .records import Record, check_alike, delay_vectors

#: Most rows of a regression; of more, evenly spread ones are taken.
_ROWS = 30_000

#: Singular values over the largest, below which directions or terms are not excited.
_STILL, _DEPENDENT = 1e-7, 1e-9

#: Rows for each coefficient of a regression, at least.
_ROWS_PER_TERM = 3

#: Largest growth [1/s] of a mode at rest that errors of the data explain.
_GROWTH = 1e-6


class FitError(ValueError):
    """Data that no model can be learned from; the message says what is missing."""


@dataclass(frozen=True)
class Settings:
    """What kind of model.

    Attributes:
        dimension: n, coordinates of the manifold; None: two for each output, but no more than
            two for each reduced input.
        delays: Samples in a delay vector.
        shape_order: n_w, of the manifold (3.14).
        order: n_r, of the motion (3.15) in the coordinates.
        input_order: Of the motion in the inputs.
        mixed: Whether the motion has products of coordinates and inputs.
        constant: Whether manifold and motion may miss the origin, which then is only near rest.
        staged: Whether the terms without inputs are those of decays alone, as (3.19), (3.22).
        substeps: Runge-Kutta steps a sample of a motion that is fitted on derivatives; 0: it is
            fitted on the next samples.
        inputs: m, reduced inputs; None: as many directions as `input_share` tells.
        input_share: Least deviation of inputs in a direction that counts, of the largest.
        lag: Samples by which inputs act later; None: the best of up to `longest_lag`.
        longest_lag: [s].
        window, degree: Samples and degree of the polynomials that tell derivatives (Savitzky and
            Golay); rate of change is exact for signals of that degree.
        ridge: Weight of the coefficients, over the rows.
    """

    dimension: Count | None = None
    delays: Count = 5
    shape_order: Count = 3
    order: Count = 3
    input_order: Count = 3
    mixed: bool = True
    constant: bool = True
    staged: bool = False
    substeps: Whole = 0
    inputs: Count | None = None
    input_share: Annotated[float, Range("in (0, 1)", lambda x: 0 < x < 1)] = 0.1
    lag: Whole | None = None
    longest_lag: Positive = 0.1
    window: Count = 7
    degree: Count = 4
    ridge: Annotated[float, Range("zero or more", lambda x: 0 <= x < np.inf)] = 1e-9

    def __post_init__(self) -> None:
        check_fields(self, "reduction")
        if self.substeps and not (self.window % 2 and self.degree < self.window):
            raise ValueError(
                f"reduction: window must be odd and larger than degree, got {self.window} and "
                f"{self.degree}"
            )


#: Tab. 3.1: linear motion on a manifold of order three.
THESIS = Settings(
    dimension=4,
    delays=5,
    shape_order=3,
    order=1,
    input_order=1,
    mixed=False,
    constant=False,
    staged=True,
    substeps=1,
    lag=0,
)


def fit(
    decays: Sequence[Record],
    forced: Sequence[Record],
    settings: Settings | None = None,
    origin: ndarray | None = None,
    stable: bool = True,
) -> ReducedModel:
    """Learn a model.

    Args:
        decays: Motion towards rest under inputs that do not change; may be empty.
        forced: Motion under changing inputs; may be empty.
        settings: What kind of model.
        origin: (o,) outputs at rest; found unless given.
        stable: Whether to refuse an unstable model; one that is refined may be judged later, by
            `check_stable`.

    Raises:
        FitError: The data are too few, too short, do not excite what the model has, or what was
            found is unstable; the message says what is missing.
        ValueError: Records differ in columns or period.
    """
    settings = settings or Settings()
    records = [*decays, *forced]
    check_alike(records)
    shortest = max(settings.delays + 2, settings.window + settings.delays)
    for number, record in enumerate(records):
        if record.samples < shortest:
            raise FitError(
                f"record {number} has {record.samples} samples; {shortest} or more are needed for "
                f"{settings.delays} delays"
            )
    found_origin, rest = _rest(decays, forced)
    origin = found_origin if origin is None else np.asarray(origin, float)
    if origin.shape != found_origin.shape:
        raise ValueError(f"origin must have shape {found_origin.shape}, got {origin.shape}")
    basis = _input_basis(forced, rest, settings)
    tangent = _tangent(decays or forced, origin, settings, basis.shape[1])
    lags = [settings.lag or 0]
    if settings.lag is None and basis.shape[1]:
        lags = list(range(round(settings.longest_lag / records[0].period) + 1))
    base = Coordinates(records[0].period, settings.delays, origin, rest, basis, 0, tangent)
    found = [_at_lag(base, decays, forced, settings, lag) for lag in lags]
    model, _ = min(found, key=lambda pair: pair[1])
    if stable:
        check_stable(model, records)
    return model


def _rest(decays: Sequence[Record], forced: Sequence[Record]) -> tuple[ndarray, ndarray]:
    """Outputs and inputs at rest: where decays end, or where forced motion is on average."""
    if decays:
        place = np.mean([record.end for record in decays], axis=0)
        return place, np.mean([record.inputs[-1] for record in decays], axis=0)
    outputs, inputs = (
        np.concatenate([getattr(record, name) for record in forced])
        for name in ("outputs", "inputs")
    )
    return outputs.mean(axis=0), inputs.mean(axis=0)


def _input_basis(forced: Sequence[Record], rest: ndarray, settings: Settings) -> ndarray:
    """Directions (k, m) in which inputs change."""
    if not forced:
        return np.zeros((len(rest), 0))
    values, directions = _principal(np.concatenate([r.inputs for r in forced]) - rest)
    count = settings.inputs or int(np.sum(values > settings.input_share * values[0]))
    if not values[0] > 0 or count > len(values) or not values[count - 1] > _STILL * values[0]:
        raise FitError(
            f"the inputs of the forced records change in "
            f"{int(np.sum(values > _STILL * max(values[0], 1e-300)))} directions, not in "
            f"{max(count, 1)}: excite them all"
        )
    return directions[:count].T


def _tangent(
    records: Sequence[Record], origin: ndarray, settings: Settings, inputs: int
) -> ndarray:
    """V (p, n): the principal directions of delay vectors (thesis sec. 3.3.2)."""
    vectors = [delay_vectors(record.outputs - origin, settings.delays) for record in records]
    values, directions = _principal(np.concatenate(vectors))
    n = settings.dimension or 2 * min(len(origin), inputs or len(origin))
    if n > len(values):
        raise FitError(
            f"{n} coordinates need delay vectors of {n} numbers or more, got {len(values)}: raise "
            "delays"
        )
    if not values[n - 1] > _STILL * values[0]:
        raise FitError(
            f"outputs and their past move in {int(np.sum(values > _STILL * values[0]))} "
            f"directions, not in {n}: excite them all, or choose fewer coordinates"
        )
    return directions[:n].T


def _principal(rows: ndarray) -> tuple[ndarray, ndarray]:
    """Deviations along the principal directions, which are rows, of rows about zero."""
    rows = rows[:: max(1, len(rows) // (4 * _ROWS))]
    _, values, directions = np.linalg.svd(rows, full_matrices=False)
    return values / np.sqrt(len(rows)), directions


class _Samples(NamedTuple):
    """Coordinates, reduced inputs, what their motion is fitted on, and delay vectors, row by row.

    A group of records may be empty: then there are no rows.
    """

    x: ndarray
    v: ndarray
    target: ndarray
    vectors: ndarray

    @staticmethod
    def joined(parts: Sequence["_Samples"]) -> "_Samples":
        """All rows."""
        return _Samples(*(np.concatenate(rows) for rows in zip(*parts, strict=True)))


def _at_lag(
    base: Coordinates,
    decays: Sequence[Record],
    forced: Sequence[Record],
    settings: Settings,
    lag: int,
) -> tuple[ReducedModel, float]:
    """The model with inputs so late, and the mean square that its motion does not explain."""
    base = replace(base, lag=lag)
    quiet, driven = ([_samples(base, settings, one) for one in part] for part in (decays, forced))
    n, m = base.dimension, base.basis.shape[1]
    everything = np.concatenate([one.x for one in (*quiet, *driven)])
    inputs = np.concatenate([one.v for one in (driven or quiet)])
    scale = np.concatenate([3 * everything.std(axis=0), 3 * inputs.std(axis=0)])
    scale[scale == 0] = 1.0
    monomials = Monomials.of(
        n, m, settings.order, settings.input_order if m else 0, settings.mixed, settings.constant
    )
    coefficients, missing = _motion(monomials, quiet, driven, scale, settings)
    shapes = Monomials.of(n, 0, settings.shape_order, constant=settings.constant)
    seen = _Samples.joined(quiet if settings.staged and quiet else quiet + driven)
    off = seen.vectors - np.tile(base.origin, settings.delays)
    shape, _ = _solve(shapes(seen.x / scale[:n]), off, 0.0, "manifold")
    model = ReducedModel(
        **vars(base),
        shape_powers=shapes.powers,
        shape=shape,
        powers=monomials.powers,
        coefficients=coefficients,
        scale=scale,
        substeps=settings.substeps,
    )
    return model, missing


def _motion(
    monomials: Monomials,
    quiet: list[_Samples],
    driven: list[_Samples],
    scale: ndarray,
    settings: Settings,
) -> tuple[ndarray, float]:
    """Coefficients (n, terms) of the motion, and the mean square that they do not explain."""
    n = (quiet or driven)[0].x.shape[1]
    by_inputs = monomials.powers[:, n:].any(axis=1)
    coefficients, missing = np.zeros((n, len(monomials.powers))), 0.0
    stages = [(quiet, ~by_inputs), (driven, by_inputs)] if settings.staged and quiet else []
    for samples, chosen in stages or [(quiet + driven, np.ones_like(by_inputs))]:
        if not samples or not chosen.any():
            continue
        rows = _Samples.joined(samples)
        terms = monomials(np.hstack([rows.x, rows.v]) / scale)
        left = rows.target - terms @ coefficients.T
        coefficients[:, chosen], missing = _solve(terms[:, chosen], left, settings.ridge, "motion")
    return coefficients, missing


def _samples(base: Coordinates, settings: Settings, record: Record) -> _Samples:
    vectors = delay_vectors(record.outputs, settings.delays)
    x = base.encode(vectors)
    v = base.acting(record.inputs)[settings.delays - 1 :]
    if settings.substeps == 0:
        return _Samples(x[:-1], v[:-1], x[1:], vectors[:-1])
    rate = savgol_filter(x, settings.window, settings.degree, deriv=1, delta=record.period, axis=0)
    # Inputs are held between samples: at one, the rate is of what comes before and after.
    middle = (v + np.vstack([v[:1], v[:-1]])) / 2
    inside = slice(settings.window // 2, len(x) - settings.window // 2)
    return _Samples(x[inside], middle[inside], rate[inside], vectors[inside])


def _solve(terms: ndarray, target: ndarray, ridge: float, what: str) -> tuple[ndarray, float]:
    """Coefficients (n, terms), and the mean square that is left."""
    step = max(1, -(-len(terms) // _ROWS))
    terms, target = terms[::step], target[::step]
    count = terms.shape[1]
    if len(terms) < _ROWS_PER_TERM * count:
        raise FitError(
            f"{len(terms)} samples are too few for the {count} terms of the {what}: "
            f"{_ROWS_PER_TERM * count} or more are needed"
        )
    if ridge:
        rows = np.sqrt(ridge * len(terms)) * np.eye(count)
        solution, _, _, values = lstsq(
            np.vstack([terms, rows]), np.vstack([target, np.zeros((count, target.shape[1]))])
        )
        values = np.sqrt(np.maximum(values**2 - ridge * len(terms), 0.0))
    else:
        solution, _, _, values = lstsq(terms, target)
    excited = int(np.sum(values > _DEPENDENT * values[0]))
    if not values[0] > 0 or excited < count:
        raise FitError(
            f"the data tell {excited} of the {count} terms of the {what} apart: excite larger or "
            "more varied motion, or choose lower orders"
        )
    left = target - terms @ solution
    return solution.T, float(np.mean(left**2))


def check_stable(model: ReducedModel, records: Sequence[Record]) -> None:
    """Raise FitError where a model leaves what it was learned from."""
    if not any(record.samples for record in records):
        return
    fastest = model.eigenvalues()[0].real
    if not fastest <= _GROWTH + (1.0 / model.period if model.powers[0].sum() == 0 else 0.0):
        raise FitError(
            f"the model is unstable at rest: a mode grows by {fastest:.3g} 1/s. More, longer or "
            "less noisy decays are needed, or lower orders"
        )
    for number, record in enumerate(records):
        predicted = model.predict_record(record)
        if not np.isfinite(predicted).all():
            raise FitError(
                f"the model is unstable: its prediction of record {number} diverges. Lower orders, "
                "or data all over what is to be predicted, are needed"
            )
