"""A beam model as the plant of an environment, in place of the MuJoCo chain."""

from collections.abc import Callable

import numpy as np
from gymnasium import spaces

from softrobot_env.envs.observations.arm import Sizes, observation_space
from softrobot_env.interfaces import Measurement, PlantFactory, PlantModel
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import HingeLayout, place_hinges


class BeamPlant:
    """Builds simulations of a robot and of its variations with a beam model.

    Observables are those of the MuJoCo chain, with the curvature of the robot's own pieces.

    Attributes:
        robot: The nominal robot.
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
        self.robot = robot
        self.config = SceneConfig(robot, control_period=control_period)
        self.layout: HingeLayout = place_hinges(robot.length, robot.pieces, self.config.rule)
        self._factory = factory
        self._nominal = self._model(robot)

    def _model(self, robot: RobotParams) -> PlantModel:
        if any(tendon.friction for tendon in robot.tendons):
            raise ValueError(
                f"robot {robot.name!r}: beam models have no tendon friction, only the MuJoCo chain "
                "has (leave out `plant`, or tendon_friction)"
            )
        return self._factory(robot)

    def widen(self, space: spaces.Dict) -> spaces.Dict:
        """The observation space of the chain, with room for the model's axial strain."""
        strain = self._nominal.strain
        room = {
            "tip_position": strain * self.robot.length,
            "tendon_length": strain * np.array([t.end for t in self.robot.tendons]),
        }
        return spaces.Dict(
            {
                name: spaces.Box(box.low - room[name], box.high + room[name], dtype=box.dtype)
                if strain and name in room
                else box
                for name, box in space.items()
            }
        )

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

    def readout(self, simulation: "BeamSimulation") -> "BeamReadout":
        """Measurements of a simulation."""
        return BeamReadout(simulation, self._measured_space())

    def _measured_space(self) -> spaces.Dict:
        sizes = Sizes(self.robot, TendonMap(self.robot), self.layout, 1)
        return self.widen(observation_space(Measurement._fields, sizes))

    def adopt(self, simulation: "BeamSimulation") -> None:
        """Nothing to do: the copy of a simulation already shares the copy of the model."""


class BeamSimulation:
    """A beam model and its state, advanced one control period at a time.

    Attributes:
        plant: The model.
        q, v: Coordinates and velocities (n,); not a number after a failure.
        ctrl: (n_tendons,) [N], tensions in force.
        scene, model, data: None; the MuJoCo chain's are MuJoCo's.
    """

    scene = model = data = None

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


class BeamReadout:
    """Measurements of a beam model's simulation, like those of `readout.Readout`.

    Attributes:
        tip: [x, z] [m] as plain numbers.
        curvature: (n_pieces,) [1/m], mean over each piece; a new array at every `update`.
        tendon_tension: Function that returns a new array (n_tendons,) [N], as really applied.
    """

    def __init__(self, simulation: BeamSimulation, space: spaces.Dict) -> None:
        """Bind to a simulation.

        Args:
            simulation: The simulation.
            space: Bounds of what is measured.
        """
        self._simulation = simulation
        self.tendon_tension = simulation.ctrl.copy
        boxes = [space[name] for name in Measurement._fields]
        self._names = [
            (name, k) for name in Measurement._fields for k in range(space[name].shape[0])
        ]
        self._low = np.concatenate([b.low for b in boxes])
        self._high = np.concatenate([b.high for b in boxes])
        self.update()

    def sources(self) -> dict[str, Callable[[], np.ndarray]]:
        """Function by observable; no array is given out for two control instants."""
        return {
            "tip_position": lambda: self._now.tip_position,
            "tip_velocity": lambda: self._now.tip_velocity,
            "curvature": lambda: self._now.curvature,
            "curvature_rate": lambda: self._now.curvature_rate,
            "tendon_tension": self.tendon_tension,
            "tendon_length": self.tendon_length,
        }

    def tendon_length(self) -> np.ndarray:
        """(n_tendons,) [m] inside the robot."""
        return self._now.tendon_length.copy()  # an observation and `info` may both hold it

    def update(self) -> str | None:
        """Measure anew; return what left the documented workspace, or None."""
        simulation = self._simulation
        self._now = now = simulation.plant.measure(simulation.q, simulation.v)
        self.tip, self.curvature = now.tip_position.tolist(), now.curvature
        values = np.concatenate(now)
        if np.all((self._low <= values) & (values <= self._high)):
            return None
        return self._outside(values)

    def _outside(self, values: np.ndarray) -> str:
        """What lies farthest beyond its bounds, by their width."""
        beyond = np.maximum(self._low - values, values - self._high) / (self._high - self._low)
        worst = int(np.argmax(np.where(np.isnan(beyond), np.inf, beyond)))
        name, k = self._names[worst]
        low, high, value = self._low[worst], self._high[worst], values[worst]
        when = f"at t = {self._simulation.time:.3f} s"
        if name == "curvature":
            return (
                f"left the workspace: curvature {value:.4g} 1/m of piece {k + 1} is beyond "
                f"+-{high:g} 1/m {when}"
            )
        return (
            f"left the workspace: {name}[{k}] = {value:.4g} is outside [{low:.4g}, {high:.4g}] "
            f"{when}"
        )
