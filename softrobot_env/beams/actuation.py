"""Loads and tendons as arrays for the kernels, and the tension of a tendon."""

from collections.abc import Sequence
from itertools import pairwise
from math import isinf
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, structure
from softrobot_env.core.records import check_unique
from softrobot_env.robots import RobotParams, Tendon
from softrobot_env.robots.loads import Load, seen_from_base

from .numerics.quaternions import add_scaled, difference, dot3, row3

#: How tendons can be driven.
DRIVES = ("tension", "length")


@structure
class Actuation(NamedTuple):
    """Where loads and tendons act. Inputs u are those of the tendons, then those of the loads.

    Attributes:
        point_station: (n_points,) [m], arc length of the material points that forces act on:
            one per load, then those of the guided tendons, each from base to end.
        point_offset: (n_points, 2) [m], their place (x, y) in the cross-section.
        load_force, load_moment: (n_loads, 3) [N, N m].
        load_follows: (n_loads,) bool.
        moments, followers: Whether any load has a moment, whether any follows.
        first: (n_tendons + 1,) first point of a guided tendon; one in a continuous channel has
            none.
        sampled: (n_samples,) tendon of a sample, a point of the rod for integrals along a channel.
        sample_size: (n_samples,) [m], its share of the rod.
        by_length: Whether tendons are driven by length.
        stiffness, pretension, limit: (n_tendons,) [N/m, N, N], used when driven by length.
        straight: (n_tendons,) [m], length inside the straight robot.
    """

    point_station: ndarray
    point_offset: ndarray
    load_force: ndarray
    load_moment: ndarray
    load_follows: ndarray
    moments: bool
    followers: bool
    first: ndarray
    sampled: ndarray
    sample_size: ndarray
    by_length: bool
    stiffness: ndarray
    pretension: ndarray
    limit: ndarray
    straight: ndarray

    def reach(self, low: ndarray, high: ndarray) -> int:
        """Largest distance in blocks over which forces on the points couple coordinates.

        Args:
            low, high: (n_points,) first and last of the blocks that move a point; the last comes
                before the first if none does.
        """
        pairs = [i for start, end in pairwise(self.first) for i in range(start, end - 1)]
        following = np.flatnonzero(self.load_follows)
        one, other = np.append(following, pairs), np.append(following, np.add(pairs, 1))
        ends = one.astype(int), other.astype(int)
        spans = np.max([high[x] for x in ends], axis=0) - np.min([low[x] for x in ends], axis=0)
        return int(spans.max(initial=0))


def make_actuation(
    robot: RobotParams, loads: Sequence[Load] = (), drive: str = "tension"
) -> Actuation:
    """Actuation of a robot's tendons and some loads; samples are up to the model.

    Raises:
        ValueError: Unknown drive, a load off the robot, repeated names, or a tendon of infinite
            stiffness driven by length.
    """
    _check(robot, loads, drive)
    return _arrays(robot.tendons, seen_from_base(robot, loads), drive)


def points_only(stations: ndarray, offsets: ndarray | None = None) -> Actuation:
    """Material points (k,) [m] and (k, 2) [m] to be observed, without loads and tendons."""
    stations = np.atleast_1d(np.asarray(stations, float))
    offsets = np.zeros((len(stations), 2)) if offsets is None else np.asarray(offsets, float)
    return _arrays((), (), "tension")._replace(point_station=stations, point_offset=offsets)


def _arrays(tendons: Sequence[Tendon], loads: Sequence[Load], drive: str) -> Actuation:
    points = [(load.station, (0.0, 0.0)) for load in loads]
    first = [len(points)]
    for tendon in tendons:
        if tendon.guides:
            places = tendon.at(np.array(tendon.stations)).tolist()
            points += zip(tendon.stations, places, strict=True)
        first.append(len(points))
    force, moment = _vectors([x.force for x in loads]), _vectors([x.moment for x in loads])
    return Actuation(
        point_station=np.array([s for s, _ in points], float),
        point_offset=np.array([o for _, o in points], float).reshape(-1, 2),
        load_force=force,
        load_moment=moment,
        load_follows=np.array([x.follows for x in loads], bool),
        moments=bool(moment.any()),
        followers=any(x.follows for x in loads),
        first=np.array(first),
        sampled=np.empty(0, int),
        sample_size=np.empty(0),
        by_length=drive == "length",
        stiffness=_values(tendons, "stiffness"),
        pretension=_values(tendons, "pretension"),
        limit=_values(tendons, "tension_limit"),
        straight=_values(tendons, "straight_length"),
    )


#: Gauss points of a channel whose place changes, in each stretch without a via-point.
_NODES, _SHARES = (x / 2 for x in np.polynomial.legendre.leggauss(4))

#: Shortest stretch of a channel, of the mean interval: rounding error of an end at an edge.
_SHORTEST = 1e-9


class ChannelSamples(NamedTuple):
    """Points for integrals along channels, in the order of their stations.

    Attributes:
        tendon: (n_samples,).
        station, size: (n_samples,) [m].
        place: (n_samples, 4), x, y [m], x' and y' [1] of the channel.
    """

    tendon: ndarray
    station: ndarray
    size: ndarray
    place: ndarray


