"""The rows of the accuracy benchmark, and converged limits to compare them with."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

Row = dict[str, Any]

#: Fields of every row; None where they do not apply. See `benchmarks.accuracy.run`.
FIELDS = (
    "kind",
    "case",
    "model",
    "n",
    "timestep",
    "integrator",
    "tolerance",
    "e_mean",
    "e_max",
    "e_time",
    "e_relative",
    "wall_time",
    "step_time",
    "physics",
    "reference",
    "value",
    "limit",
    "met",
)

#: Longest time [s] spent on the repeats of one measurement.
_BUDGET = 2.0


@dataclass(frozen=True)
class Physics:
    """What deforms in a model, which decides what it converges to.

    Attributes:
        name: Name in the report.
        shear_coefficient: k [1], None without shear and extension.
    """

    name: str
    shear_coefficient: float | None


#: Bending and torsion only; with shear and extension; a continuum (in it the shear stress is free,
#: which corresponds to k = 1, and large strains add terms that a rod model has not).
BENDING = Physics("bending", None)
SHEAR = Physics("shear", 0.75)
CONTINUUM = Physics("continuum", 1.0)


@dataclass(frozen=True)
class Limit:
    """A converged solution.

    Attributes:
        tips: (k, d) [m] at instants, or (d,) of an equilibrium.
        uncertainty: [m], distance between its two best estimates.
        text: How it was made.
    """

    tips: np.ndarray
    uncertainty: float
    text: str


def make_row(kind: str, case: str, model: str, n: int | None = None, **values: Any) -> Row:
    """A row with some fields.

    Raises:
        ValueError: A field that rows do not have.
    """
    unknown = values.keys() - set(FIELDS)
    if unknown:
        raise ValueError(f"unknown fields {sorted(unknown)}")
    return dict.fromkeys(FIELDS) | {"kind": kind, "case": case, "model": model, "n": n} | values


def motion_row(
    case: str, model: str, n: int, physics: Physics, truth: Limit, tips: np.ndarray
) -> Row:
    """Mean and largest error of tips (k, d) [m] in motion."""
    error = np.linalg.norm(tips - truth.tips, axis=1)
    return make_row(
        "dynamic",
        case,
        model,
        n,
        e_mean=float(error.mean()),
        e_max=float(error.max()),
        physics=physics.name,
        reference=truth.text,
    )


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance [m] of points (..., d)."""
    return float(np.max(np.linalg.norm(a - b, axis=-1)))


def extrapolate(solve: Callable[[int], np.ndarray], sizes: Sequence[int], text: str) -> Limit:
    """Limit of infinitely many pieces, for an error series in 1 / n^2.

    Neville's scheme on three sizes; its distance to the last estimate without the coarsest one is
    the uncertainty, which belongs to the worse of the two.
    """
    a, b, c = (solve(n) for n in sizes)
    x, y, z = (1 / n**2 for n in sizes)
    first = (x * b - y * a) / (x - y)
    second = (y * c - z * b) / (y - z)
    best = (x * second - z * first) / (x - z)
    uncertainty = distance(best, second)
    text = f"{text}, n = {', '.join(map(str, sizes))}; uncertainty {1e3 * uncertainty:.1g} mm"
    return Limit(best, uncertainty, text)


def least_time(action: Callable[[], Any], repeats: int) -> tuple[float, Any]:
    """Shortest time [s] of some repeats, fewer if they take long, and the last result."""
    best, spent, result = np.inf, 0.0, None
    for _ in range(repeats):
        begin = perf_counter()
        result = action()
        took = perf_counter() - begin
        best, spent = min(best, took), spent + took
        if spent > _BUDGET:
            break
    return best, result
