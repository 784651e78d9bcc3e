"""What decays tell: the rates at which a robot comes to rest, and their change by amplitude."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray
from numpy.linalg import eig, eigvals, inv, lstsq, svd
from scipy.signal import convolve2d

from .model import ReducedModel
from .records import Record, check_alike, delay_vectors

#: Rate of the slowest mode left out over that of the fastest one kept, from which on what is left
#: out is gone before it matters.
SEPARATED = 2.0


@dataclass(frozen=True)
class Spectrum:
    """Modes of a linear model of decays.

    Attributes:
        eigenvalues: (r,) complex [1/s], the slowest first.
        kept: Number of modes in the manifold.
        separation: Decay rate of the slowest mode left out over that of the fastest one kept [1].
        variance: (p,) share of the delay vectors' variance along each principal direction.
    """

    eigenvalues: ndarray
    kept: int
    separation: float
    variance: ndarray

    @property
    def separated(self) -> bool:
        """Whether the modes left out decay at least `SEPARATED` times as fast."""
        return self.separation >= SEPARATED

    def __str__(self) -> str:
        how = "separated" if self.separated else "not separated"
        kept = ", ".join(f"{one.real:.3g}{one.imag:+.3g}i" for one in self.eigenvalues[: self.kept])
        return (
            f"slow modes {kept} 1/s; those left out decay {self.separation:.2g} times as fast: "
            f"{how}"
        )


def spectrum(
    decays: Sequence[Record], delays: int, kept: int, modes: int | None = None
) -> Spectrum:
    """The modes of decays by dynamic mode decomposition (Tu et al., J. Comput. Dyn. 1, 2014).

    Args:
        decays: Motion towards rest, under inputs that do not change.
        delays: Samples in a delay vector.
        kept: Number of modes in the manifold.
        modes: Number of modes to look for; two more than `kept`, for a pair, unless given.

    Raises:
        ValueError: There are none, or fewer delays than the modes need.
    """
    check_alike(decays)
    place = np.mean([record.end for record in decays], axis=0)
    vectors = [delay_vectors(record.outputs - place, delays) for record in decays]
    modes = kept + 2 if modes is None else modes
    if modes > vectors[0].shape[1]:
        raise ValueError(
            f"{modes} modes need delay vectors of {modes} numbers or more, got "
            f"{vectors[0].shape[1]}: raise delays"
        )
    _, values, directions = svd(np.concatenate(vectors), full_matrices=False)
    seen = [one @ directions[:modes].T for one in vectors]
    now, then = (np.concatenate([one[part] for one in seen]) for part in (np.s_[:-1], np.s_[1:]))
    step = lstsq(now, then, rcond=None)[0].T
    with np.errstate(divide="ignore"):
        found = np.log(eigvals(step).astype(complex)) / decays[0].period
    found = found[np.argsort(-found.real)]
    fastest, slowest = -found[kept - 1].real, -found[kept].real if modes > kept else np.inf
    separation = float(slowest / fastest) if fastest > 0 else 0.0
    return Spectrum(found, kept, separation, values**2 / np.sum(values**2))


@dataclass(frozen=True)
class NormalForm:
    """dw/dt = (c_0 + c_1 |w|^2 + c_2 |w|^4 + ...) w, with the outputs in terms of w.

    Attributes:
        coefficients: c (k,) complex [1/s], c_0 the eigenvalue.
        outputs: (o, d + 1, d + 1) complex, of w^j conj(w)^k in the outputs less their origin.
    """

    coefficients: ndarray
    outputs: ndarray

    def decay(self, radius: ndarray) -> ndarray:
        """Rate [1/s] of |w|, at radii |w|."""
        return self._sum(radius).real

    def frequency(self, radius: ndarray) -> ndarray:
        """[rad/s] at radii |w|: the backbone curve."""
        return self._sum(radius).imag

    def _sum(self, radius: ndarray) -> ndarray:
        return np.polynomial.polynomial.polyval(np.square(radius), self.coefficients)

    def amplitude(self, radius: ndarray, points: int = 128) -> ndarray:
        """Half of the way that each output goes in a round at radii (r,): (r, o)."""
        radius = np.atleast_1d(radius)
        w = radius[:, None] * np.exp(2j * np.pi * np.arange(points) / points)
        powers = np.arange(self.outputs.shape[1])
        terms = np.einsum("rtj,rtk->rtjk", w[..., None] ** powers, np.conj(w)[..., None] ** powers)
        way = np.einsum("ojk,rtjk->rto", self.outputs, terms).real
        return (way.max(axis=1) - way.min(axis=1)) / 2


def normal_form(model: ReducedModel, order: int | None = None) -> NormalForm:
    """The normal form of an autonomous model of one oscillation.

    Terms that no change of coordinates removes near an undamped oscillation are kept, those of
    w |w|^2k; the others are removed degree by degree (Haller and Ponsioen 2016, sec. 6).

    Args:
        model: Of two coordinates; its inputs are at rest.
        order: Largest degree, odd; that of its polynomials, at least 3, unless given.

    Raises:
        ValueError: It has other than two coordinates, does not oscillate, or gives samples instead
            of rates of change.
    """
    if model.dimension != 2 or model.substeps == 0:
        raise ValueError(
            "a normal form is of two coordinates and their rates of change (substeps > 0), got "
            f"{model.dimension} coordinates and substeps {model.substeps}"
        )
    linear = model.linear_part()[:, :2]
    values, vectors = eig(linear)
    if not values[0].imag:
        raise ValueError(f"the model does not oscillate: its eigenvalues are {values.tolist()} 1/s")
    if values[0].imag < 0:
        values, vectors = values[::-1], vectors[:, ::-1]
    own = model.powers[:, 2:].sum(axis=1) == 0
    powers, scale = model.powers[own, :2], model.scale[:2]
    degree = order or max(3, int(powers.sum(axis=1).max()) | 1)
    rate = inv(vectors)[0] @ (model.coefficients[:, own] / np.prod(scale**powers, axis=1))
    z = np.zeros((degree + 1, degree + 1), complex)
    z[1, 0] = 1
    kept = [values[0]]
    for d in range(2, degree + 1):
        missing = _polynomial(powers, rate, _coordinates(z, vectors)) - _carried(z, kept)
        for j in range(d + 1):
            k = d - j
            if j == k + 1:
                kept.append(missing[j, k])
            else:
                z[j, k] = missing[j, k] / (j * values[0] + k * np.conj(values[0]) - values[0])
    x = _coordinates(z, vectors)
    shape = model.shape[: len(model.origin)] / np.prod(scale**model.shape_powers, axis=1)
    outputs = [_polynomial(model.shape_powers, row, x) for row in shape]
    return NormalForm(np.array(kept), np.array(outputs))


# Series: sums of c_jk w^j conj(w)^k up to a degree, as arrays c (d + 1, d + 1).


def _coordinates(z: ndarray, vectors: ndarray) -> list[ndarray]:
    """The model's two coordinates, by the series z along the first of its eigenvectors."""
    return [a * z + np.conj(a * z).T for a in vectors[:, 0]]


def _truncated(series: ndarray) -> ndarray:
    """Without what is beyond the degree."""
    j, k = np.indices(series.shape)
    return np.where(j + k < len(series), series, 0)


def _polynomial(powers: ndarray, coefficients: ndarray, values: list[ndarray]) -> ndarray:
    """A polynomial of series (2), by its powers (terms, 2) and coefficients (terms,)."""
    size, total = len(values[0]), np.zeros_like(values[0])
    for row, coefficient in zip(powers, coefficients, strict=True):
        term = np.zeros_like(total)
        term[0, 0] = coefficient
        for value, power in zip(values, row, strict=True):
            for _ in range(power):
                term = _truncated(convolve2d(term, value)[:size, :size])
        total = total + term
    return total


def _carried(z: ndarray, kept: list[complex]) -> ndarray:
    """dz/dt as w moves by the coefficients c that are kept."""
    j, k = np.indices(z.shape)
    out = np.zeros_like(z)
    for power, c in enumerate(kept):
        size = len(z) - power
        out[power:, power:] += (z * (j * c + k * np.conj(c)))[:size, :size]
    return _truncated(out)
