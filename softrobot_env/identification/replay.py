"""Simulates a recording's commands with any robot.

In a static recording each row is an equilibrium, found from that of the row before: with friction
of tendons or backlash of servos, it is the end of a slow motion from there. A moving robot begins
each run at rest under the run's first command and is stepped like an environment: commands change
at the ends of control periods. Rows at equal intervals of at most 20 ms are control periods;
otherwise commands are held on a grid of 5 ms or finer, and markers interpolated.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from math import ceil
from time import process_time
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.beams.registry import MUJOCO, BeamPlant
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.envs.reference import own_axes
from softrobot_env.envs.simulation.plants import BeamPlant as BeamSimulations
from softrobot_env.envs.simulation.plants import MujocoPlant
from softrobot_env.recordings import Marker, Recording
from softrobot_env.robots import RobotParams, entry_of
from softrobot_env.robots.twin import Twin, twin_of
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.statics import equilibrium
from softrobot_env.scene.tangent import RubbingForces

from .errors import centred, distances, mean_known

_LET_OUT = 0.02  # of the robot's length, by which tendons are let out to be slack
_STEP, _SHORTEST = 1 / 16, 1 / 1024  # of the way from one command to another


class Body:
    """A robot simulated under controls (n_tendons,) [N] or [m], with its servos.

    Attributes:
        period: [s], of the controls.
    """

    def __init__(
        self,
        robot: RobotParams,
        twin: Twin,
        plant: str,
        drive: str,
        period: float,
        torsion: bool = False,
    ) -> None:
        """Build the model.

        Args:
            robot: The nominal robot.
            twin: The simulated twin; its servos are used if commands are lengths.
            plant: One of `beams.registry.PLANTS`.
            drive: Kind of the controls, "tension" or "length".
            period: [s].
            torsion: Whether a spatial MuJoCo chain twists even if no tendon winds.
        """
        own = self._robot = twin.robot
        self.period = period
        options: dict[str, Any] = {"actuation": drive, "axes": own_axes(own)}
        if plant == MUJOCO:
            if torsion and not robot.is_planar:
                options["torsion"] = True
            if (pieces := entry_of(robot).pieces) is not None:
                options["pieces"] = pieces
            made = MujocoPlant(own, period, **options)
            self._simulation, self._model = made.simulation({}), made.nominal
        else:
            made = BeamSimulations(own, period, BeamPlant(plant), **options)
            self._simulation = made.simulation({})
            self._model = self._simulation.plant.model
        self._servos, self._rubbing, self._by_servos = None, None, False
        pretension = own.of_tendons("pretension")
        self._idle, zero = pretension, np.zeros_like(pretension)
        self._offset = self._slack = self._play = self._horn = zero
        if drive == "length":
            held = pretension / own.of_tendons("stiffness")
            self._idle, self._slack = zero, held + _LET_OUT * own.length
            self._offset, self._by_servos = twin.rest_offset, not own.drive.is_ideal
            if own.drive.gain is None:
                self._play = np.array(twin.backlash) / 2
            self._servos = Servos.of(twin, period)
            self._simulation.drive_by(self._servos)

    def at_rest(self, control: ndarray, guess: ndarray | None = None) -> ndarray:
        """Coordinates in stable equilibrium under controls (n_tendons,).

        Near the guess; else at the end of slowly growing loads; else reached in small steps from
        rest without commands, or with all tendons let out: if only some tendons are slack, the
        loads' path may have a kink at its very beginning.

        Raises:
            EquilibriumError: No equilibrium was found, or only an unstable one.
            ValueError: A control is out of its range.
        """
        rest, idle = self._model.equilibrium, self._idle
        if self._by_servos:
            rest = partial(rest, by_servos=True)
        try:
            return rest(control + self._offset, guess)
        except EquilibriumError:
            try:
                start = rest(idle + self._offset)
            except EquilibriumError:
                idle = idle - self._slack
                start = rest(idle + self._offset)
            return self._by_steps(rest, idle, control, start)

    def follow(self, control: ndarray, before: ndarray | None) -> ndarray:
        """Coordinates at rest after slow motion from the previous ones, with friction and backlash.

        Without previous ones, in the middle of the backlash and without friction. Raises the errors
        of `at_rest`.
        """
        if before is None:
            self._horn = control.copy()
        last = self._horn
        self._horn = np.clip(last, control - self._play, control + self._play)
        if before is None or self._simulation.data is None or not self._robot.has_friction:
            return self.at_rest(self._horn, before)
        model = self._model.model
        if self._rubbing is None:
            self._rubbing = RubbingForces(model, before, self._by_servos)
        rest = partial(equilibrium, model, rubbing=self._rubbing)
        try:
            return rest(self._horn + self._offset, before)
        except EquilibriumError:
            return self._by_steps(rest, last, self._horn, before)

    def _by_steps(
        self, rest: Callable[..., ndarray], begin: ndarray, end: ndarray, q: ndarray
    ) -> ndarray:
        """Coordinates under commands `end`, from q under others in ever smaller steps."""
        share, step = 0.0, _STEP
        while share < 1:
            ahead = min(share + step, 1.0)
            try:
                q, share = rest(self._offset + begin + ahead * (end - begin), q), ahead
            except EquilibriumError:
                step /= 2
                if step < _SHORTEST:
                    raise
        return q

    def begin(self, control: ndarray) -> None:
        """Start at rest under controls (n_tendons,); raises the errors of `at_rest`."""
        posture, applied = self.at_rest(control), control
        if self._servos is not None:
            self._servos.start(control)
            applied = self._servos.horn
        self._simulation.reset(posture, applied)

    def advance(self, control: ndarray) -> str | None:
        """Advance by a period under controls (n_tendons,); returns the failure, or None."""
        target = self._simulation.ctrl if self._servos is None else self._servos.command
        target[:] = control
        return None if self._simulation.advance() else self._simulation.failure() or "diverged"

    @property
    def q(self) -> ndarray:
        """A copy of the current coordinates."""
        data = self._simulation.data
        return self._simulation.q.copy() if data is None else data.qpos.copy()

    def markers(self, q: ndarray, markers: Sequence[Marker]) -> ndarray:
        """Positions of markers, (T, k, 3) [m] in the world, in postures q (T, n)."""
        places = [self._place(q, marker) for marker in markers]
        return np.stack(places, axis=1) if places else np.zeros((len(q), 0, 3))

    def _place(self, q: ndarray, marker: Marker) -> ndarray:
        length = self._robot.length
        station = length if marker.station_m is None else marker.station_m
        if station > length * (1 + 1e-9):
            raise ValueError(f"marker: station_m must be at most {length:g}, got {station:g}")
        point = self._tip(q) if marker.station_m is None else self._at(q, station, (0.0, 0.0))
        if not any(marker.offset_m):
            return point
        radius = self._robot.backbone.widest
        middle = self._at(q, station, (0.0, 0.0))
        x = (self._at(q, station, (radius, 0.0)) - middle) / radius
        y = (self._at(q, station, (0.0, radius)) - middle) / radius
        along, across, out = marker.offset_m
        return point + along * x + across * y + out * np.cross(x, y)

    def _tip(self, q: ndarray) -> ndarray:
        """(T, 3) [m]: the output point of a head; beams have a last section instead of a head."""
        if self._simulation.data is not None:
            return self._model.tip(q)
        return self._at(q, self._robot.reach, (0.0, 0.0))

    def _at(self, q: ndarray, station: float, offset: tuple[float, float]) -> ndarray:
        return self._model.positions(q, np.array([station]), np.array([offset]))[:, 0]


#: Longest control period [s], period of the grid for rows at unequal intervals, and the largest
#: relative difference of equal intervals.
_LONGEST, _GRID, _EQUAL = 0.02, 0.005, 1e-3

_SHOWN = 50  # rows between two reports of progress

#: Called with the number of finished rows.
Progress = Callable[[int], None]


@dataclass(frozen=True)
class Replay:
    """A recording and the motion of a simulated robot under its commands.

    Attributes:
        recording: The recording.
        robot: The simulated robot.
        plant: Its model.
        simulated: (t, k, 3) [m], markers in the world; NaN where the simulation failed.
        failures: One line for each failed row or run.
        cpu_time: [s] of the simulation, including compilation.
    """

    recording: Recording
    robot: RobotParams
    plant: str
    simulated: ndarray
    failures: tuple[str, ...]
    cpu_time: float = field(compare=False)

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for readers of its errors, one per line."""
        if not (self.static and self.robot.has_friction):
            return ()
        return (
            "tendons rub: rows count as ends of slow motions from one to the next; a robot that "
            "sways on its way has less hysteresis",
        )

    @property
    def recorded(self) -> ndarray:
        """(t, k, 3) [m], markers in the world."""
        return self.recording.markers

    @property
    def times(self) -> ndarray:
        """(t,) [s] of all runs, one after the other."""
        return np.cumsum(np.maximum(np.diff(self.recording.times, prepend=0.0), 0.0))

    @property
    def static(self) -> bool:
        """Whether rows are postures at rest."""
        return self.recording.static

    @property
    def title(self) -> str:
        """Title with robot and model."""
        return f"{self.robot.name}, {self.plant}"

    @cached_property
    def error(self) -> ndarray:
        """Simulated minus recorded (t, k, 3) [m]; NaN where one of them is unknown."""
        return self.simulated - self.recording.markers

    @cached_property
    def distance(self) -> ndarray:
        """Its size (t, k) [m] over the measured coordinates."""
        return distances(self.error)

    @cached_property
    def centred(self) -> ndarray:
        """The same with the mean error of each marker over all rows removed."""
        return distances(centred(self.error))


