"""What is commanded of a robot: from inputs without redundancy to what its drives apply."""

from copy import copy
from dataclasses import replace
from functools import cache, lru_cache
from itertools import pairwise
from math import pi
from typing import Protocol

import numpy as np
from numpy import ndarray
from numpy.linalg import inv, pinv

from softrobot_env.core.arrays import HOST, HostArrays, namespace

from .parameters import RobotParams, Tendon

_ROUNDING = 1e-9
_STEP = 1e-7  # of an action


class Inputs(Protocol):
    """Maps inputs of a robot to what its drives apply, and actions in [-1, 1] to inputs.

    An action a stands for the input `input_centre` + a * `input_scale`.

    Attributes:
        n_inputs: Number of inputs.
        input_scale, input_centre: (n_inputs,).
        unit: Of inputs and of what is applied, "N" or "m".
    """

    n_inputs: int
    input_scale: ndarray
    input_centre: ndarray
    unit: str

    def command(self, inputs: ndarray, out: ndarray | None = None) -> ndarray:
        """What the drives apply, (..., n_tendons), for inputs (..., n_inputs)."""

    def per_action(self, arrays: HostArrays = HOST) -> "Inputs":
        """The same map from actions: its `command` takes actions, `arrays`, in place of inputs."""

    def to_actions(self, inputs: ndarray) -> ndarray:
        """Actions (..., n_inputs) [1] that stand for inputs."""
        return (inputs - self.input_centre) / self.input_scale

    def from_actions(self, actions: ndarray) -> ndarray:
        """Inputs (..., n_inputs) that actions [1] stand for."""
        return self.input_centre + actions * self.input_scale


@lru_cache(maxsize=256)
def robot_inputs(robot: RobotParams) -> Inputs:
    """The inputs of a robot: reduced ones [N] of tensions, or lengths [m] pulled in."""
    return PulledLengths(robot) if robot.drive.kind == "length" else TendonMap(robot)


@cache
def _shifts(count: int) -> ndarray:
    """(2 count, count), a step to either side of each action."""
    return _STEP * np.concatenate([np.eye(count), -np.eye(count)])


def by_action(inputs: Inputs, action: ndarray) -> ndarray:
    """Derivative (n_tendons, m) of what drives apply by actions (m,), for a map `per_action`.

    It is the mean of both sides at a kink, where another tendon begins to pull.
    """
    above, below = np.split(inputs.command(action + _shifts(len(action))), 2)
    return (above - below).T / (2 * _STEP)


def check_inputs(inputs: Inputs, values: ndarray, what: str) -> None:
    """Raise ValueError, beginning with `what`, unless actions can ask for values (n_inputs,)."""
    centre, scale = inputs.input_centre, inputs.input_scale
    if not np.all(np.abs(values - centre) <= scale * (1 + _ROUNDING)):
        raise ValueError(
            f"{what} must lie between {(centre - scale).tolist()} and {(centre + scale).tolist()} "
            f"{inputs.unit}, got {np.asarray(values).tolist()}"
        )


def with_balance(robot: RobotParams) -> RobotParams:
    """The robot with the nearest pretensions of opposing tendons that cancel each other.

    Where the nearest would push, all tendons of the group have about the same; where these would
    push as well, none.
    """
    pretension = robot.of_tendons("pretension")
    for g in sorted({t.group for t in robot.tendons}):
        group = _Group(robot, g, balanced=False)
        if not group.opposed.any():
            continue
        own = pretension[group.members]
        kept = np.eye(len(own)) - pinv(group.phi) @ group.phi
        for near in (own, np.full(len(own), own.mean()), np.zeros(len(own))):
            found = kept @ near
            if found.min() >= 0:
                break
        pretension[group.members] = found
    tendons = zip(robot.tendons, pretension.tolist(), strict=True)
    return replace(robot, tendons=tuple(replace(t, pretension=p) for t, p in tendons))


