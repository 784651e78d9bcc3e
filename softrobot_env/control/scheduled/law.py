"""Common parts of laws on a table of operating points: files, observables, kernel data."""

from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy import ndarray
from scipy.optimize import nnls

from softrobot_env.compile.kernels import kernel, reference, structure
from softrobot_env.core.artifacts import Arrays, write_arrays
from softrobot_env.core.interfaces import Observation
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap, robot_inputs
from softrobot_env.robots.artifacts import fingerprint, read_artifact

from ..base import Controller, hold_for, usable
from . import operating_points
from .table import Table, row_size
from .timing import Timing, timing_of

#: Rates [1] of the estimates, times the period [s] of the first mode.
_FORCE_RATE, _OFFSET_RATE = 60.0, 120.0

#: Largest share of an estimate that one decision updates.
_AT_ONCE = 0.3

#: Moment [1], over the tension, below which tendons count as antagonists.
_OPPOSED = 1e-6

#: Gains of a law at an operating point, as a function of the point and the directions.
Design = Callable[[operating_points.Equilibrium, ndarray], ndarray]


@structure
class Law(NamedTuple):
    """Robot data for the kernel of a law.

    Attributes:
        table: Its operating points.
        times: (1 + k,) [s]: 0 and the times at which the reference is seen.
        nodes: (c,) [s], see `Timing`.
        period: [s] between decisions.
        first: [s], period of the first mode.
        force, offset: [1], shares of their estimates that a decision updates; 0 without them.
        speed: (m,) [1], largest change of an action in a period.
        stiffness: (m,) [N], tension per action for tendons driven by length, else zeros.
        most: (m,) [N], largest force of servos at rest, beyond the pretension; inf for other
            drives.
        shares: (k, m) [1], share of each tendon of a group in the antagonistic tension, which
            causes no moment and keeps the tendons taut; no groups for robots driven by tension.
        reach: [m], of the robot.
        curved: Share of the first mode's period. Beyond this horizon equilibria are looked up;
            within it, the actions at rest are taken as linear in the displacement of the tip.
        adaptive: Whether to estimate the stiffness.
        planar: Whether the tip can be controlled in the x-z plane only.
    """

    table: Table
    times: ndarray
    nodes: ndarray
    period: float
    first: float
    force: float
    offset: float
    speed: ndarray
    stiffness: ndarray
    most: ndarray
    shares: ndarray
    reach: float
    curved: float
    adaptive: bool
    planar: bool


