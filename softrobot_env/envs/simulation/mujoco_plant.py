"""The MuJoCo chain as the plant of an environment."""

from dataclasses import replace
from typing import Any

import numpy as np

from softrobot_env.envs.observations.readouts import BatchReadout, ChainReadout
from softrobot_env.envs.observations.table import speed_limit
from softrobot_env.envs.reference import PLANE, own_axes
from softrobot_env.envs.simulation.batch import BatchSimulation
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import build_scene, vary_scene
from softrobot_env.scene.chain import posture
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import HingeLayout
from softrobot_env.scene.registry import scene_of
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.statics import equilibrium


class MujocoPlant:
    """Builds simulations of a robot and of its variations.

    Attributes:
        robot: The nominal robot.
        nominal: Its scene.
        speed: [m/s], limit of the tip's speed.
        axes: Coordinates out of x, y and z that are measured, a slice of (3,).
        pieces: Number of pieces whose curvature is measured: a planar chain's own, of a spatial one
            the robot's.
        strain: Zero: the chain is inextensible.
    """

    strain = 0.0

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        speed: float | None = None,
        axes: slice | None = None,
        **scene_options: Any,
    ) -> None:
        """Build the nominal scene.

        Args:
            robot: The nominal robot.
            control_period: [s].
            speed: [m/s], limit of the tip's speed; the robot's unless given.
            axes: Coordinates out of x, y and z that are measured; unless given x and z of a planar
                robot, all three of another.
            **scene_options: As of `SceneConfig`, in place of what `scene_of` chooses.

        Raises:
            ValueError: A part that does not fit the robot; the message says which and why.
        """
        self.robot, self.speed = robot, speed_limit(robot) if speed is None else speed
        own = scene_of(robot)
        self.nominal = build_scene(replace(own, control_period=control_period, **scene_options))
        self.axes = own_axes(robot) if axes is None else axes
        spatial = self.config.bending == "spatial"
        self.pieces = robot.pieces if spatial else self.layout.pieces
        _check_pieces(robot, self.layout, self.pieces)
        if self.axes == PLANE:
            robot.require_plane("a planar chain")

    @property
    def directions(self) -> int:
        """Numbers of curvatures of a piece: 1 in a plane, 2 in space, 3 of a chain that twists."""
        return 1 if self.config.bending == "planar" else 2 + self.config.torsion

    @property
    def layout(self) -> HingeLayout:
        """Where the hinges stand."""
        return self.nominal.layout

    @property
    def cells(self) -> np.ndarray:
        """Edges (cells + 1,) [m] of the parts whose rotation a readout's `shape` tells."""
        return np.append(0.0, np.cumsum(self.layout.weights))

    @property
    def config(self) -> SceneConfig:
        """The scene to draw."""
        return self.nominal.config

    def readout(
        self, simulation: Simulation | BatchSimulation, servos: Servos | None = None
    ) -> ChainReadout | BatchReadout:
        """What is measured of a simulation or of many, and of the servos that drive it."""
        kind = ChainReadout if isinstance(simulation, Simulation) else BatchReadout
        return kind(simulation, self.robot, self.pieces, self.speed, self.axes, servos)

    def equilibrium(self, command: np.ndarray) -> np.ndarray:
        """Posture (nq,) at rest under what the drives apply, (n_tendons,) [N] or [m]."""
        return equilibrium(self.nominal.model, command)

    def bent(self, curvature: np.ndarray) -> np.ndarray:
        """Posture (nq,) for curvatures (pieces * directions,) [1/m] of the measured pieces."""
        layout = self.layout
        piece = layout.piece // (layout.pieces // self.pieces)
        bends = curvature.reshape(self.pieces, -1)[piece] * layout.weights[:, None]
        return posture(self.nominal.model, bends)

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