class PulledLengths(Inputs):
    """Lengths pulled in by each tendon of a robot driven by length, from the straight pose on.

    Full scale is the drive's travel; where it says none, half a turn about the fibre, pi times the
    largest distance of the tendon from it, or `RobotParams.most_pulled` if that is less.
    """

    unit = "m"

    def __init__(self, robot: RobotParams) -> None:
        own = (min(pi * t.farthest, robot.most_pulled(t)) for t in robot.tendons)
        self.input_scale = np.array([robot.drive.travel or scale for scale in own], float)
        self.n_inputs = len(robot.tendons)
        self.input_centre = np.zeros(self.n_inputs)
        self._factor: ndarray | float = 1.0
        self._is_numpy = True

    def command(self, inputs: ndarray, out: ndarray | None = None) -> ndarray:
        """The lengths (..., n_tendons) [m] themselves, a new array unless `out` is given."""
        if self._is_numpy:
            return np.multiply(inputs, self._factor, out=out)
        return inputs * self._factor

    def per_action(self, arrays: HostArrays = HOST) -> "PulledLengths":
        """See `Inputs`."""
        scaled = copy(self)
        scaled._factor = arrays.real(self.input_scale)
        scaled._is_numpy = arrays is HOST
        return scaled


class TendonMap(Inputs):
    """Resolves the actuation redundancy of tendons that oppose each other (secs. 3.1.2, 6.2.2).

    The tendons of one group end at the same station, and their routes differ by a turn about the
    fibre and a factor. Their pull is a bending moment, `phi` @ tension times the group's moment arm
    (the mean distance of its tendons from the fibre): one reduced input where they lie on one line
    through the fibre, positive towards +x (or +y), else two, towards x and y.

    Of all tensions with the same reduced input u the map returns those with the least sum that
    respect the pretension. With v = u / phi on a line one tendon pulls and the others keep their
    pretension, (6.8); around the fibre the two tendons pull between which u points: of three at 120
    degrees these are F = F~ - min F~ + F_pre, F~ = 2/3 Phi^T u (audit of (3.3) to (3.5)). Tensions
    are continuous in u, and never push.

    Tendons of a group that does not surround the fibre, or whose routes differ, are driven one by
    one: their inputs are tensions above the pretension, and the action -1 stands for none.

    Attributes:
        phi: (n_inputs, n_tendons) [1], reduced input u = phi @ tension.
        input_scale, input_centre: (n_inputs,) [N]. A scale is the largest with which no action
            asks for more than a tendon's limit.
        opposed: (n_inputs,) bool, which inputs are not of a single tendon.
    """

    unit = "N"

    def __init__(self, robot: RobotParams) -> None:
        """Raise ValueError where the pretensions of a group do not cancel each other."""
        self.robot = robot
        tendons = robot.tendons
        groups = [_Group(robot, g) for g in sorted({t.group for t in tendons})]
        self.n_inputs = sum(len(group.phi) for group in groups)
        self.phi = np.zeros((self.n_inputs, len(tendons)))
        one, other = (np.zeros((self.n_inputs, len(tendons))) for _ in range(2))
        self._widest = np.zeros(len(tendons), bool)
        self.input_scale, self.input_centre, self.opposed = (
            np.concatenate([getattr(group, name) for group in groups] or [np.zeros(0)])
            for name in ("scale", "centre", "opposed")
        )
        row = 0
        for group in groups:
            where = np.ix_(range(row, row + len(group.phi)), group.members)
            self.phi[where], one[where], other[where] = group.phi, group.one, group.other
            self._widest[group.members] = group.widest
            row += len(group.phi)
        self._one, self._other = one, (None if np.array_equal(one, other) else other)
        self._base = robot.of_tendons("pretension")
        self._pretensioned = bool(self._base.any())
        self._slack = np.zeros_like(self._base)  # an array takes less time than a number
        self._shift: ndarray | None = None
        self._is_numpy = True

    def per_action(self, arrays: HostArrays = HOST) -> "TendonMap":
        """See `Inputs`."""
        scaled = copy(self)
        scaled._one = arrays.real(self._one * self.input_scale[:, None])
        if self._other is not None:
            scaled._other = arrays.real(self._other * self.input_scale[:, None])
        if self.input_centre.any():
            scaled._shift = arrays.real(self.input_centre / self.input_scale)
        scaled._base, scaled._widest = arrays.real(self._base), arrays.flags(self._widest)
        scaled._is_numpy = arrays is HOST
        return scaled

    def tension(self, reduced: ndarray, out: ndarray | None = None) -> ndarray:
        """Tensions (..., n_tendons) [N] >= pretension for reduced inputs (..., n_inputs) [N]."""
        if self._shift is not None:
            reduced = reduced + self._shift
        pulls = reduced.dot(self._one, out) if self._is_numpy else reduced @ self._one
        if self._other is not None:
            beside = reduced.dot(self._other) if self._is_numpy else reduced @ self._other
            kind = namespace(pulls)
            most, least = kind.maximum(pulls, beside), kind.minimum(pulls, beside)
            pulls = kind.where(self._widest, most, least)
        if self._is_numpy:
            out = np.maximum(pulls, self._slack, out=pulls if out is None else out)
        else:
            out = pulls.clip(0.0)
        if self._pretensioned:
            out += self._base
        return out

    command = tension

    def reduced(self, tension: ndarray) -> ndarray:
        """Reduced inputs (..., n_inputs) [N] that tensions (..., n_tendons) [N] produce."""
        return (np.asarray(tension) - self._base) @ self.phi.T

    def require_pairs(self, what: str) -> None:
        """Raise ValueError, naming what does so, if it needs planar pairs of straight tendons."""
        robot = self.robot
        for g in sorted({t.group for t in robot.tendons}):
            pair = [t for t in robot.tendons if t.group == g]
            (x, y), *_ = [t.offset for t in pair]
            mirrored = [t.offset for t in pair] == [(x, y), (-x, y)] and x and not y
            if not (mirrored and all(t.is_straight for t in pair)):
                raise ValueError(
                    f"{what} needs planar tendon groups, each a pair at offsets (r, 0) and "
                    f"(-r, 0), straight; robot {robot.name!r} has {[t.offset for t in pair]}"
                )
            if len({(t.end, t.tension_limit, t.pretension) for t in pair}) > 1:
                raise ValueError(
                    f"{what}: opposing tendons need the same end, tension_limit and pretension, "
                    f"unlike {' and '.join(t.name for t in pair)} of robot {robot.name!r}"
                )