class ScheduledLaw(Controller):
    """A law on a table of operating points, evaluated in a kernel.

    The current actions are the commanded ones; for a robot driven by length, those that its servos
    have reached, so that nothing winds up where they are too slow.

    Attributes:
        name: Of the policy, and of the file of its table.
        observables: Those it reads, in addition to the current actions.
        curved: See `Law`.
    """

    name: ClassVar[str]
    observables: tuple[str, ...] = ("curvature", "curvature_rate", "tip_position", "reference")
    curved: ClassVar[float] = np.inf

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        gains: Any = None,
        timing: Timing | None = None,
        adaptive: bool = False,
        estimate: bool = True,
    ) -> None:
        """Assemble the data of the kernel.

        Args:
            robot: Nominal robot.
            control_period: [s] between calls.
            gains: File of the table, or a reference to it; by default searched for, see `table`.
            timing: Of the law; by default that of the robot.
            adaptive: Whether to estimate the stiffness.
            estimate: Whether to estimate model errors.

        Raises:
            ValueError: There is no table for this robot, or the law's period is not a multiple of
                the control period.
            FileNotFoundError: No such file.
        """
        table = self.table(robot, gains) if isinstance(gains, str | Path | None) else gains
        timing = timing_of(robot) if timing is None else timing
        self.hold = hold_for(timing.period, control_period, self.name)
        inputs = self._own = robot_inputs(robot)
        self._pulled = robot.drive.kind == "length"
        self._in_force = "tendon_length" if self._pulled else "previous_action"
        others = ("previous_action",) if self._pulled else ()
        self.requires = (*self.observables, self._in_force, *others)
        self.sizes = {
            "curvature": table.n,
            "curvature_rate": table.n,
            self._in_force: inputs.n_inputs,
        }
        directions = table.directions
        stiffness, shares = _taut(robot)
        self._law = reference(
            Law(
                table=table,
                times=np.array((0.0, *timing.knots)),
                nodes=np.array(timing.nodes),
                period=timing.period,
                first=timing.first,
                force=estimate * min(_FORCE_RATE * timing.period / timing.first, _AT_ONCE),
                offset=estimate * min(_OFFSET_RATE * timing.period / timing.first, _AT_ONCE),
                speed=robot.drive.speed * timing.period / inputs.input_scale,
                stiffness=stiffness,
                most=_strongest(robot),
                shares=shares,
                reach=robot.reach,
                curved=self.curved,
                adaptive=adaptive,
                planar=len(directions) == 2 and bool(np.abs(directions[:, 1]).max() < 1e-12),
            )
        )

    @classmethod
    @abstractmethod
    def design(cls, robot: RobotParams) -> Any:
        """A `Design` of the gains; its `count` gives their number."""

    @classmethod
    def table(cls, robot: RobotParams, gains: str | Path | None = None) -> Any:
        """Reference to a robot's table, from a file or from `artifacts.find_artifact`."""
        data = read_artifact(robot, cls.name, gains)
        with data.fitting():
            return read_table(data, cls.design(robot).count)

    def _applied(self, observation: Observation) -> ndarray:
        """The current actions (m,)."""
        found = observation[self._in_force]
        return found / self._own.input_scale if self._pulled else found

    def _check_reference(self, observation: Observation) -> None:
        """Raise ValueError unless the reference and its preview can be used."""
        table, size = self._law.table, observation["reference"].size
        plane = self._law.planar or np.allclose(table.directions[:, 2], 0)
        if size not in (2, 3) or (size == 2 and not plane):
            raise ValueError(
                f"{type(self).__name__} needs references of three coordinates of this robot, not "
                f"{size}: give the task axes='xyz'"
            )
        if observation["tip_position"].size != size:
            raise ValueError("tip_position and reference must have the same coordinates")
        ahead = tuple(self._law.times[1:].tolist())
        previewed = "reference_preview" in self.requires
        if previewed and observation["reference_preview"].size != size * len(ahead):
            raise ValueError(f"{type(self).__name__} needs an environment with preview={ahead}")

    def _seen(self, observation: Observation) -> list[ndarray]:
        """The kernel's inputs as contiguous arrays, and the current actions."""
        seen = (*(observation[name] for name in self.observables), self._applied(observation))
        return [np.ascontiguousarray(value) for value in seen]

    def _begun(self, observation: Observation) -> ndarray:
        """Actions (m,) at the beginning of an episode."""
        return usable(self._applied(observation))


def _strongest(robot: RobotParams) -> ndarray:
    """`most` of a `Law`; the friction of a gear opposes the motor."""
    drive, pretension = robot.drive, robot.of_tendons("pretension")
    if drive.kind == "tension":
        return np.full(robot_inputs(robot).n_inputs, np.inf)
    return np.maximum(drive.force_limit - drive.gear_friction - pretension, 0.0)


def _taut(robot: RobotParams) -> tuple[ndarray, ndarray]:
    """`stiffness` and `shares` of a `Law`."""
    m = robot_inputs(robot).n_inputs
    if robot.drive.kind == "tension":
        return np.zeros(m), np.zeros((0, m))
    stiffness = robot.of_tendons("stiffness") * robot_inputs(robot).input_scale
    moments, shares = TendonMap(robot).phi, []
    for group in np.unique(robot.of_tendons("group")):
        own = (robot.of_tendons("group") == group).astype(float)
        share, left = nnls(np.vstack([moments * own, own]), np.append(np.zeros(len(moments)), 1.0))
        if left < _OPPOSED and np.all(share[own > 0] > 0):
            shares.append(share)
    return stiffness, np.reshape(shares, (len(shares), m))


