"""Quasi-static visits of the spatial rig: points, lengths and measurements.

Thesis sec. 3.2.2. Points are spread evenly over the workspace; the statics of the nominal rig, one
piece of constant curvature, give the lengths that put its output there with the least tensions
(the set S_red of sec. 3.1.2). The rig visits these lengths in turn and its output is measured.

The visits are commanded and recorded as in any other identification (`excitation`). At 3 s a point,
the 215 points of a network take eleven minutes; the thesis says five.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.registry import VARIANTS, load
from softrobot_env.recordings import Recording
from softrobot_env.robots import RobotParams

from .fit.static_windows import at_rest

#: Number of points, and radius [m] of the disk they fill (audit: usable workspace).
POINTS = 926
RADIUS = 0.121

#: Sum of the tensions [N]. The thesis' rig needs 25.7 N to respect its pretension up to 121 mm.
TOTAL = 26.0

#: Shares of the data to validate and to test with; the rest is for training.
_VALIDATION, _TEST = 0.15, 0.15

_GOLDEN_ANGLE = pi * (3 - sqrt(5))

#: Label of the rows of a recording.
VISIT = "visit"

#: Measures outputs (n, 2) [m] off the axis at lengths (n, 3) [m] pulled in, visited in turn,
#: beginning with the straight rig. Because of friction the order matters, and the rig oscillates
#: for seconds: move slowly from each point to the next, on a straight line in the lengths, and wait
#: for rest before measuring.
Measure = Callable[[ndarray], ndarray]


@dataclass(frozen=True)
class RigData:
    """Measurements of a visit of all points, in its order.

    Attributes:
        lengths: s (n, 3) [m], pulled in.
        measured: z (n, 2) [m].
    """

    lengths: ndarray
    measured: ndarray


@dataclass(frozen=True)
class Split:
    """Indices of the samples for each purpose, in random order."""

    training: ndarray
    validation: ndarray
    test: ndarray


def disk_points(count: int = POINTS, radius: float = RADIUS) -> ndarray:
    """Points (count, 2) [m] that fill a disk evenly: Vogel's sunflower.

    Each stands for the same area: point i is in the middle of the i-th of `count` rings of equal
    area, and the golden angle further round than the one before (Vogel, Mathematical Biosciences
    44 (1979) 179-189).

    Raises:
        ValueError: No points, or no positive radius.
    """
    if count < 1 or not 0 < radius < np.inf:
        raise ValueError(
            f"need one point or more and a positive radius, got {count} and {radius} m"
        )
    i = np.arange(count)
    distance = radius * np.sqrt((i + 0.5) / count)
    angle = _GOLDEN_ANGLE * i
    return np.column_stack([distance * np.cos(angle), distance * np.sin(angle)])


class Visiting(NamedTuple):
    """Functions for robots that can visit points.

    Attributes:
        nominal_lengths: See the function of that name.
        parameters_of: Parameters for controllers, from an identification with networks.
    """

    nominal_lengths: Callable[..., ndarray]
    parameters_of: Callable[..., Any]


def visiting(robot: RobotParams) -> Visiting | None:
    """The `Visiting` of a robot; None if it cannot visit points."""
    found = VARIANTS.find("visits", robot)
    return None if found is None else load(found)


def nominal_lengths(robot: RobotParams, points: ndarray, total: float | None = None) -> ndarray:
    """Lengths (n, n_tendons) [m] that hold the output of a robot at points (n, 2) [m].

    Args:
        robot: The robot.
        points: Target positions of its output.
        total: Sum of the tensions [N] that selects one of the many solutions, as in thesis sec.
            5.1; by default the least tensions that respect the pretension.

    Raises:
        ValueError: A point is out of reach, or the robot cannot visit points.
    """
    known = visiting(robot)
    if known is None:
        raise ValueError(
            f"robot {robot.name!r} cannot visit points: it needs a head and three elastic tendons "
            "in straight channels around it"
        )
    return known.nominal_lengths(robot, points, total)


def collect(
    robot: RobotParams,
    measure: Measure,
    rng: np.random.Generator,
    points: ndarray | None = None,
    total: float | None = None,
) -> RigData:
    """Visit points in random order and measure.

    In the sunflower's own order every point is reached from the same side, as seen from the
    centre, and the network learns the hysteresis of that side as if it were statics.

    Args:
        robot: The nominal rig.
        measure: See `Measure`.
        rng: Source of the order.
        points: (n, 2) [m]; by default `disk_points`.
        total: See `nominal_lengths`.

    Raises:
        OutOfReachError: A point is out of the nominal rig's reach.
        ValueError: See `nominal_lengths`; or the measurement is not finite or not of shape (n, 2).
    """
    wanted = rng.permutation(disk_points() if points is None else points)
    lengths = nominal_lengths(robot, wanted, total)
    measured = np.asarray(measure(lengths), float)
    if measured.shape != wanted.shape or not np.all(np.isfinite(measured)):
        raise ValueError(
            f"measure must return finite outputs of shape {wanted.shape}, got shape "
            f"{measured.shape} with {np.sum(~np.isfinite(measured))} values that are not finite"
        )
    return RigData(lengths, measured)


def split(count: int, rng: np.random.Generator) -> Split:
    """70 % of the samples to train, 15 % each to validate and to test.

    Raises:
        ValueError: Too few samples for one of each.
    """
    validation, test = round(_VALIDATION * count), round(_TEST * count)
    training = count - validation - test
    if min(training, validation, test) < 1:
        raise ValueError(f"cannot split {count} samples 70/15/15; give at least 4")
    return Split(*np.split(rng.permutation(count), [training, training + validation]))


def visits_of(recording: Recording, robot: RobotParams) -> RigData:
    """The measurements of the visits in a recording, see `excitation`.

    Args:
        recording: Of a rig.
        robot: The nominal rig.

    Raises:
        ValueError: There are too few, or the commands do not fit the robot.
    """
    visits = recording.patterns == VISIT
    found = at_rest(recording.part(visits), visits[visits])
    outputs = found.markers[:, -1, :2]
    seen = np.isfinite(outputs).all(axis=1)
    return RigData(found.controls(robot)[seen], outputs[seen])
