"""A beam model as the plant of an environment, in place of the MuJoCo chain."""

import numpy as np

from softrobot_env.envs.observations.readouts import BeamReadout
from softrobot_env.envs.observations.table import Sizes, observation_space, speed_limit
from softrobot_env.envs.reference import PLANE
from softrobot_env.interfaces import Measurement, PlantFactory, PlantModel
from softrobot_env.robots import RobotParams
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import HingeLayout, place_between


class BeamPlant:
    """Builds simulations of a robot and of its variations with a beam model.

    Observables are those of the MuJoCo chain, with the curvature of the robot's own pieces.

    Attributes:
        robot: The nominal robot.
        speed: [m/s], limit of the tip's speed.
        config: The scene to draw: hinges turn by the measured curvature of their pieces.
        layout: Its hinges.
    """

    def __init__(self, robot: RobotParams, control_period: float, factory: PlantFactory) -> None:
        """Build the nominal model.

        Args:
            robot: The nominal robot.
            control_period: [s].
            factory: Builds the model of a robot.

        Raises:
            ValueError: The robot has tendon friction.
        """
        self.robot, self.speed = robot, speed_limit(robot)
        self.config = SceneConfig(robot, control_period=control_period)
        self.layout: HingeLayout = place_between(self.config.edges, self.config.hinge_rule)
        self._factory, self.pieces = factory, robot.pieces
        self._nominal = self._model(robot)

    def _model(self, robot: RobotParams) -> PlantModel:
        if any(tendon.friction for tendon in robot.tendons):
            raise ValueError(
                f"robot {robot.name!r}: beam models have no tendon friction, only the MuJoCo chain "
                "has (leave out `plant`, or tendon_friction)"
            )
        return self._factory(robot)

    @property
    def strain(self) -> float:
        """Largest axial strain [1] of the model."""
        return self._nominal.strain

    def equilibrium(self, tension: np.ndarray) -> np.ndarray:
        """Coordinates (n,) at rest under tensions (n_tendons,) [N]."""
        return self._nominal.equilibrium(tension)

    def bent(self, curvature: np.ndarray) -> np.ndarray:
        """Coordinates (n,) for a curvature (n_pieces,) [1/m].

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
        return BeamSimulation(plant, self.config.control_period, self.layout)

    def readout(self, simulation: "BeamSimulation", _servos: None = None) -> BeamReadout:
        """What is measured of a simulation."""
        sizes = Sizes(
            self.robot, self.layout, self.pieces, self.speed, 1, PLANE, strain=self.strain
        )
        space = observation_space(Measurement._fields, Measurement._fields, sizes)
        return BeamReadout(simulation, space)

    def adopt(self, simulation: "BeamSimulation") -> None:
        """Nothing to do: the copy of a simulation already shares the copy of the model."""


class BeamSimulation:
    """A beam model and its state, advanced one control period at a time.

    Attributes:
        plant: The model.
        q, v: Coordinates and velocities (n,); not a number after a failure.
        ctrl: (n_tendons,) [N], tensions in force.
        scene, model, data, estimates: None; the MuJoCo chain has them.
    """

    scene = model = data = estimates = None

    def __init__(self, plant: PlantModel, control_period: float, layout: HingeLayout) -> None:
        self.plant = plant
        self._period, self._layout = control_period, layout
        self.ctrl = np.zeros(len(plant.robot.tendons))
        self.reset(plant.rest(), self.ctrl)

    def reset(self, posture: np.ndarray, ctrl: np.ndarray) -> None:
        """Set coordinates (n,) at rest, with tensions (n_tendons,) [N] in force."""
        self.q, self.v = posture.copy(), np.zeros_like(posture)
        self.ctrl[:] = ctrl
        self._periods, self._failure = 0, None

    def advance(self) -> bool:
        """Integrate over one control period with the tensions in `ctrl`.

        Returns:
            Whether all went well; if not, `failure` says what happened.
        """
        self._periods += 1
        reason = self.plant.advance(self.q, self.v, self.ctrl, self._period)
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
        curvature = self.plant.measure(self.q, self.v).curvature
        return curvature[self._layout.piece] * self._layout.weights
