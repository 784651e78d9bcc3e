"""A learned model: where outputs are on the manifold, and how its coordinates move."""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy import ndarray

from softrobot_env.core.artifacts import Arrays

from .polynomials import Monomials, Motion, roll
from .records import Record, delay_vectors


@dataclass(frozen=True)
class Coordinates:
    """Coordinates x (n,) of a manifold, and the inputs that act on them.

    Attributes:
        period: [s] of a sample.
        delays: Number of samples in a delay vector y (p,), p = delays times outputs.
        origin: (o,) outputs at the equilibrium that coordinates are zero at.
        rest: (k,) what the drives are commanded there.
        basis: (k, m) orthonormal, reduced inputs v = basis' (u - rest).
        lag: Samples by which inputs act later than they are commanded.
        tangent: V (p, n) orthonormal, x = V' (y - y of the origin), (3.13).
    """

    period: float
    delays: int
    origin: ndarray
    rest: ndarray
    basis: ndarray
    lag: int
    tangent: ndarray

    @property
    def dimension(self) -> int:
        """n."""
        return self.tangent.shape[1]

    def encode(self, vectors: ndarray) -> ndarray:
        """Coordinates (..., n) of delay vectors (..., p)."""
        return (vectors - np.tile(self.origin, self.delays)) @ self.tangent

    def reduced_inputs(self, inputs: ndarray) -> ndarray:
        """v (..., m) of inputs (..., k)."""
        return (inputs - self.rest) @ self.basis

    def acting(self, inputs: ndarray) -> ndarray:
        """Reduced inputs (t, m) that act at the samples of inputs (t, k), later by the lag."""
        rows = np.maximum(np.arange(len(inputs)) - self.lag, 0)
        return self.reduced_inputs(inputs)[rows]


@dataclass(frozen=True)
class ReducedModel(Coordinates):
    """Coordinates of a manifold, outputs of them, and their motion under inputs.

    Attributes:
        shape_powers: (terms, n) of the monomials of w, (3.14).
        shape: (p, terms), of monomials of x over its scale.
        powers: (terms, n + m) of the monomials of the motion, (3.15) and B u.
        coefficients: (n, terms), of monomials of (x, v) over their scale.
        scale: (n + m,) usual sizes of x and v.
        substeps: Runge-Kutta steps a sample; 0: the polynomials give the next sample's x.
    """

    shape_powers: ndarray
    shape: ndarray
    powers: ndarray
    coefficients: ndarray
    scale: ndarray
    substeps: int

    @cached_property
    def motion(self) -> Motion:
        """How x moves, for the kernels."""
        parents, factors = Monomials(self.powers).chain
        coefficients = np.ascontiguousarray(self.coefficients)
        return Motion(parents, factors, coefficients, self.scale, self.period, self.substeps)

    @cached_property
    def _shapes(self) -> Monomials:
        return Monomials(self.shape_powers)

    def decode(self, x: ndarray) -> ndarray:
        """Outputs (..., o) of coordinates (..., n)."""
        return self.vectors(x)[..., : len(self.origin)]

    def vectors(self, x: ndarray) -> ndarray:
        """Delay vectors w(x) (..., p) of coordinates (..., n)."""
        terms = self._shapes(x / self.scale[: self.dimension])
        with np.errstate(over="ignore", invalid="ignore"):  # a motion may have diverged
            return terms @ self.shape.T + np.tile(self.origin, self.delays)

    def states(self, starts: ndarray, acting: ndarray) -> ndarray:
        """Coordinates (b, t, n) from starts (b, n) on, under reduced inputs (b, t, m) that act."""
        out = np.empty((*acting.shape[:2], self.dimension))
        roll(self.motion, np.ascontiguousarray(starts), np.ascontiguousarray(acting), out)
        return out

    def predict_record(self, record: Record) -> ndarray:
        """Outputs (t - delays + 1, o) of a record, by its first `delays` samples and its inputs.

        Not finite where they diverge.
        """
        first = self.delays - 1
        start = self.encode(delay_vectors(record.outputs[: self.delays], self.delays))
        return self.decode(self.states(start, self.acting(record.inputs)[None, first:])[0])

    def linear_part(self) -> ndarray:
        """(n, n + m) of the motion at the origin, by (x, v): of dx/dt [1/s], or of the next x."""
        linear = np.zeros((self.dimension, len(self.scale)))
        for row, powers in enumerate(self.powers):
            if powers.sum() == 1:
                k = int(np.argmax(powers))
                linear[:, k] = self.coefficients[:, row] / self.scale[k]
        return linear

    def eigenvalues(self) -> ndarray:
        """(n,) complex [1/s] at the origin, the slowest first."""
        values = np.linalg.eigvals(self.linear_part()[:, : self.dimension]).astype(complex)
        if self.substeps == 0:
            with np.errstate(divide="ignore"):
                values = np.log(values) / self.period
        return values[np.argsort(-values.real)]

    def arrays(self) -> dict[str, Any]:
        """What `ReducedModel.read` needs."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @classmethod
    def read(cls, data: Arrays) -> Self:
        """The model of arrays.

        Raises:
            ValueError: One is missing, of another shape, or not finite.
        """
        data.check_finite()
        number = {"period": float, "delays": int, "lag": int, "substeps": int}
        names = [field.name for field in fields(cls)]
        with data.fitting():
            model = cls(**{n: number.get(n, np.asarray)(data[n]) for n in names})
            (inputs, m), n, p = model.basis.shape, model.dimension, model.delays * len(model.origin)
            data.check_shapes(
                {
                    "rest": (inputs,),
                    "tangent": (p, n),
                    "shape_powers": (model.shape.shape[-1], n),
                    "shape": (p, len(model.shape_powers)),
                    "powers": (model.coefficients.shape[-1], n + m),
                    "coefficients": (n, len(model.powers)),
                    "scale": (n + m,),
                }
            )
        if model.period <= 0 or model.delays < 1 or model.lag < 0 or model.substeps < 0:
            raise ValueError(
                f"{data.path}: period and delays must be positive, lag and substeps >= 0"
            )
        return model
