"""Which column of a recording pulls which tendon, to which side, and how the frame is turned.

A combinatorial search over the simulated robot as its file says: for an assignment, the turn about
the robot's axis and the shift that fit best follow in closed form, and what is left judges it.
Begun at every turn with the assignment that fits how the markers move when columns change; from the
best of them columns change places until nothing helps.
"""

from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, permutations

import numpy as np
from scipy.optimize import linear_sum_assignment

from softrobot_env.identification.fit.model import StaticModel
from softrobot_env.processes import chosen_processes
from softrobot_env.recordings import Recording
from softrobot_env.robots import RobotParams

_TURNS = 12  # about the axis, tried at first
_KEPT = 3  # assignments that are improved
_ROWS = 160
_SWEEPS = 4
_PIECES = 3

#: An assignment: the tendon of each column, and the sign of all.
_Case = tuple[tuple[int, ...], float]

_TOGETHER = 4  # simulated in one job

#: Told how many assignments have been simulated.
Show = Callable[[int], None]


@dataclass(frozen=True)
class Assignment:
    """What was found.

    Attributes:
        tendons: The robot's tendon of each column.
        sign: Of all columns: -1 where they count what is let out.
        turn: [rad] of the recording about the robot's axis.
        rms: [m] of what is left, the turn and a shift apart, for the robot as its file says.
        second: [m], of the best other assignment that was tried.
        tried: Number of assignments simulated.
    """

    tendons: tuple[str, ...]
    sign: float
    turn: float
    rms: float
    second: float
    tried: int


def assigned(recording: Recording, robot: RobotParams, show: Show | None = None) -> Assignment:
    """Find the assignment; in processes if they were chosen by `processes.using`.

    Args:
        recording: With as many columns of lengths or tensions as the robot has tendons.
        robot: As its file says.
        show: Told from time to time.

    Raises:
        ValueError: Columns and tendons are not equally many, or a marker's x, y or z was not
            measured.
    """
    names = [t.name for t in robot.tendons]
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
        return _Search(recording, robot, show, pool).best()


def with_tendons(recording: Recording, found: Assignment) -> Recording:
    """The recording with what was found in its header; its numbers are those of the columns."""
    commands = recording.header.commands
    factors = np.array(commands.factors or (1.0,) * len(commands.columns)) * found.sign
    commands = replace(commands, tendons=found.tendons, factors=tuple(factors.tolist()))
    header = replace(recording.header, commands=commands)
    return replace(recording, header=header, commands=recording.commands * found.sign)


