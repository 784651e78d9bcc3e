"""The rows of the accuracy benchmark, and converged limits to compare them with."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from softrobot_env.benchmarks.records import Record

#: [s] of all motions.
DURATION = 3.0

#: Largest distance of models of equal physics, in robot lengths.
BOUND = 1e-3

#: A run joins a model's best ones if its error is smaller by at least this factor.
_GAIN = 0.85


@dataclass(frozen=True)
class Row(Record):
    """A measurement, or what follows from some; None where a field does not apply.

    Attributes:
        kind: "static", "number" (a frequency or an angle), "dynamic", "agreement" (of limits),
            "physics" (an agreement that is not expected), "goal" or "note".
        case: What was computed.
        model: By what.
        n: Joints or pieces.
        timestep: [s], the mean one where it adapts.
        integrator: Its name.
        tolerance: [1], None where steps are fixed.
        e_mean, e_max: [m], distance of the tips from the truth over a motion.
        e_time: [m], largest distance from the same model with an exact integrator.
        e_relative: [1], error of a number.
        wall_time: [s] of the equilibrium, the eigenvalues or the motion.
        step_time: [s] of a step.
        physics: Name of a `Physics`.
        reference: The truth that was compared with.
        value, limit, met: Of a number its value; of an agreement the distance over the robot's
            length and its bound; of a goal the measured figure and its bound.
    """

    kind: str
    case: str
    model: str
    n: int | None = None
    timestep: float | None = None
    integrator: str | None = None
    tolerance: float | None = None
    e_mean: float | None = None
    e_max: float | None = None
    e_time: float | None = None
    e_relative: float | None = None
    wall_time: float | None = None
    step_time: float | None = None
    physics: str | None = None
    reference: str | None = None
    value: float | None = None
    limit: float | None = None
    met: bool | None = None

    @property
    def family(self) -> str:
        """The model; all hinge rules of the chain are one."""
        return "mujoco_chain" if self.is_chain else self.model

    @property
    def is_chain(self) -> bool:
        """Whether the model is the MuJoCo chain."""
        return self.model.startswith("mujoco_chain/")


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


def static_row(
    case: str, model: str, n: int, physics: Physics, truth: Limit, tip: np.ndarray, **others: Any
) -> Row:
    """Error of a tip (d,) [m] at rest; `others` are further fields."""
    error = distance(tip, truth.tips)
    values = {"e_mean": error, "e_max": error, "physics": physics.name, "reference": truth.text}
    return Row("static", case, model, n, **values, **others)


@dataclass(frozen=True)
class Settings:
    """What a motion was simulated with: see the fields of `Row`."""

    model: str
    n: int
    timestep: float
    integrator: str
    tolerance: float | None = None


def motion_row(
    case: str,
    physics: Physics,
    truth: Limit,
    settings: Settings,
    tips: np.ndarray,
    wall_time: float,
    e_time: float | None = None,
) -> Row:
    """Mean and largest error of tips (k, d) [m] in motion."""
    error = np.linalg.norm(tips - truth.tips, axis=1)
    return Row(
        "dynamic",
        case,
        **vars(settings),
        e_mean=float(error.mean()),
        e_max=float(error.max()),
        e_time=e_time,
        wall_time=wall_time,
        step_time=wall_time * settings.timestep / DURATION,
        physics=physics.name,
        reference=truth.text,
    )


def agreement_row(
    case: str, model: str, n: int | None, gap: float, length: float, physics: str, text: str
) -> Row:
    """How far [m] the limit of a model is from another of its physics, and from the bound."""
    return Row(
        "agreement",
        case,
        model,
        n,
        e_mean=gap,
        e_max=gap,
        physics=physics,
        reference=text,
        value=gap / length,
        limit=BOUND,
        met=gap / length < BOUND,
    )


def front(rows: Iterable[Row], error: str = "e_mean") -> list[Row]:
    """Rows that no faster one beats in an error, by a margin, fastest first."""
    out: list[Row] = []
    for row in sorted(rows, key=lambda row: (row.wall_time, getattr(row, error))):
        if not out or getattr(row, error) < _GAIN * getattr(out[-1], error):
            out.append(row)
    return out


def distance(a: np.ndarray, b: np.ndarray) -> float:
    """Largest distance [m] of points (..., d)."""
    return float(np.max(np.linalg.norm(a - b, axis=-1)))


def extrapolate(solve: Callable[[int], np.ndarray], sizes: Sequence[int], text: str) -> Limit:
    """Limit of infinitely many pieces, for an error series in 1 / n^2.

    Its distance to the last estimate without the coarsest one is
    the uncertainty, which belongs to the worse of the two.
    """
    found = {n: solve(n) for n in sizes}
    best = converged(found, 2)
    second = converged({n: found[n] for n in sizes[1:]}, 2)
    uncertainty = distance(best, second)
    text = f"{text}, n = {', '.join(map(str, sizes))}; uncertainty {1e3 * uncertainty:.1g} mm"
    return Limit(best, uncertainty, text)


def converged(found: Mapping[int, np.ndarray], order: int) -> np.ndarray:
    """Limit of results by number of pieces, for an error series in powers of 1 / n^order."""
    x = [n**-order for n in found]
    weights = [np.prod([b / (b - a) for b in x if b != a]) for a in x]  # Lagrange's, at zero
    return np.tensordot(weights, list(found.values()), 1)


def zero_timestep(tips: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Limits of motions with timesteps h, h/2 and h/4, for an error series in h.

    Returns:
        The best estimate, and the one of the two finer motions alone.
    """
    found = dict(zip((1, 2, 4), tips, strict=True))
    return converged(found, 1), converged({n: found[n] for n in (2, 4)}, 1)
