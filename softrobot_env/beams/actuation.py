"""Loads and tendons as arrays for the kernels, and the tension of a tendon."""

from collections.abc import Sequence
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
        guided: (n_tendons,) bool, else the tendon runs in a continuous channel.
        first: (n_tendons + 1,) first point of a guided tendon; that of a channel is empty.
        channel: (n_tendons,) index of a tendon among the channels, -1 if guided.
        channel_offset: (n_channels, 2) [m], at the base.
        channel_end: (n_channels,) [m].
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
    guided: ndarray
    first: ndarray
    channel: ndarray
    channel_offset: ndarray
    channel_end: ndarray
    by_length: bool
    stiffness: ndarray
    pretension: ndarray
    limit: ndarray
    straight: ndarray

    @property
    def n_loads(self) -> int:
        """Number of loads."""
        return len(self.load_follows)


def make_actuation(
    robot: RobotParams, loads: Sequence[Load] = (), drive: str = "tension"
) -> Actuation:
    """Actuation of a robot's tendons and some loads.

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
    channels = [t for t in tendons if not t.guides]
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
        guided=np.array([bool(t.guides) for t in tendons], bool),
        first=np.array(first),
        channel=np.array([-1 if t.guides else channels.index(t) for t in tendons], int),
        channel_offset=np.array([t.offset for t in channels], float).reshape(-1, 2),
        channel_end=np.array([t.end for t in channels], float),
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


def channels_of(robot: RobotParams, actuation: Actuation) -> list[Tendon]:
    """The tendons in channels that an actuation has: all of the robot's, or none."""
    return [t for t in robot.tendons if not t.guides] if len(actuation.channel_end) else []


def channel_samples(channels: Sequence[Tendon], edges: ndarray) -> tuple[ndarray, ndarray, ndarray]:
    """Points for integrals along channels within intervals between edges (k + 1,) [m].

    One in the interval where the place of a channel is constant, else Gauss points.

    Returns:
        Interval and channel (m,), ordered by interval, and weight, x, y [m], x' and y' [1] (m, 5).
    """
    rows = []
    for number, tendon in enumerate(channels):
        cuts = edges if tendon.is_straight else np.union1d(edges, tendon.knots[:, 0])
        cuts = np.append(cuts[cuts < tendon.end], tendon.end)
        cuts = cuts[np.append(True, np.diff(cuts) > _SHORTEST * edges[-1] / len(edges))]
        size, start = np.diff(cuts), cuts[:-1]
        nodes, shares = (np.zeros(1), np.ones(1)) if tendon.is_straight else (_NODES, _SHARES)
        s = ((start + size / 2)[:, None] + size[:, None] * nodes).ravel()
        weight = (size[:, None] * shares).ravel()
        interval = np.searchsorted(edges, s, side="right") - 1
        whose = np.full(len(s), number)
        rows.append(np.column_stack([interval, whose, weight, tendon.at(s), tendon.slope(s)]))
    table = np.concatenate(rows) if rows else np.empty((0, 7))
    table = table[np.argsort(table[:, 0], kind="stable")]
    return table[:, 0].astype(int), table[:, 1].astype(int), np.ascontiguousarray(table[:, 2:])


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
def path_lengths(actuation, points, lengths):
    """Set the lengths (n_tendons,) [m] of the guided tendons through points (n_points, 3)."""
    for k in range(len(actuation.guided)):
        if actuation.guided[k]:
            total = lengths[k] * 0
            for i in range(actuation.first[k], actuation.first[k + 1] - 1):
                span = difference(row3(points, i + 1), row3(points, i))
                total += np.sqrt(dot3(span, span))
            lengths[k] = total


@kernel
def add_path_forces(actuation, points, tension, forces):
    """Add the pull of tensions (n_tendons,) [N] to the forces (n_points, 3) on the guides.

    Between two guides a tendon pulls both towards each other, (2.83) and (2.84).
    """
    for k in range(len(actuation.guided)):
        if actuation.guided[k]:
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
    for k in range(len(actuation.guided)):
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
