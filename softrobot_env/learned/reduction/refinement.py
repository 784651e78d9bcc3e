"""Coefficients that predict whole stretches of motion best, not single samples."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.continuation import Damping, descend
from softrobot_env.core.records import Count, Positive, Whole, check_fields

from .model import ReducedModel
from .polynomials import Monomials, sensitivities
from .records import Record, check_alike, delay_vectors

#: Samples of a stretch that tell a step; its cost has all.
_LOOKS = 40

#: Stretches whose equations are added up at once.
_TOGETHER = 20

_DAMPING, _RULE = 1e-6, Damping(least=1e-12, most=1e6)


@dataclass(frozen=True)
class Refinement:
    """How to refine.

    Attributes:
        lengths: [s] of a stretch, stage by stage: short ones guide to where long ones are stable.
        stretches: Their number, sampled from the records.
        iterations: At most, of a stage.
        seed: Of the draw.
        tolerance: Share of the cost whose decrease is too little to go on [1].
    """

    lengths: tuple[Positive, ...] = (0.5, 1.5)
    stretches: Count = 300
    iterations: Count = 8
    seed: Whole = 0
    tolerance: Positive = 1e-3

    def __post_init__(self) -> None:
        check_fields(self, "refinement")


def refine(
    model: ReducedModel,
    records: Sequence[Record],
    settings: Refinement | None = None,
    progress: Callable[[int, int, float], None] | None = None,
) -> ReducedModel:
    """Fit a model's motion to stretches of records by damped Gauss-Newton steps.

    What is minimised is the mean square of the errors of the outputs, now and as long ago as delay
    vectors reach, over stretches that are predicted from their first state and the inputs alone:
    so coordinates keep their meaning. The first states are found too (and eliminated from
    each step), so that noise in them biases nothing.

    Args:
        model: To begin with.
        records: Like those it was learned from.
        settings: How.
        progress: Called with iterations done and in all, and the root mean square of the errors.

    Stretches that the first model loses itself in are left out of a stage.

    Raises:
        ValueError: No record is as long as a stretch, they differ from the model's, or it diverges
            in most of them.
    """
    settings = settings or Refinement()
    check_alike(records)
    total = len(settings.lengths) * settings.iterations

    def show(stage: int, done: int, cost: float) -> None:
        if progress is not None:
            progress(stage * settings.iterations + done, total, float(np.sqrt(cost)))

    for stage, length in enumerate(settings.lengths):
        stretches = _Stretches(model, records, settings, length)
        model = _descend(model, stretches, settings, partial(show, stage))
    return model


class _Tried(NamedTuple):
    """A model, where its stretches start (b, n), and the mean square of its errors."""

    model: ReducedModel
    starts: ndarray
    cost: float


def _descend(
    model: ReducedModel,
    stretches: "_Stretches",
    settings: Refinement,
    show: Callable[[int, float], None],
) -> ReducedModel:
    """The best model of stretches of one length."""

    def stepped(here: _Tried, terms: _NormalEquations, damping: float) -> _Tried:
        change, moves = terms.solve(damping)
        tried = replace(here.model, coefficients=here.model.coefficients + change)
        return _Tried(tried, here.starts + moves, stretches.cost(tried, here.starts + moves))

    damping, starts = _DAMPING, stretches.starts
    here = _Tried(model, starts, stretches.cost(model, starts))
    for iteration in range(settings.iterations):
        terms = stretches.normal_equations(here.model, here.starts)
        moved, damping = descend(here, partial(stepped, here, terms), damping, _RULE)
        before, here = here.cost, moved or here
        show(iteration + 1, here.cost)
        if before - here.cost < settings.tolerance * before:
            break
    return here.model


class _Stretches:
    """Pieces of records of the same length.

    Attributes:
        starts: (b, n) first states, as measured.
    """

    def __init__(
        self, model: ReducedModel, records: Sequence[Record], settings: Refinement, length: float
    ) -> None:
        count = max(2, round(length / model.period))
        need = count + model.delays - 1
        places = [
            (which, first)
            for which, record in enumerate(records)
            for first in range(0, record.samples - need + 1, max(1, count // 4))
        ]
        if not places:
            longest = max(record.samples for record in records)
            raise ValueError(
                f"no record has the {need} samples of a stretch of {length:g} s; the "
                f"longest has {longest}"
            )
        rng = np.random.default_rng(settings.seed)
        if len(places) > settings.stretches:
            chosen = rng.choice(len(places), settings.stretches, replace=False)
            places = [places[i] for i in sorted(chosen)]
        acting = [model.acting(record.inputs) for record in records]
        vectors = [delay_vectors(record.outputs, model.delays) for record in records]
        late = model.delays - 1
        self.starts = np.array([model.encode(vectors[w][f]) for w, f in places])
        self.inputs = np.array([acting[w][f + late : f + late + count] for w, f in places])
        self._seen = _newest_and_oldest(model)
        self.outputs = np.array([vectors[w][f : f + count, self._seen] for w, f in places])
        whole = np.isfinite(self._errors(model, self.starts)).all(axis=(1, 2))
        if 2 * whole.sum() < len(whole):
            raise ValueError(
                f"the model diverges in {len(whole) - whole.sum()} of {len(whole)} stretches of "
                f"{length:g} s: begin with shorter ones"
            )
        self.starts, self.inputs = self.starts[whole], self.inputs[whole]
        self.outputs = self.outputs[whole]

    def cost(self, model: ReducedModel, starts: ndarray) -> float:
        """Mean square of the errors, inf where a stretch diverges."""
        with np.errstate(over="ignore", invalid="ignore"):
            value = float(np.mean(self._errors(model, starts) ** 2))
        return value if np.isfinite(value) else np.inf

    def _errors(self, model: ReducedModel, starts: ndarray) -> ndarray:
        states = model.states(starts, self.inputs)
        with np.errstate(over="ignore", invalid="ignore"):
            return model.vectors(states)[..., self._seen] - self.outputs

    def normal_equations(self, model: ReducedModel, starts: ndarray) -> "_NormalEquations":
        """Of the linearised errors, the starts eliminated."""
        n, terms, length = model.dimension, len(model.powers), self.inputs.shape[1]
        size = n * terms
        matrix, right = np.zeros((size, size)), np.zeros(size)
        states = np.empty((length, n))
        by_start, by_coefficients = np.empty((length, n, n)), np.empty((length, n, n, terms))
        shapes, scale = Monomials(model.shape_powers), model.scale[:n]
        back, looked = [], slice(None, None, max(1, length // _LOOKS))
        parts: list[tuple[ndarray, ndarray]] = []
        for start, inputs, measured in zip(starts, self.inputs, self.outputs, strict=True):
            sensitivities(model.motion, start, inputs, states, by_start, by_coefficients)
            at = states[looked]
            slope = shapes.gradient(at / scale) / scale
            slope = np.einsum("oj,tjn->ton", model.shape[self._seen], slope)
            errors = (measured[looked] - model.vectors(at)[:, self._seen]).ravel()
            first = (slope @ by_start[looked]).reshape(-1, n)
            flat = by_coefficients[looked].reshape(len(at), n, size)
            jacobian = sum(slope[:, :, i, None] * flat[:, i, None, :] for i in range(n))
            jacobian = jacobian.reshape(-1, size)
            q, r = np.linalg.qr(first)
            share, rest = q.T @ jacobian, q.T @ errors
            jacobian -= q @ share
            errors = errors - q @ rest
            parts.append((jacobian, errors))
            back.append((r, share, rest))
            if len(parts) == _TOGETHER or len(back) == len(starts):
                jacobians, errors = (np.concatenate(one) for one in zip(*parts, strict=True))
                matrix = matrix + jacobians.T @ jacobians
                right = right + jacobians.T @ errors
                parts.clear()
        return _NormalEquations(matrix, right, back, (n, terms))


def _newest_and_oldest(model: ReducedModel) -> ndarray:
    """Places of the newest and the oldest outputs in a delay vector."""
    places = np.arange(model.delays * len(model.origin)).reshape(model.delays, -1)
    return places[[0, -1]].ravel()


@dataclass
class _NormalEquations:
    matrix: ndarray
    right: ndarray
    back: list[tuple[ndarray, ndarray, ndarray]]
    shape: tuple[int, int]

    def solve(self, damping: float) -> tuple[ndarray, ndarray]:
        """Steps of the coefficients (n, terms) and of the starts (b, n)."""
        size = len(self.matrix)
        mean = np.trace(self.matrix) / size
        damped = self.matrix + damping * (
            np.diag(np.diag(self.matrix)) + 1e-3 * mean * np.eye(size)
        )
        step = np.linalg.solve(damped, self.right)
        moves = [np.linalg.solve(r, rest - share @ step) for r, share, rest in self.back]
        return step.reshape(self.shape), np.array(moves)