def channel_samples(
    robot: RobotParams, actuation: Actuation, edges: ndarray, straight: ndarray | None = None
) -> ChannelSamples:
    """Samples of the channels that an actuation has: all of the robot's, or none.

    Args:
        robot: The robot.
        actuation: Its actuation, or points only.
        edges: (k + 1,) [m], ends of intervals with Gauss points in each.
        straight: (m + 1,) [m], ends of intervals with a point in the middle of each for channels
            whose place is constant; these have Gauss points as well unless given.
    """
    rows = [np.empty((0, 7))]
    for number, tendon in enumerate(robot.tendons if len(actuation.straight) else ()):
        if tendon.guides:
            continue
        if tendon.is_straight and straight is not None:
            cuts, nodes, shares = straight, np.zeros(1), np.ones(1)
        else:
            cuts, nodes, shares = np.union1d(edges, tendon.knots[:, 0]), _NODES, _SHARES
        cuts = np.append(cuts[cuts < tendon.end], tendon.end)
        cuts = cuts[np.append(True, np.diff(cuts) > _SHORTEST * edges[-1] / len(edges))]
        length, start = np.diff(cuts)[:, None], cuts[:-1, None]
        s = (start + length / 2 + length * nodes).ravel()
        size, whose = (length * shares).ravel(), np.full(len(s), number)
        rows.append(np.column_stack([whose, s, size, tendon.at(s), tendon.slope(s)]))
    table = np.concatenate(rows)
    table = table[np.argsort(table[:, 1], kind="stable")]
    return ChannelSamples(table[:, 0].astype(int), *table[:, 1:3].T.copy(), table[:, 3:].copy())


def _check(robot: RobotParams, loads: Sequence[Load], drive: str) -> None:
    if drive not in DRIVES:
        raise ValueError(f"unknown drive {drive!r}; choose from {', '.join(DRIVES)}")
    check_unique((*robot.tendons, *loads), "tendons and loads")
    for load in loads:
        if not 0 <= load.station <= robot.length * (1 + 1e-12):
            raise ValueError(
                f"load {load.name!r} at {load.station} m is off the robot, 0 to {robot.length} m"
            )
    for tendon in robot.tendons:
        if drive == "length" and isinf(tendon.stiffness):
            raise ValueError(
                f"tendon {tendon.name!r} needs a finite stiffness to be driven by length"
            )


def _vectors(values: list[tuple[float, float, float]]) -> ndarray:
    return np.array(values, float).reshape(-1, 3)


def _values(tendons: Sequence[Tendon], name: str) -> ndarray:
    return np.array([getattr(t, name) for t in tendons], float)


@kernel
def channel_tangent(along, curvature, place):
    """Tangent t + r' + kappa x r of a channel at r = (x, y, 0), in the section's frame.

    Rucker and Webster (IEEE Trans. Robotics 27, 2011).

    Args:
        along, curvature: The rod's tangent t, e_z but for shear and stretch, and kappa [1/m].
        place: (4,) x, y [m], x' and y' [1].
    """
    x, y = place[0], place[1]
    return (
        along[0] + place[2] - curvature[2] * y,
        along[1] + place[3] + curvature[2] * x,
        along[2] + curvature[0] * y - curvature[1] * x,
    )


@kernel
def channel_arm(place, tangent):
    """Moment arm of a channel: its place in the section times its tangent, (x, y, 0) x tangent."""
    x, y = place[0], place[1]
    return y * tangent[2], -x * tangent[2], x * tangent[1] - y * tangent[0]


@kernel
def check_forces(actuation, forces):
    """Raise ValueError unless there is a force for each point."""
    if len(forces) != len(actuation.point_station):
        raise ValueError("forces need as many rows as the model has points")


@kernel
def add_path_lengths(actuation, points, lengths):
    """Add to lengths (n_tendons,) [m] those of the guided ones through points (n_points, 3)."""
    for k in range(len(lengths)):
        for i in range(actuation.first[k], actuation.first[k + 1] - 1):
            span = difference(row3(points, i + 1), row3(points, i))
            lengths[k] += np.sqrt(dot3(span, span))


@kernel
def add_path_forces(actuation, points, tension, forces):
    """Add the pull of tensions (n_tendons,) [N] to the forces (n_points, 3) on the guides.

    Between two guides a tendon pulls both towards each other, (2.83) and (2.84).
    """
    for k in range(len(tension)):
        for i in range(actuation.first[k], actuation.first[k + 1] - 1):
            span = difference(row3(points, i + 1), row3(points, i))
            pull = tension[k] / np.sqrt(dot3(span, span))
            add_scaled(forces, i, pull, span)
            add_scaled(forces, i + 1, -pull, span)


@kernel
def tendon_tensions(actuation, u, lengths, out):
    """Set the tensions (n_tendons,) [N] that inputs cause at tendon lengths (n_tendons,) [m].

    Driven by tension they are the inputs. Driven by length, an input s is the length pulled in:
    F = c (s - s_geo) + F_pre between 0 and the limit, s_geo = straight length - length (audit of
    (2.91) to (2.99)).
    """
    for k in range(len(out)):
        if actuation.by_length:
            pulled = u[k] - actuation.straight[k] + lengths[k]
            force = actuation.pretension[k] + actuation.stiffness[k] * pulled
            if force.real < 0:
                force = force * 0
            elif force.real > actuation.limit[k]:
                force = force * 0 + actuation.limit[k]
            out[k] = force
        else:
            out[k] = u[k]