def replay(
    recording: Recording,
    robot: RobotParams,
    plant: str = MUJOCO,
    twin: Twin | int | None = None,
    progress: Progress | None = None,
) -> Replay:
    """Simulate the commands of a recording.

    Args:
        recording: The recording; its header assigns commands to tendons.
        robot: The robot.
        plant: One of `beams.registry.PLANTS`.
        twin: For a robot driven by length, the simulated twin, or the seed of one.
        progress: Called occasionally.

    Raises:
        ValueError: The commands do not fit the robot, a marker is not on it, or the model does not
            support something that the robot has.
    """
    if not recording.header.marker:
        raise ValueError("the recording has no markers: nothing can be compared")
    begun = process_time()
    built, drive = twin_of(robot, twin), recording.drive(robot)
    controls = recording.controls(robot)
    if recording.static:
        # Weights off the axis twist a robot; environments neglect that, here it costs little.
        body, work = Body(robot, built, plant, drive, _LONGEST, torsion=True), _equilibria
    else:
        body, work = Body(robot, built, plant, drive, control_period(recording)), _motions
    simulated, failures = work(body, recording, controls, progress or _silent)
    used = process_time() - begun
    return Replay(recording, built.robot, plant, simulated, tuple(failures), used)


def _silent(rows: int) -> None:
    pass


