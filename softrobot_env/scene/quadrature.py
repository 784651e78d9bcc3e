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
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy import ndarray

from softrobot_env.core.registry import Registry

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


def place_between(edges: ndarray, rule: str) -> HingeLayout:
    """Place the hinges of pieces that end at edges (pieces + 1,) [m]; ValueError as above."""
    offsets = np.array(RULES.find(rule))
    shares = np.array(_SHARES.get(rule, np.full(len(offsets), 1 / len(offsets))))
    sizes = np.diff(edges)[:, None]
    middles = edges[:-1, None] + sizes / 2
    return HingeLayout(
        stations=(middles + sizes * offsets).ravel(),
        weights=(sizes * shares).ravel(),
        piece=np.repeat(np.arange(len(sizes)), len(offsets)),
        edges=edges,
        coupled=rule in _COUPLED,
    )
