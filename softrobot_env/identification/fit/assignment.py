"""Which column of a recording pulls which tendon, with which sign, and the frame's rotation.

A combinatorial search with the simulated robot of the file: for an assignment, the best rotation
about the robot's axis and the best shift follow in closed form, and the remaining error is its
score. The search starts, for each of several rotations, with the assignment that best explains how
the markers move when columns change; from the best of these, columns are swapped until nothing
improves.
"""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, combinations, permutations

import numpy as np
from numpy import ndarray
from numpy.linalg import det, norm, solve, svd
from scipy.optimize import linear_sum_assignment

from softrobot_env.core.processes import chosen_processes
from softrobot_env.recordings import Recording
from softrobot_env.robots import RobotParams

from .model import StaticModel, rotation, turn_vector

_TURNS = 12  # about the axis, tried at first
_KEPT = 3  # assignments that are refined
_ROWS = 160
_SWEEPS = 4
_PIECES = 3
_CLEARLY = 0.8  # largest remaining error, relative, for a change of the header's assignment
_OUTLIERS = 0.1  # share of the markers ignored in fitting a frame

#: An assignment: the tendon of each column, and the sign of each.
_Case = tuple[tuple[int, ...], tuple[float, ...]]

_TOGETHER = 4  # simulated in one job

#: Called with the number of simulated assignments.
ProgressCallback = Callable[[int], None]


@dataclass(frozen=True)
class Assignment:
    """Result of the search.

    Attributes:
        tendons: The robot's tendon of each column.
        signs: Of each column: -1 if it counts length let out.
        turn: [rad], rotation of the recording about the robot's axis.
        rms: [m], remaining error after rotation and shift, for the robot of the file.
        second: [m], of the best other assignment tried.
        tried: Number of assignments simulated.
    """

    tendons: tuple[str, ...]
    signs: tuple[float, ...]
    turn: float
    rms: float
    second: float
    tried: int


def assigned(
    recording: Recording,
    robot: RobotParams,
    show: ProgressCallback | None = None,
    *,
    any_way: bool = False,
) -> Assignment:
    """Find the assignment; in parallel processes if chosen by `processes.using`.

    Args:
        recording: With as many columns of lengths or tensions as the robot has tendons.
        robot: The robot of the file.
        show: Called occasionally.
        any_way: Whether the recording may have any orientation, not only a rotation about the axis.

    Raises:
        ValueError: The numbers of columns and tendons differ, or a marker's x, y or z was not
            measured.
    """
    names = robot.tendon_names
    columns = len(recording.header.commands.columns)
    if columns != len(names):
        raise ValueError(
            f"which tendons the {columns} columns of commands drive is not known, and robot "
            f"{robot.name!r} has {len(names)}: say it by the header's commands.tendons"
        )
    if np.isnan(recording.markers).all(axis=0).any():
        raise ValueError(
            "which tendons the columns drive can only be found from markers with x, y and z; say "
            "it by the header's commands.tendons"
        )
    with chosen_processes() as pool:
        return _Search(recording, robot, any_way, show, pool).best()


def sided(recording: Recording, robot: RobotParams, *, any_way: bool = False) -> tuple[float, ...]:
    """Signs of columns with known tendons: -1 if a column counts length let out.

    A column gets another sign than the rest if that leaves a far smaller error, for the robot of
    the file. Arguments as in `assigned`.
    """
    names = robot.tendon_names
    known = recording.tendons or recording.header.commands.columns
    order = tuple(names.index(name) for name in known)
    return _Search(recording, robot, any_way).sides(order)


def doubted(recording: Recording, robot: RobotParams) -> str | None:
    """A doubt about the header, if another choice for a column fits far better; else None.

    It tries another sign or tendon for a column, and a column without effect.

    Args:
        recording: With known tendons, in the identified frame.
        robot: The identified robot.
    """
    names, columns = robot.tendon_names, recording.header.commands.columns
    order = tuple(names.index(name) for name in recording.tendons or columns)
    (other, signs), share = _Search(recording, robot).other(order)
    if share > _CLEARLY:
        return None
    seems = []
    for column, was, k, sign in zip(columns, order, other, signs, strict=True):
        if sign == 0:
            seems.append(f"column {column} seems to pull nothing")
        elif sign < 0:
            seems.append(f"column {column} seems to count the other way (commands.factors)")
        elif k != was:
            seems.append(f"column {column} seems to pull {names[k]} (commands.tendons)")
    return f"{', '.join(seems)}: friction apart, that would leave {share:.0%} of the error"


def with_tendons(recording: Recording, found: Assignment) -> Recording:
    """The recording with the assignment in its header; its numbers are unchanged."""
    commands = replace(recording.header.commands, tendons=found.tendons)
    return with_signs(recording.with_header(commands=commands), found.signs)


def with_signs(recording: Recording, signs: Sequence[float]) -> Recording:
    """The recording with columns (n,) times signs, in its header and its numbers."""
    commands, signs = recording.header.commands, np.array(signs)
    factors = np.array(commands.factors or (1.0,) * len(commands.columns)) * signs
    commands = replace(commands, factors=tuple(factors.tolist()))
    return replace(recording.with_header(commands=commands), commands=recording.commands * signs)