def _equilibria(
    body: Body, recording: Recording, controls: ndarray, progress: Progress
) -> tuple[ndarray, list[str]]:
    q, found, failures = None, {}, []
    for row, control in enumerate(controls):
        try:
            found[row] = q = body.follow(control, q)
        except EquilibriumError as error:
            q = None
            failures.append(f"row {row + 1}: {error}")
        if row % _SHOWN == 0:
            progress(row)
    simulated = np.full_like(recording.markers, np.nan)
    if found:
        states = np.array(list(found.values()))
        simulated[list(found)] = body.markers(states, recording.header.marker)
    return simulated, failures


def _motions(
    body: Body, recording: Recording, controls: ndarray, progress: Progress
) -> tuple[ndarray, list[str]]:
    simulated, failures = np.full_like(recording.markers, np.nan), []
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
    """Control period [s] of the simulation of a moving robot."""
    steps = recording.steps
    if not len(steps):
        return _LONGEST
    step = float(np.median(steps))
    if np.abs(steps - step).max() <= _EQUAL * step:
        return round(step / ceil(step / _LONGEST - _EQUAL), 9)
    return min(step / 2, _GRID)


def _motion(
    body: Body, run: Recording, controls: ndarray, ahead: bool
) -> tuple[ndarray, str | None]:
    """Markers (t, k, 3) of one run; NaN after a failure, and its message."""
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
    simulated = np.full_like(run.markers, np.nan)
    known = run.times <= reached[-1] + _EQUAL * body.period
    for k, marker in enumerate(run.header.marker):
        seen = run.times[known] - marker.delay_s
        for axis in range(3):
            simulated[known, k, axis] = np.interp(seen, reached, places[:, k, axis])
    return simulated, failure


#: Pattern of the row over all rows.
ALL = "all"


@dataclass(frozen=True)
class ErrorRow:
    """Errors of a pattern, or of all rows.

    The distance of simulated and recorded markers, without and with the mean error over all rows
    removed from each marker (one offset for all patterns).

    Attributes:
        pattern: Label of the rows, or "all".
        rows: Their number.
        failed: How many of them have no simulated position.
        rms, mean, max: [m]; None where all failed.
        rms_centred, mean_centred, max_centred: [m], mean offset removed.
        offset_x, offset_y, offset_z: [m], mean error; None where it was not measured.
    """

    pattern: str
    rows: int
    failed: int
    rms: float | None
    mean: float | None
    max: float | None
    rms_centred: float | None
    mean_centred: float | None
    max_centred: float | None
    offset_x: float | None
    offset_y: float | None
    offset_z: float | None


def error_rows(replay: Replay) -> list[ErrorRow]:
    """Errors of all rows, then of each pattern in the order of its first row."""
    patterns = replay.recording.patterns
    parts = {ALL: np.ones(len(patterns), bool)}
    if len(set(patterns)) > 1:
        parts |= {name: patterns == name for name in dict.fromkeys(patterns)}
    return [_row(name, replay, rows) for name, rows in parts.items()]


def _row(name: str, replay: Replay, rows: ndarray) -> ErrorRow:
    sizes = (*_sizes(replay.distance[rows]), *_sizes(replay.centred[rows]))
    offset = [_number(x) for x in mean_known(replay.error[rows].reshape(-1, 3))]
    failed = int(np.isnan(replay.simulated[rows]).any(axis=(1, 2)).sum())
    return ErrorRow(name, int(rows.sum()), failed, *sizes, *offset)


def _sizes(distance: ndarray) -> tuple[float | None, float | None, float | None]:
    known = distance[~np.isnan(distance)]
    if not known.size:
        return None, None, None
    return float(np.sqrt(np.mean(known**2))), float(known.mean()), float(known.max())


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)