@kernel
def tighten(law: Law, curvature: ndarray, action: ndarray) -> None:
    """Add antagonistic tension where a tendon would be slacker than its pretension.

    Args:
        law: The law, with data of the tendons.
        curvature: (n,) [1/m].
        action: (m,) [1], modified.
    """
    shares = law.shares
    if len(shares) == 0:
        return
    slack = law.table.moment_arms @ curvature - law.stiffness * action
    for group in range(len(shares)):
        more = 0.0
        for j in range(len(action)):
            if shares[group, j] > 0:
                more = max(more, slack[j] / shares[group, j])
        for j in range(len(action)):
            action[j] += more * shares[group, j] / law.stiffness[j]


@kernel
def strongest(law: Law, curvature: ndarray) -> ndarray:
    """Actions (m,) [1] at which servos reach their force limit, for curvatures (n,)."""
    loose, out = law.table.moment_arms @ curvature, np.full(len(law.most), np.inf)
    for j in range(len(out)):
        if np.isfinite(law.most[j]):
            out[j] = (loose[j] + law.most[j]) / law.stiffness[j]
    return out


@kernel
def in_space(place: ndarray, planar: bool, out: ndarray) -> None:
    """Set out (3,) to a point of two or three coordinates: x, z of a planar robot, x, y of others.

    A missing coordinate is zero.
    """
    if len(place) == 3:
        out[:] = place
        return
    out[0], out[1], out[2] = place[0], place[1], 0.0
    if planar:
        out[1], out[2] = 0.0, place[1]


def build_table(
    robot: RobotParams,
    design: Design,
    points: operating_points.OperatingPoints,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Any:
    """Build a robot's table with the gains of a law, and return a reference to it.

    Args:
        robot: The nominal robot.
        design: Gains (k,) at a point.
        points: Its operating points.
        progress: Called with the numbers of finished and of all steps.
    """
    rows = []
    for done, point in enumerate(points.points):
        rows.append(operating_points.row_of(point, design(point, points.directions)))
        progress(done + 1, len(points.points))
    first = points.points[0]
    moment_arms = np.zeros((len(first.action), len(first.curvature)))
    if robot.drive.kind == "length":
        # A copy has the same memory layout as a table from a file: kernels are compiled for one.
        moment_arms = (first.model.inputs / robot_inputs(robot).input_scale).T.copy()
    return reference(
        Table(
            n=len(first.curvature),
            m=len(first.action),
            tips=np.array([p.tip for p in points.points]),
            to_action=np.array([p.to_action for p in points.points]),
            directions=points.directions,
            moment_arms=moment_arms,
            rows=np.array(rows),
        )
    )


#: Arrays of a table in its file, and their shapes.
_ARRAYS = {
    "tips": (None, 3),
    "to_action": (None, None, 3),
    "directions": (None, 3),
    "moment_arms": (None, None),
    "rows": (None, None),
}


def save_table(path: Path, table: Any, robot: RobotParams, errors: ndarray) -> None:
    """Write the table of a robot with its operating points' errors (points,) [m].

    In single precision, which is more than enough.
    """
    arrays = {name: getattr(table, name).astype(np.float32) for name in _ARRAYS}
    sizes = np.array([table.n, table.m])
    write_arrays(path, {**arrays, "sizes": sizes, **fingerprint(robot), "errors": errors})


def read_table(data: Arrays, count: Callable[[int, int, int], int]) -> Any:
    """Reference to the table that a file holds.

    Args:
        data: Its arrays.
        count: Number of gains of a law at a point, for n curvatures, m actions and k directions.

    Raises:
        ValueError: The file is damaged, or belongs to another law or version.
    """
    data.check_finite()
    data.check_shapes(_ARRAYS | {"sizes": (2,)})
    arrays = {name: np.ascontiguousarray(data[name], dtype=float) for name in _ARRAYS}
    n, m = (int(size) for size in data["sizes"])
    k = len(arrays["directions"])
    if arrays["rows"].shape[1] != row_size(n, m, k) + count(n, m, k):
        raise ValueError(f"{data.path} holds a table of another law or version")
    return reference(Table(n=n, m=m, **arrays))