class _Search:
    def __init__(
        self,
        recording: Recording,
        robot: RobotParams,
        show: Show | None,
        pool: Executor | None,
    ) -> None:
        self._pool = pool
        rows = np.unique(np.linspace(0, len(recording.times) - 1, _ROWS).astype(int))
        self._whole, self._robot, self._show = recording, robot, show
        self._part = recording.part(rows)
        self._names = [t.name for t in robot.tendons]
        self._seen: dict[_Case, tuple[float, float]] = {}

    def best(self) -> Assignment:
        starts = {(order, sign) for sign in self._signs() for order in self._first(sign)}
        self._look_at(starts)
        ranked = sorted(starts, key=lambda start: self._rms(*start)[0])
        for start in ranked[:_KEPT]:
            self._improve(*start)
        order = sorted(self._seen, key=lambda key: self._seen[key][0])
        columns, sign = order[0]
        rms, turn = self._seen[columns, sign]
        # Tendons of all sections turned on by their distance are the same in another frame.
        others = [found[0] for found in self._seen.values() if found[0] > rms * (1 + 1e-6)]
        names = tuple(self._names[k] for k in columns)
        return Assignment(names, sign, turn, rms, min(others, default=rms), len(self._seen))

    def _signs(self) -> tuple[float, ...]:
        given = self._whole.header.commands.factors is not None
        return (1.0,) if given or self._whole.kind == "tension" else (1.0, -1.0)

    def _first(self, sign: float) -> set[tuple[int, ...]]:
        """Assignments by how markers move when columns change, for many turns of the frame."""
        moved = self._directions() * sign
        size = np.linalg.norm(moved, axis=1)
        way = moved / np.maximum(size, 1e-12)[:, None]
        ends = np.array([t.end for t in self._robot.tendons])
        place = np.array([t.offset for t in self._robot.tendons])
        expected = place / np.linalg.norm(place, axis=1)[:, None]
        rank = np.argsort(np.argsort(-size)) / max(len(size) - 1, 1)
        lever = np.argsort(np.argsort(ends, kind="stable")) / max(len(ends) - 1, 1)
        found = set()
        for turn in 2 * np.pi * np.arange(_TURNS) / _TURNS:
            c, s = np.cos(turn), np.sin(turn)
            turned = way @ np.array([[c, s], [-s, c]])
            for weight in (0.0, 0.5, -0.5):
                cost = 1 - turned @ expected.T + weight * np.abs(rank[:, None] - lever[None, :])
                found.add(tuple(linear_sum_assignment(cost)[1].tolist()))
        return found

    def _directions(self) -> np.ndarray:
        """(n, 2) how far the last marker moves to the side per column, by changes between rows."""
        tip, commands = self._whole.markers[:, -1], self._whole.commands
        same = np.diff(self._whole.runs) == 0
        change = np.diff(commands, axis=0)[same]
        moved = np.diff(tip, axis=0)[same][:, :2]
        small = np.abs(change).max(axis=1) <= 3 * np.median(np.abs(change).max(axis=1))
        known = small & np.isfinite(moved).all(axis=1)
        change, moved = change[known], moved[known]
        square = change.T @ change
        return np.linalg.solve(
            square + 1e-2 * np.trace(square) / len(square) * np.eye(len(square)), change.T @ moved
        )

    def _improve(self, order: tuple[int, ...], sign: float) -> None:
        for _ in range(_SWEEPS):
            before = self._rms(order, sign)[0]
            around = self._neighbours(order)
            self._look_at((other, sign) for other in around)
            best = min(around, key=lambda other: self._rms(other, sign)[0])
            if self._rms(best, sign)[0] >= before:
                return
            order = best

    def _neighbours(self, order: tuple[int, ...]) -> list[tuple[int, ...]]:
        """Two columns changed, tendons of one end turned on, or two ends' tendons changed."""
        found = []
        for i, j in combinations(range(len(order)), 2):
            other = list(order)
            other[i], other[j] = other[j], other[i]
            found.append(tuple(other))
        ends = np.array([t.end for t in self._robot.tendons])
        groups = [np.flatnonzero(ends == end).tolist() for end in np.unique(ends)]
        for group in groups:
            for shift in range(1, len(group)):
                swap = dict(zip(group, group[shift:] + group[:shift], strict=True))
                found.append(tuple(swap.get(k, k) for k in order))
        if len({len(g) for g in groups}) == 1 and len(groups) <= 4:
            for other in permutations(groups):
                swap = {
                    a: b
                    for one, two in zip(groups, other, strict=True)
                    for a, b in zip(one, two, strict=True)
                }
                found.append(tuple(swap[k] for k in order))
        return [one for one in dict.fromkeys(found) if one != order]

    def _rms(self, order: tuple[int, ...], sign: float) -> tuple[float, float]:
        self._look_at([(order, sign)])
        return self._seen[order, sign]

    def _look_at(self, cases: Iterable[_Case]) -> None:
        """Simulate what has not been, several at a time if there are processes."""
        new = [case for case in cases if case not in self._seen]
        each, size = (map, 1) if self._pool is None else (self._pool.map, _TOGETHER)
        parts = [new[k : k + size] for k in range(0, len(new), size)]
        simulated = partial(_simulated, self._robot, self._part, self._names)
        for part, found in zip(parts, each(simulated, parts), strict=True):
            self._seen.update(zip(part, found, strict=True))
            if self._show is not None:
                self._show(len(self._seen))


def _simulated(
    robot: RobotParams, recording: Recording, names: list[str], cases: list[_Case]
) -> list[tuple[float, float]]:
    """RMS [m] and turn [rad] of assignments, for the robot as its file says."""
    found = []
    for order, sign in cases:
        commands = replace(recording.header.commands, tendons=tuple(names[k] for k in order))
        header = replace(recording.header, commands=commands)
        part = replace(recording, header=header, commands=sign * recording.commands)
        model = StaticModel(robot, part, pieces=_PIECES)
        moved = model.simulate(np.zeros(len(model.unknowns.spread)), rubs=False)
        found.append(_aligned(moved.markers, model.points))
    return found


def _aligned(simulated: np.ndarray, recorded: np.ndarray) -> tuple[float, float]:
    """RMS [m] after the best turn about z and shift, and that turn [rad] of what was recorded."""
    known = np.isfinite(recorded).all(axis=-1)
    a, b = simulated[known], recorded[known]
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    dot = np.sum(a[:, :2] * b[:, :2])
    cross = np.sum(b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])
    turn = float(np.arctan2(cross, dot))
    c, s = np.cos(turn), np.sin(turn)
    turned = b.copy()
    turned[:, :2] = b[:, :2] @ np.array([[c, s], [-s, c]])
    return float(np.sqrt(np.mean(np.sum((a - turned) ** 2, axis=-1)))), turn
