"""What is simulated in place of a recorded robot: MuJoCo's chain or a beam model, and its markers.

They are the plants of environments, so that the recording of an environment is replayed as it was.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from softrobot_env.beams.registry import MUJOCO, BeamPlant
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.envs.reference import own_axes
from softrobot_env.envs.simulation.plants import BeamPlant as BeamSimulations
from softrobot_env.envs.simulation.plants import MujocoPlant
from softrobot_env.recordings import Marker
from softrobot_env.robots import RobotParams, entry_of
from softrobot_env.robots.twin import Twin
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.statics import equilibrium
from softrobot_env.scene.tangent import RubbingForces

_LET_OUT = 0.02  # of the robot's length, by which tendons are let out to be slack
_STEP, _SHORTEST = 1 / 16, 1 / 1024  # of the way from one command to another


class Body:
    """A robot that is simulated under controls (n_tendons,) [N] or [m], with its servos.

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
            twin: What is simulated of it; its servos count where commands are lengths.
            plant: One of `beams.registry.PLANTS`.
            drive: What controls are, "tension" or "length".
            period: [s].
            torsion: Whether a spatial chain of MuJoCo twists, also where no tendon winds.
        """
        options: dict[str, Any] = {"actuation": drive}
        if torsion and plant == MUJOCO and not robot.is_planar:
            options["torsion"] = True
        if plant == MUJOCO and (pieces := entry_of(robot).pieces) is not None:
            options["pieces"] = pieces
        robot, self.period = twin.robot, period
        self._robot, axes = robot, own_axes(robot)
        if plant == MUJOCO:
            made = MujocoPlant(robot, period, axes=axes, **options)
            self._model = made.nominal
        else:
            made = BeamSimulations(robot, period, BeamPlant(plant), axes=axes, **options)
        self._simulation = made.simulation({})
        if plant != MUJOCO:
            self._model = self._simulation.plant.model
        self._servos, self._offset = None, np.zeros(len(robot.tendons))
        self._rubbing: RubbingForces | None = None
        idle = [0.0 if drive == "length" else t.pretension for t in robot.tendons]
        self._idle, self._slack = np.array(idle, dtype=float), np.zeros(len(idle))
        if drive == "length":
            held = [t.pretension / t.stiffness for t in robot.tendons]
            self._slack = np.array(held) + _LET_OUT * robot.length
        self._play = self._horn = np.zeros_like(self._offset)
        if drive == "length":
            self._play = np.array(twin.backlash) / 2
            self._offset = np.array(twin.servo_offset)
            self._servos = Servos(twin.servo_speed, twin.servo_offset, twin.backlash)
            self._simulation.drive_by(self._servos)

    def at_rest(self, control: np.ndarray, guess: np.ndarray | None = None) -> np.ndarray:
        """Coordinates in stable equilibrium under controls (n_tendons,).

        Near the guess, else where slowly growing loads lead, else where the robot goes in small
        steps from rest without commands, or with all tendons let out: some that are slack and some
        that are not may give the loads' path a kink at its very begin.

        Raises:
            EquilibriumError: None was found, or only an unstable one.
            ValueError: A control is out of its range.
        """
        try:
            return self._model.equilibrium(control + self._offset, guess)
        except EquilibriumError:
            rest, idle = self._model.equilibrium, self._idle
            try:
                start = rest(idle + self._offset)
            except EquilibriumError:
                idle = idle - self._slack
                start = rest(idle + self._offset)
            return self._by_steps(rest, idle, control, start)

    def follow(self, control: np.ndarray, before: np.ndarray | None) -> np.ndarray:
        """Coordinates at rest after slow motion from those before, with friction and backlash.

        Without any before, in the middle of the play and as if nothing rubbed. Errors as `at_rest`.
        """
        if before is None:
            self._horn = control.copy()
        last, self._horn = (
            self._horn,
            np.clip(self._horn, control - self._play, control + self._play),
        )
        if before is None or self._simulation.data is None or not self._robot.has_friction:
            return self.at_rest(self._horn, before)
        model = self._model.model
        if self._rubbing is None:
            self._rubbing = RubbingForces(model, before)
        rest = partial(equilibrium, model, rubbing=self._rubbing)
        try:
            return rest(self._horn + self._offset, before)
        except EquilibriumError:
            return self._by_steps(rest, last, self._horn, before)

    def _by_steps(
        self, rest: Callable[..., np.ndarray], begin: np.ndarray, end: np.ndarray, q: np.ndarray
    ) -> np.ndarray:
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

    def begin(self, control: np.ndarray) -> None:
        """Be at rest under controls (n_tendons,); errors as `at_rest`."""
        posture, applied = self.at_rest(control), control
        if self._servos is not None:
            self._servos.start(control)
            applied = self._servos.horn
        self._simulation.reset(posture, applied)

    def advance(self, control: np.ndarray) -> str | None:
        """Go on for a period under controls (n_tendons,); what went wrong, or None."""
        target = self._simulation.ctrl if self._servos is None else self._servos.command
        target[:] = control
        return None if self._simulation.advance() else self._simulation.failure() or "diverged"

    @property
    def q(self) -> np.ndarray:
        """A copy of the coordinates now."""
        data = self._simulation.data
        return self._simulation.q.copy() if data is None else data.qpos.copy()

    def markers(self, q: np.ndarray, markers: Sequence[Marker]) -> np.ndarray:
        """Where markers are, (T, k, 3) [m] in the world, in postures q (T, n)."""
        places = [self._place(q, marker) for marker in markers]
        return np.stack(places, axis=1) if places else np.zeros((len(q), 0, 3))

    def _place(self, q: np.ndarray, marker: Marker) -> np.ndarray:
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

    def _tip(self, q: np.ndarray) -> np.ndarray:
        """(T, 3) [m]: of a head, its output point; beams have a last section in its place."""
        if self._simulation.data is not None:
            return self._model.tip(q)
        return self._at(q, self._robot.reach, (0.0, 0.0))

    def _at(self, q: np.ndarray, station: float, offset: tuple[float, float]) -> np.ndarray:
        return self._model.positions(q, np.array([station]), np.array([offset]))[:, 0]