class _Group:
    """The tendons of one group.

    Attributes:
        members: (k,) indices of its tendons.
        phi: (m, k).
        one, other, widest: A tendon's tension above pretension is zero or the smaller of
            one @ u and other @ u, the larger where `widest`.
        scale, centre, opposed: (m,), as of the map.
    """

    def __init__(self, robot: RobotParams, group: int, balanced: bool = True) -> None:
        self.members = [k for k, t in enumerate(robot.tendons) if t.group == group]
        tendons = [robot.tendons[k] for k in self.members]
        self.widest = np.zeros(len(tendons), bool)
        room = np.array([t.tension_limit - t.pretension for t in tendons])
        places = _directions(tendons)
        if not (self._on_a_line(places) or self._around(places)):
            self.phi = self.one = self.other = np.eye(len(tendons))
            self.scale = self.centre = room / 2
            self.opposed = np.zeros(len(tendons), bool)
            return
        idle = self.phi @ [t.pretension for t in tendons]
        if balanced and np.abs(idle).max() > _ROUNDING * sum(t.pretension for t in tendons):
            raise ValueError(
                f"robot {robot.name!r}: the pretensions of the opposing tendons "
                f"{', '.join(t.name for t in tendons)} must cancel each other"
            )
        self.scale = np.full(len(self.phi), self._scale(room))
        self.centre, self.opposed = np.zeros(len(self.phi)), np.ones(len(self.phi), bool)

    def _on_a_line(self, places: ndarray | None) -> bool:
        """Whether the tendons (k, 2) lie on one line through the fibre, on both sides of it."""
        if places is None:
            return False
        far = places[np.argmax(np.hypot(*places.T))]
        line = far / np.hypot(*far)
        line *= 1 if tuple(np.where(np.abs(line) > _ROUNDING, line, 0.0)) > (0.0, 0.0) else -1
        along = places @ line
        beside = np.abs(places - np.outer(along, line)).max()
        if beside > _ROUNDING or not along.max() > _ROUNDING or not along.min() < -_ROUNDING:
            return False
        self.phi = along[None]
        self.one = np.zeros_like(self.phi)
        for best in (np.argmax(along), np.argmin(along)):
            self.one[0, best] = 1 / along[best]
        self.other = self.one
        return True

    def _around(self, places: ndarray | None) -> bool:
        """Whether the tendons (k, 2) surround the fibre; those within the others never pull."""
        hull = [] if places is None else _hull(places)
        turns = [_cross(places[i], places[j]) for i, j in pairwise([*hull, *hull[:1]])]
        if len(hull) < 3 or min(turns) < _ROUNDING:
            return False
        self.phi = places.T
        self.one, self.other = np.zeros((2, 2, len(places)))
        for before, k, after in zip(hull[-1:] + hull, hull, hull[1:] + hull[:1], strict=False):
            self.one[:, k] = inv(places[[before, k]].T)[1]
            self.other[:, k] = inv(places[[k, after]].T)[0]
            self.widest[k] = self.other[:, k] @ places[before] < 0
        return True

    def _scale(self, room: ndarray) -> float:
        """Largest factor on actions in [-1, 1] that leaves all tensions their room [N]."""
        if len(self.phi) == 1:
            farthest = np.array([[1.0], [-1.0]])
        else:  # tensions are linear between the corners and where u points at a tendon
            towards = (self.phi / np.abs(self.phi).max(axis=0)).T
            farthest = np.concatenate((towards, [(1, 1), (1, -1), (-1, 1), (-1, -1)]))
        one, other = farthest @ self.one, farthest @ self.other
        pulls = np.where(self.widest, np.maximum(one, other), np.minimum(one, other))
        return float(1 / np.max(pulls / room))


