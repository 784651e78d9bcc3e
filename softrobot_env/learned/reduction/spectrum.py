"""Rates at which a robot comes to rest, out of recorded decays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softrobot_env.learned.reduction.records import Record, check_alike, delay_vectors

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

    eigenvalues: np.ndarray
    kept: int
    separation: float
    variance: np.ndarray

    @property
    def separated(self) -> bool:
        """Whether the modes left out decay at least `SEPARATED` times as fast."""
        return self.separation >= SEPARATED

    def __str__(self) -> str:
        told = "separated" if self.separated else "not separated"
        kept = ", ".join(f"{one.real:.3g}{one.imag:+.3g}i" for one in self.eigenvalues[: self.kept])
        return (
            f"slow modes {kept} 1/s; those left out decay {self.separation:.2g} times as fast: "
            f"{told}"
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
    place = np.mean([_end(record) for record in decays], axis=0)
    vectors = [delay_vectors(record.outputs - place, delays) for record in decays]
    modes = kept + 2 if modes is None else modes
    if modes > vectors[0].shape[1]:
        raise ValueError(
            f"{modes} modes need delay vectors of {modes} numbers or more, got "
            f"{vectors[0].shape[1]}: raise delays"
        )
    _, values, directions = np.linalg.svd(np.concatenate(vectors), full_matrices=False)
    seen = [one @ directions[:modes].T for one in vectors]
    now, then = (np.concatenate([one[part] for one in seen]) for part in (np.s_[:-1], np.s_[1:]))
    step = np.linalg.lstsq(now, then, rcond=None)[0].T
    with np.errstate(divide="ignore"):
        found = np.log(np.linalg.eigvals(step).astype(complex)) / decays[0].period
    found = found[np.argsort(-found.real)]
    fastest, slowest = -found[kept - 1].real, -found[kept].real if modes > kept else np.inf
    separation = float(slowest / fastest) if fastest > 0 else 0.0
    return Spectrum(found, kept, separation, values**2 / np.sum(values**2))


def _end(record: Record) -> np.ndarray:
    """Where a decay ends: the mean over its last tenth."""
    return record.outputs[-max(1, record.samples // 10) :].mean(axis=0)
