"""A beam model as the plant of an environment, in place of the MuJoCo chain."""

from functools import cached_property
from math import ceil

import mujoco
import numpy as np

from softrobot_env.envs.observations.readouts import BeamReadout
from softrobot_env.envs.observations.table import Sizes, observation_space, speed_limit
from softrobot_env.envs.reference import PLANE
from softrobot_env.envs.simulation.servos import Servos
from softrobot_env.interfaces import Measurement, PlantFactory, PlantModel
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import posture
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import HingeLayout, place_between

#: Longest time [s] between the instants that a path of controls is given at.
_PATH_STEP = 2e-3


class BeamPlant:
    """Builds simulations of a robot and of its variations with a beam model.

    Observables are those of the MuJoCo chain, with the curvature of the robot's own pieces.

    Attributes:
        robot: The nominal robot.
        speed: [m/s], limit of the tip's speed.
        config: The scene to draw: hinges turn by the measured curvature of their pieces.
        layout: Its hinges.
    """

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        factory: PlantFactory,
        axes: slice = PLANE,
        speed: float | None = None,
        *,
        bending: str = "planar",
        torsion: bool = False,
        actuation: str = "tension",
    ) -> None:
        """Build the nominal model.

        Args:
            robot: The nominal robot.
            control_period: [s].
            factory: Builds the model of a robot.
            axes: Coordinates out of x, y and z of the tip that are measured.
            speed: [m/s], limit of the tip's speed; that of the robot unless given.
            bending, torsion, actuation: As of `SceneConfig`.

        Raises:
            ValueError: The robot has tendon friction, or what the model lacks.
        """
        self.robot, self.speed = robot, speed_limit(robot) if speed is None else speed
        way = {"bending": bending, "torsion": torsion, "actuation": actuation}
        self.config = SceneConfig(robot, control_period=control_period, **way)
        self.layout: HingeLayout = place_between(self.config.edges, self.config.hinge_rule)
        self._factory, self._options = factory, {"axes": axes, **way}
        self._nominal = self._model(robot)

    def _model(self, robot: RobotParams) -> PlantModel:
        if any(tendon.friction for tendon in robot.tendons):
            raise ValueError(
                f"robot {robot.name!r}: beam models have no tendon friction, only the MuJoCo chain "
                "has (leave out `plant`, or tendon_friction)"
            )
        return self._factory(robot, **self._options)

    @property
    def strain(self) -> float:
        """Largest axial strain [1] of the model."""
        return self._nominal.strain

    def equilibrium(self, control: np.ndarray) -> np.ndarray:
        """Coordinates (n,) at rest under controls (n_tendons,) [N or m]."""
        return self._nominal.equilibrium(control)

    def bent(self, curvature: np.ndarray) -> np.ndarray:
        """Coordinates (n,) for a curvature [1/m] as it is measured.

        Raises:
            ValueError: The model cannot take this shape.
        """
        return self._nominal.bent(curvature)

    def simulation(self, vary: dict[str, float]) -> "BeamSimulation":
        """New simulation of the nominal robot, or of a variation of it.

        Raises:
            ValueError: The variation has tendon friction.
        """
        plant = self._model(self.robot.vary(**vary)) if vary else self._nominal
        return BeamSimulation(plant, self)

    def readout(self, simulation: "BeamSimulation", servos: Servos | None = None) -> BeamReadout:
        """What is measured of a simulation, and of the servos that drive it."""
        robot, directions = self.robot, 1 if self.config.bending == "planar" else 2
        sizes = Sizes(robot, self.layout, robot.pieces, self.speed, directions, strain=self.strain)
        space = observation_space(Measurement._fields, Measurement._fields, sizes)
        most = {name: box.high for name, box in space.items()}
        least = {name: box.low for name, box in space.items()}
        for name in ("tip_position", "tip_velocity"):  # alike in all coordinates
            most[name] = np.full(len("xyz"[self._options["axes"]]), most[name][0])
            least[name] = -most[name]
        return BeamReadout(simulation, Measurement(**least), Measurement(**most), servos)

    def adopt(self, simulation: "BeamSimulation") -> None:
        """Nothing to do: the copy of a simulation already shares the copy of the model."""

    @cached_property
    def _drawn(self) -> mujoco.MjModel:
        """The chain that is drawn in place of the model."""
        return build_scene(self.config).model

    def posture(self, strains: np.ndarray) -> np.ndarray:
        """Hinge angles (nq,) [rad] of the scene to draw for strains (pieces, 3) [1/m]."""
        kinds = 1 if self.config.bending == "planar" else 2 + self.config.torsion
        angles = strains[self.layout.piece, :kinds] * self.layout.weights[:, None]
        return posture(self._drawn, angles)


class BeamSimulation:
    """A beam model and its state, advanced one control period at a time.

    Attributes:
        plant: The model.
        q, v: Coordinates and velocities (n,); not a number after a failure.
        ctrl: (n_tendons,) [N or m], controls in force.
        step_times: (k,) [s], as those of a chain's `Simulation`.
        scene, model, data, estimates: None; the MuJoCo chain has them.
    """

    scene = model = data = estimates = None

    def __init__(self, plant: PlantModel, owner: BeamPlant) -> None:
        self.plant, self._owner = plant, owner
        self._period = period = owner.config.control_period
        number = ceil(period / _PATH_STEP - 1e-9)
        self.step_times = period / number * np.arange(1, number + 1)
        self.ctrl = np.zeros(len(plant.robot.tendons))
        self.reset(plant.rest(), self.ctrl)

    def reset(self, posture: np.ndarray, ctrl: np.ndarray) -> None:
        """Set coordinates (n,) at rest, with controls (n_tendons,) [N or m] in force."""
        self.q, self.v = posture.copy(), np.zeros_like(posture)
        self.ctrl[:] = ctrl
        self._periods, self._failure = 0, None

    def advance(self) -> bool:
        """Integrate over one control period with the controls in `ctrl`.

        Returns:
            Whether all went well; if not, `failure` says what happened.
        """
        return self._advance(self.ctrl)

    def advance_through(self, path: np.ndarray) -> bool:
        """The same with controls (1 + j, n_tendons) now and at the first j of `step_times`.

        In between they change steadily, and the last row holds for the rest of the period.
        """
        self.ctrl[:] = path[-1]
        if len(path) == 1:
            return self._advance(self.ctrl)
        rest = np.tile(path[-1], (1 + len(self.step_times) - len(path), 1))
        return self._advance(np.concatenate((path, rest)))

    def _advance(self, control: np.ndarray) -> bool:
        self._periods += 1
        reason = self.plant.advance(self.q, self.v, control, self._period)
        if reason is None:
            return True
        self._failure = (
            f"simulation diverged in the control period ending at t = {self.time:.3f} s: {reason}"
        )
        self.q[:] = self.v[:] = np.nan  # the state at that time is not known
        return False

    def failure(self) -> str | None:
        """What went wrong and when, or None."""
        return self._failure

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self._periods * self._period

    @property
    def posture(self) -> np.ndarray:
        """Hinge angles (nq,) [rad] of the scene to draw."""
        return self._owner.posture(self.plant.strains(self.q))
