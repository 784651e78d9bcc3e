"""The MuJoCo chain as the plant of an environment."""

from typing import Any

import numpy as np

from softrobot_env.envs.observations.readouts import BatchReadout, ChainReadout
from softrobot_env.envs.observations.table import speed_limit
from softrobot_env.envs.reference import PLANE, TOP
from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import Scene, build_scene, vary_scene
from softrobot_env.scene.config import SceneConfig, TipSensors
from softrobot_env.scene.quadrature import HingeLayout
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.statics import equilibrium


class MujocoPlant:
    """Builds simulations of a robot and of its variations.

    Attributes:
        robot: The nominal robot.
        nominal: Its scene.
        speed: [m/s], limit of the tip's speed.
        strain: Zero: the chain is inextensible.
    """

    strain = 0.0

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        speed: float | None = None,
        **scene_options: Any,
    ) -> None:
        self.robot, self.speed = robot, speed_limit(robot) if speed is None else speed
        self._options = {"control_period": control_period, **scene_options}
        self.nominal = self._build(robot)

    def _build(self, robot: RobotParams) -> Scene:
        return build_scene(SceneConfig(robot=robot, sensors=(TipSensors(),), **self._options))

    @property
    def layout(self) -> HingeLayout:
        """Where the hinges stand."""
        return self.nominal.layout

    @property
    def config(self) -> SceneConfig:
        """The scene to draw."""
        return self.nominal.config

    def readout(
        self,
        simulation: Simulation | BatchSimulation,
        servos: Servos | None = None,
        axes: slice | None = None,
    ) -> ChainReadout | BatchReadout:
        """What is measured of a simulation or of many, and of the servos that drive it.

        A planar chain is measured by its own pieces, a spatial one by those of its robot.

        Args:
            simulation: The simulation.
            servos: See `ChainReadout`.
            axes: Coordinates out of x, y and z of the tip; unless given x and z of a planar chain,
                x and y of a spatial one.

        Raises:
            ValueError: The chain's pieces do not divide the measured ones, or it is planar and its
                plane is not that of x and z.
        """
        spatial = self.config.bending == "spatial"
        pieces = self.robot.pieces if spatial else self.layout.pieces
        _check_pieces(self.robot, self.layout, pieces)
        if not spatial:
            self.robot.require_plane("a planar chain")
        if axes is None:
            axes = TOP if spatial else PLANE
        many = isinstance(simulation, BatchSimulation)
        kind = BatchReadout if many else ChainReadout
        return kind(simulation, self.robot, pieces, self.speed, axes, servos)

    def equilibrium(self, tension: np.ndarray) -> np.ndarray:
        """Hinge angles (nq,) [rad] at rest under tensions (n_tendons,) [N]."""
        return equilibrium(self.nominal.model, tension)

    def bent(self, curvature: np.ndarray) -> np.ndarray:
        """Hinge angles (nq,) [rad] for a curvature (n_pieces,) [1/m]."""
        return curvature[self.layout.piece] * self.layout.weights

    def simulation(self, vary: dict[str, float]) -> Simulation:
        """New simulation of the nominal robot, or of a variation of it."""
        if not vary:
            return Simulation(self.nominal)
        return Simulation(vary_scene(self.nominal, vary))

    def adopt(self, simulation: Simulation) -> None:
        """Share the scene of a copied simulation of the nominal robot."""
        self.nominal = simulation.scene


def _check_pieces(robot: RobotParams, layout: HingeLayout, pieces: int) -> None:
    """Raise ValueError unless the chain's pieces divide those whose curvature is measured."""
    together, rest = divmod(layout.pieces, pieces)
    own = robot.backbone.cut(robot.pieces)
    if pieces == robot.pieces and (rest or not np.allclose(layout.edges[::together], own)):
        raise ValueError(
            f"robot {robot.name!r}: the scene's {layout.pieces} pieces do not divide the robot's "
            f"own {robot.pieces}, whose curvature is measured: leave out `pieces`, or take a "
            "multiple in every section"
        )