@dataclass
class _Search:
    recording: Recording
    robot: RobotParams
    any_way: bool = False
    show: ProgressCallback | None = None
    pool: Executor | None = None

    def __post_init__(self) -> None:
        rows = np.unique(np.linspace(0, len(self.recording.times) - 1, _ROWS).astype(int))
        self._part = self.recording.part(rows)
        self._names = self.robot.tendon_names
        self._seen: dict[_Case, tuple[float, float]] = {}

    def best(self) -> Assignment:
        count, signs = len(self._names), self._signs()
        starts = {(order, (sign,) * count) for sign in signs for order in self._first(sign)}
        for start in self._ranked(starts)[:_KEPT]:
            self._improve(*start)
        best = self._least(self._seen)
        for _ in range(count if len(signs) > 1 else 0):
            other = self._least(self._flipped(*best))
            if self._rms(other) > _CLEARLY * self._rms(best):
                break
            self._improve(*other)
            best = self._least(self._seen)
        rms, turn = self._seen[best]
        # Tendons of all sections turned on by their distance are the same in another frame.
        others = [found[0] for found in self._seen.values() if found[0] > rms * (1 + 1e-6)]
        names = tuple(self._names[k] for k in best[0])
        return Assignment(names, best[1], turn, rms, min(others, default=rms), len(self._seen))

    def sides(self, order: tuple[int, ...]) -> tuple[float, ...]:
        """The signs of an order: all alike, but for those that leave a share less by themselves."""
        best, *tried = [(order, (sign,) * len(order)) for sign in self._signs()]
        while tried:
            other = self._least([*tried, *((order, flip) for flip in _flips(best[1]))])
            if self._rms(other) > _CLEARLY * self._rms(best):
                break
            best = other
        return best[1]

    def other(self, order: tuple[int, ...]) -> tuple[_Case, float]:
        """The best case beside an order: a sign or tendon changed, or a column that does nothing.

        And the error that it leaves, over what the order leaves.
        """
        here = (1.0,) * len(order)
        none = [tuple(0.0 if i == k else 1.0 for i in range(len(order))) for k in range(len(order))]
        flips = [] if self.recording.kind == "tension" else _flips(here)
        around: list[_Case] = [(order, signs) for signs in [*flips, *none]]
        around += [(other, here) for other in self._neighbours(order)]
        best = self._least(around)
        return best, self._rms(best) / max(self._rms((order, here)), 1e-12)

    def _flipped(self, order: tuple[int, ...], signs: tuple[float, ...]) -> list[_Case]:
        """One column of another sign, also with its tendon changed for any other."""
        flips, swaps = _flips(signs), permutations(range(len(order)), 2)
        found = [(order, flip) for flip in flips]
        return found + [(_swapped(order, i, j), flips[i]) for i, j in swaps]

    def _signs(self) -> tuple[float, ...]:
        given = self.recording.header.commands.factors is not None
        return (1.0,) if given or self.recording.kind == "tension" else (1.0, -1.0)

    def _first(self, sign: float) -> set[tuple[int, ...]]:
        """Assignments by how markers move when columns change, for many turns of the frame."""
        moved = self._directions() * sign
        size = norm(moved, axis=1)
        way = moved / np.maximum(size, 1e-12)[:, None]
        ends = self.robot.of_tendons("end")
        place = self.robot.of_tendons("offset")
        expected = place / norm(place, axis=1)[:, None]
        rank = np.argsort(np.argsort(-size)) / max(len(size) - 1, 1)
        farther = np.argsort(np.argsort(ends, kind="stable")) / max(len(ends) - 1, 1)
        found = set()
        for turn in 2 * np.pi * np.arange(_TURNS) / _TURNS:
            c, s = np.cos(turn), np.sin(turn)
            turned = way @ np.array([[c, s], [-s, c]])
            for weight in (0.0, 0.5, -0.5):
                cost = 1 - turned @ expected.T + weight * np.abs(rank[:, None] - farther[None, :])
                found.add(tuple(linear_sum_assignment(cost)[1].tolist()))
        return found

    def _directions(self) -> ndarray:
        """(n, 2) how far the last marker moves to the side per column, by changes between rows."""
        tip, commands = self.recording.markers[:, -1], self.recording.commands
        same = ~self.recording.begins[1:]
        change = np.diff(commands, axis=0)[same]
        moved = np.diff(tip, axis=0)[same][:, :2]
        small = np.abs(change).max(axis=1) <= 3 * np.median(np.abs(change).max(axis=1))
        known = small & np.isfinite(moved).all(axis=1)
        change, moved = change[known], moved[known]
        square = change.T @ change
        return solve(
            square + 1e-2 * np.trace(square) / len(square) * np.eye(len(square)), change.T @ moved
        )

    def _improve(self, order: tuple[int, ...], signs: tuple[float, ...]) -> None:
        for _ in range(_SWEEPS):
            best = self._least([(other, signs) for other in self._neighbours(order)])
            if self._rms(best) >= self._rms((order, signs)):
                return
            order = best[0]

    def _neighbours(self, order: tuple[int, ...]) -> list[tuple[int, ...]]:
        """Two columns changed, tendons of one end turned on, or two ends' tendons changed."""
        found = [_swapped(order, i, j) for i, j in combinations(range(len(order)), 2)]
        ends = self.robot.of_tendons("end")
        groups = [np.flatnonzero(ends == end).tolist() for end in np.unique(ends)]
        for group in groups:
            for shift in range(1, len(group)):
                swap = dict(zip(group, group[shift:] + group[:shift], strict=True))
                found.append(tuple(swap.get(k, k) for k in order))
        if len({len(g) for g in groups}) == 1 and len(groups) <= 4:
            for other in permutations(groups):
                swap = dict(zip(chain(*groups), chain(*other), strict=True))
                found.append(tuple(swap[k] for k in order))
        return [one for one in dict.fromkeys(found) if one != order]

    def _rms(self, case: _Case) -> float:
        self._look_at([case])
        return self._seen[case][0]

    def _ranked(self, cases: Iterable[_Case]) -> list[_Case]:
        """Cases by the error that they leave."""
        cases = list(cases)
        self._look_at(cases)
        return sorted(cases, key=self._rms)

    def _least(self, cases: Iterable[_Case]) -> _Case:
        return self._ranked(cases)[0]

    def _look_at(self, cases: Iterable[_Case]) -> None:
        """Simulate what has not been, several at a time if there are processes."""
        new = [case for case in cases if case not in self._seen]
        each, size = (map, 1) if self.pool is None else (self.pool.map, _TOGETHER)
        parts = [new[k : k + size] for k in range(0, len(new), size)]
        simulated = partial(_simulated, self.robot, self._part, self._names, self.any_way)
        for part, found in zip(parts, each(simulated, parts), strict=True):
            self._seen.update(zip(part, found, strict=True))
            if self.show is not None:
                self.show(len(self._seen))


