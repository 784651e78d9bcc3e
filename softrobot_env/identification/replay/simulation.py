"""A recording's commands, simulated with any robot.

Of a static recording each row is an equilibrium, found from that of the row before: where tendons
rub or servos have play, the end of a slow motion from there. A moving robot
begins each run at rest under the run's first command and is stepped as environments step it:
commands change at the ends of control periods. Rows at equal distances of at most 20 ms are control
periods; of others commands are held on a grid of 5 ms or finer, and markers interpolated.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from math import ceil
from time import process_time

import numpy as np

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.identification.replay.bodies import Body
from softrobot_env.recordings import Recording
from softrobot_env.robots import RobotParams
from softrobot_env.robots.twin import Twin, twin_of

#: Longest control period [s], that of the grid of rows at unequal distances, and the largest
#: difference of equal distances, as a share.
_LONGEST, _GRID, _EQUAL = 0.02, 0.005, 1e-3

_SHOWN = 50  # rows between two reports of progress

#: Called with how many rows are done.
Progress = Callable[[int], None]


@dataclass(frozen=True)
class Replay:
    """A recording and what a simulated robot did under its commands.

    Attributes:
        recording: The recording.
        robot: What was simulated.
        plant: By which model.
        simulated: (t, k, 3) [m], markers in the world; NaN where the simulation failed.
        failures: What went wrong, one line for each failed row or run.
        cpu_time: [s] that the simulation took, compilation included.
    """

    recording: Recording
    robot: RobotParams
    plant: str
    simulated: np.ndarray
    failures: tuple[str, ...]
    cpu_time: float = field(compare=False)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the reader of its errors must know, a line each."""
        if not (self.static and self.robot.has_friction):
            return ()
        return (
            "tendons rub: rows count as ends of slow motions from one to the next; a robot that "
            "sways on its way has less hysteresis",
        )

    @property
    def recorded(self) -> np.ndarray:
        """(t, k, 3) [m], markers in the world."""
        return self.recording.markers

    @property
    def times(self) -> np.ndarray:
        """(t,) [s] of all runs, one after the other."""
        steps = np.diff(self.recording.times, prepend=0.0)
        return np.cumsum(np.maximum(steps, 0.0))

    @property
    def static(self) -> bool:
        """Whether rows are postures at rest."""
        return self.recording.static

    @property
    def title(self) -> str:
        """Robot and model, for people."""
        return f"{self.robot.name}, {self.plant}"

    @cached_property
    def error(self) -> np.ndarray:
        """Simulated less recorded (t, k, 3) [m]; NaN where one of them is unknown."""
        return self.simulated - self.recording.markers

    @cached_property
    def distance(self) -> np.ndarray:
        """Its size (t, k) [m] over the coordinates that were measured."""
        return _size(self.error)

    @cached_property
    def centred(self) -> np.ndarray:
        """The same with the mean error of each marker over all rows removed."""
        return _size(self.error - mean_known(self.error))


def replay(
    recording: Recording,
    robot: RobotParams,
    plant: str = MUJOCO,
    twin: Twin | int | None = None,
    progress: Progress | None = None,
) -> Replay:
    """Simulate the commands of a recording.

    Args:
        recording: The recording; its header says which tendons the commands drive.
        robot: The robot.
        plant: One of `beams.registry.PLANTS`.
        twin: Of a robot driven by length, what is simulated of it; or the seed of one.
        progress: Called from time to time.

    Raises:
        ValueError: The commands do not fit the robot, a marker is off it, or the model lacks what
            the robot has.
    """
    if not recording.header.marker:
        raise ValueError("the recording has no markers: nothing can be compared")
    begun = process_time()
    built, drive = twin_of(robot, twin), recording.drive(robot)
    controls = recording.controls(robot)
    if recording.static:
        # Weights beside the axis twist a robot; environments leave that out, here it is quick.
        body, work = Body(robot, built, plant, drive, _LONGEST, torsion=True), _equilibria
    else:
        body, work = Body(robot, built, plant, drive, control_period(recording)), _motions
    simulated, failures = work(body, recording, controls, progress or _silent)
    used = process_time() - begun
    return Replay(recording, built.robot, plant, simulated, tuple(failures), used)


def mean_known(error: np.ndarray) -> np.ndarray:
    """Mean (k, 3) of errors (t, k, 3) over the rows where they are known; NaN without any."""
    known = ~np.isnan(error)
    count = known.sum(axis=0)
    total = np.where(known, error, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _size(error: np.ndarray) -> np.ndarray:
    known = ~np.isnan(error)
    sizes = np.sqrt(np.sum(np.where(known, error, 0.0) ** 2, axis=-1))
    return np.where(known.any(axis=-1), sizes, np.nan)


def _silent(rows: int) -> None:
    pass


def _equilibria(
    body: Body, recording: Recording, controls: np.ndarray, progress: Progress
) -> tuple[np.ndarray, list[str]]:
    q, found, failures = None, {}, []
    for row, control in enumerate(controls):
        try:
            found[row] = q = body.follow(control, q)
        except EquilibriumError as error:
            q = None
            failures.append(f"row {row + 1}: {error}")
        if row % _SHOWN == 0:
            progress(row)
    markers = recording.header.marker
    simulated = np.full((len(controls), len(markers), 3), np.nan)
    if found:
        simulated[list(found)] = body.markers(np.array(list(found.values())), markers)
    return simulated, failures


def _motions(
    body: Body, recording: Recording, controls: np.ndarray, progress: Progress
) -> tuple[np.ndarray, list[str]]:
    failures = []
    simulated = np.full((len(controls), len(recording.header.marker), 3), np.nan)
    for run in range(int(recording.runs[-1]) + 1):
        rows = np.flatnonzero(recording.runs == run)
        part = recording.part(rows)
        ahead = part.header.commands.in_force == "until"
        try:
            simulated[rows], failure = _motion(body, part, controls[rows], ahead)
        except EquilibriumError as error:
            failure = str(error)
        failures += [] if failure is None else [f"run {run}: {failure}"]
        progress(int(rows[-1]) + 1)
    return simulated, failures


def control_period(recording: Recording) -> float:
    """Control period [s] by which a moving robot's commands are simulated."""
    steps = np.diff(recording.times)[np.diff(recording.runs) == 0]
    if not len(steps):
        return _LONGEST
    step = float(np.median(steps))
    if np.abs(steps - step).max() <= _EQUAL * step:
        return round(step / ceil(step / _LONGEST - _EQUAL), 9)
    return min(step / 2, _GRID)


def _motion(
    body: Body, run: Recording, controls: np.ndarray, ahead: bool
) -> tuple[np.ndarray, str | None]:
    """Markers (t, k, 3) of one run; NaN after a failure, and what failed."""
    periods = max(1, ceil(run.times[-1] / body.period - _EQUAL))
    middle = (np.arange(periods) + 0.5) * body.period
    rows = np.searchsorted(run.times, middle, side="right") - 1 + ahead
    body.begin(controls[0])
    states, failure = [body.q], None
    for row in np.minimum(rows, len(controls) - 1):
        failure = body.advance(controls[row])
        if failure is not None:
            break
        states.append(body.q)
    places = body.markers(np.array(states), run.header.marker)
    reached = body.period * np.arange(len(places))
    simulated = np.full((len(run.times), len(run.header.marker), 3), np.nan)
    known = run.times <= reached[-1] + _EQUAL * body.period
    for k, marker in enumerate(run.header.marker):
        seen = run.times[known] - marker.delay_s
        for axis in range(3):
            simulated[known, k, axis] = np.interp(seen, reached, places[:, k, axis])
    return simulated, failure