def _directions(tendons: list[Tendon]) -> ndarray | None:
    """Offsets (k, 2) over their mean distance from the fibre; None unless routes are alike."""
    places = np.array([t.offset for t in tendons])
    distance = np.hypot(*places.T)
    if not np.all(distance > 0) or len({t.end for t in tendons}) > 1:
        return None
    first = tendons[0]
    for tendon, (x, y) in zip(tendons, places, strict=True):
        if len(tendon.knots) != len(first.knots) or tendon.turns != first.turns:
            return None
        shape = (tendon.knots[:, 1:] @ [1, 1j]) / complex(x, y)
        like = (first.knots[:, 1:] @ [1, 1j]) / complex(*first.offset)
        moved = np.abs(tendon.knots[:, 0] - first.knots[:, 0]).max() / first.end
        if max(np.abs(shape - like).max(), moved) > _ROUNDING:
            return None
    return places / distance.mean()


def _cross(a: ndarray, b: ndarray) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _hull(points: ndarray) -> list[int]:
    """Indices of the corners of the convex hull of points (k, 2), counter-clockwise."""
    order = np.lexsort(points.T[::-1]).tolist()
    hull: list[int] = []
    for way in (order, order[::-1]):
        side: list[int] = []
        for k in way:
            while (
                len(side) > 1
                and _cross(points[side[-1]] - points[side[-2]], points[k] - points[side[-1]])
                <= _ROUNDING
            ):
                side.pop()
            side.append(k)
        hull += side[:-1]
    return hull
