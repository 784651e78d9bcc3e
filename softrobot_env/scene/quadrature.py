"""Where the hinges of a chain stand, and how much of the beam each one represents.

A chain of rigid links bends at isolated hinges; replacing the distributed curvature by them is a
quadrature rule. Each rule places hinges symmetrically in a piece, at a distance g (in piece
lengths) from its middle, with equal weights. Two errors of second order compete:

* static: the rule integrates a curvature that varies along the piece with error ~ g^2 - 1/12,
  zero for the Gauss points g = 1/sqrt(12);
* geometric: links are chords, and a bent piece of constant curvature comes out too short by
  ~ (1/3 - g) / 4, zero for g = 1/3.

No rule is free of both: the hinges stand for a measure mu of the beam, and the mean square of
mu - s, which stays, is what both errors leave together.

`balanced2` stands between the two, at the fifths of the piece. Without more springs it measured
best for large deflections under distributed load or tip force and in motion, `gauss2` for small
deflections, `chord2` where tendons or moments act alone (`softrobot benchmark accuracy`).
`coupled2` has the hinges of `gauss2` and springs between neighbouring pieces, which take back the
error that is left (`scene.springs`).

Of a piece that tapers, hinges stand for shares of its compliance ds / EI, not of its length: they
are at the Gauss points of that measure, or as much farther from its mean as the rule has them from
those of a uniform piece. Whatever polynomial a moment is of the place, up to degree 2 n - 1 with a
lever arm for n Gauss points, the end of the piece then moves by small bends as that of the beam.
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy import ndarray

from softrobot_env.core.registry import Registry
from softrobot_env.robots.sections import Backbone

#: Hinge offsets from the middle of a piece, in piece lengths, by rule.
RULES = Registry(
    "hinge rule",
    {
        "midpoint": (0.0,),
        "gauss2": (-1 / sqrt(12), 1 / sqrt(12)),
        "balanced2": (-0.3, 0.3),
        "chord2": (-1 / 3, 1 / 3),
        "gauss3": (-sqrt(0.15), 0.0, sqrt(0.15)),
        "coupled2": (-1 / sqrt(12), 1 / sqrt(12)),
    },
)

#: Rules whose pieces are coupled by springs.
_COUPLED = ("coupled2",)

#: Shares of the piece the hinges represent, where they are not equal.
_SHARES = {"gauss3": (5 / 18, 8 / 18, 5 / 18)}

#: Places between which a tapering piece is shared out.
_FINE = 64


@dataclass(frozen=True)
class HingeLayout:
    """Hinges of a chain along the robot.

    Attributes:
        stations: (n,) [m], arc lengths of the hinges, increasing.
        weights: (n,) [m], length of beam each hinge represents; they sum to the robot's length.
        piece: (n,) index of the piece each hinge stands in.
        edges: (pieces + 1,) [m], ends of the pieces.
        coupled: Whether springs couple them (`scene.springs`).
    """

    stations: ndarray
    weights: ndarray
    piece: ndarray
    edges: ndarray
    coupled: bool = False

    @property
    def pieces(self) -> int:
        """Number of pieces."""
        return len(self.edges) - 1

    @property
    def sizes(self) -> ndarray:
        """Lengths (pieces,) [m] of the pieces."""
        return np.diff(self.edges)


def place_hinges(length: float, pieces: int, rule: str) -> HingeLayout:
    """Place the hinges of a robot of `length` [m] cut into equal pieces.

    Raises:
        ValueError: Unknown rule, or a number of pieces that is not a positive whole number.
    """
    if not (pieces >= 1 and pieces % 1 == 0):
        raise ValueError(f"need a whole number of pieces, at least one, got {pieces}")
    return place_between(length / pieces * np.arange(pieces + 1), rule)


def place_between(edges: ndarray, rule: str, backbone: Backbone | None = None) -> HingeLayout:
    """Place the hinges of pieces that end at edges (pieces + 1,) [m]; ValueError as above.

    The pieces are uniform unless a backbone, whose sections end at edges, tapers in some.
    """
    offsets = np.array(RULES.find(rule))
    shares = np.array(_SHARES.get(rule, np.full(len(offsets), 1 / len(offsets))))
    sizes = np.diff(edges)[:, None]
    middles = edges[:-1, None] + sizes / 2
    if backbone is not None and (tapering := backbone.tapers(middles[:, 0])).any():
        offsets, shares = (np.tile(row, (len(sizes), 1)) for row in (offsets, shares))
        for piece in np.flatnonzero(tapering):
            ends = edges[piece : piece + 2]
            offsets[piece], shares[piece] = _by_compliance(backbone, ends, offsets[piece])
    return HingeLayout(
        stations=(middles + sizes * offsets).ravel(),
        weights=(sizes * shares).ravel(),
        piece=np.repeat(np.arange(len(sizes)), offsets.shape[-1]),
        edges=edges,
        coupled=rule in _COUPLED,
    )


def _by_compliance(backbone: Backbone, ends: ndarray, offsets: ndarray) -> tuple[ndarray, ndarray]:
    """Offsets and shares (n,) of the hinges of a piece that tapers between ends (2,) [m].

    From the offsets of the rule in a uniform piece. Shares are of its length: of the parts that
    have the compliances of the hinges.
    """
    count, (start, end) = len(offsets), ends
    size, middle = end - start, (start + end) / 2

    def moments(s: ndarray) -> ndarray:
        powers = np.arange(2 * count)[:, None]
        return ((s - middle) / size) ** powers / backbone.bending(s)

    moment = backbone.integrals(moments, np.linspace(*ends, _FINE)).sum(axis=1)
    moment /= moment[0]
    places = np.arange(count)
    hankel = moment[places[:, None] + places]
    monic = np.linalg.solve(hankel, -moment[count:])
    points = np.sort(np.roots([1.0, *monic[::-1]]).real)
    compliances = np.linalg.solve(points ** places[:, None], moment[:count])
    cuts = _cut_by_compliance(backbone, ends, compliances)
    gauss = np.polynomial.legendre.leggauss(count)[0] / 2
    stretch = offsets[-1] / gauss[-1] if count > 1 else 1.0
    points = moment[1] + stretch * (points - moment[1])
    return points, np.diff((cuts - start) / size, prepend=0.0, append=1.0)


def _cut_by_compliance(backbone: Backbone, ends: ndarray, compliances: ndarray) -> ndarray:
    """Places (n - 1,) [m] between ends that share out the compliance as n numbers are shared."""

    def give(s: ndarray) -> ndarray:
        return 1 / backbone.bending(s)

    fine = np.linspace(*ends, _FINE)
    passed = np.append(0.0, np.cumsum(backbone.integrals(give, fine)))
    wanted = passed[-1] * np.cumsum(compliances)[:-1]
    cuts = np.interp(wanted, passed, fine)
    below = np.searchsorted(fine, cuts) - 1
    beyond = [
        backbone.integrals(give, fine[[k, k + 1]].clip(max=cut))[0]
        for k, cut in zip(below, cuts, strict=True)
    ]
    return cuts + (wanted - passed[below] - beyond) / give(cuts)