def _swapped(order: tuple[int, ...], i: int, j: int) -> tuple[int, ...]:
    """An order with two of its tendons changed for each other."""
    other = list(order)
    other[i], other[j] = other[j], other[i]
    return tuple(other)


def _flips(signs: tuple[float, ...]) -> list[tuple[float, ...]]:
    """Signs of which one is another."""
    return [tuple(-s if i == k else s for i, s in enumerate(signs)) for k in range(len(signs))]


def _simulated(
    robot: RobotParams,
    recording: Recording,
    names: tuple[str, ...],
    any_way: bool,
    cases: list[_Case],
) -> list[tuple[float, float]]:
    """RMS [m] and turn about z [rad] of assignments, for the robot as its file says."""
    found = []
    for order, signs in cases:
        commands = replace(recording.header.commands, tendons=tuple(names[k] for k in order))
        part = recording.with_header(commands=commands)
        part = replace(part, commands=np.array(signs) * part.commands)
        model = StaticModel(robot, part, pieces=_PIECES)
        moved = model.simulate(np.zeros(len(model.unknowns.spread)), has_friction=False)
        rms, turn, _ = aligned(moved.markers, model.points, any_way)
        found.append((rms, float(turn[2])))
    return found


def aligned(simulated: ndarray, recorded: ndarray, any_way: bool) -> tuple[float, ndarray, ndarray]:
    """How well recorded markers (t, k, 3) [m] fit simulated ones in the frame that fits best.

    A tenth of them that is farthest off does not count for the frame.

    Args:
        simulated, recorded: Markers along the robot's axes.
        any_way: Whether they may be turned in any way, not about z alone.

    Returns:
        RMS [m], and rotation vector (3,) [rad] and shift (3,) [m] of what was recorded. Where a
        coordinate was never measured nothing is turned.
    """
    measured = ~np.isnan(recorded).all(axis=(0, 1))
    known = np.isfinite(recorded[..., measured]).all(axis=-1)
    a, b = simulated[known], np.where(measured, recorded[known], simulated[known])
    used = np.ones(len(a), bool)
    for _ in range(3):
        here, there = a[used].mean(axis=0), b[used].mean(axis=0)
        turn = np.eye(3)
        if measured.all():
            turn = _best_turn(a[used] - here, b[used] - there, any_way)
        left = norm(a - here - (b - there) @ turn.T, axis=1)
        used = left <= np.quantile(left, 1 - _OUTLIERS)
    return float(np.sqrt(np.mean(left**2))), turn_vector(turn), here - turn @ there


def _best_turn(a: ndarray, b: ndarray, any_way: bool) -> ndarray:
    """(3, 3) rotation of b (n, 3) that comes nearest to a (Kabsch), or the best one about z."""
    if not any_way:
        dot = np.sum(a[:, :2] * b[:, :2])
        cross = np.sum(b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])
        return rotation(np.array([0.0, 0.0, np.arctan2(cross, dot)]))
    left, _, right = svd(a.T @ b)
    side = np.sign(det(left @ right))
    return left @ np.diag([1.0, 1.0, side]) @ right
