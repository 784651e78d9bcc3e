"""Plants of environments: the MuJoCo chain, and beam models instead of it."""

from dataclasses import replace
from functools import cached_property
from math import ceil, nan
from typing import Any

import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import Measurement, PlantFactory, PlantModel
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import build_scene, vary_scene
from softrobot_env.scene.chain import posture
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.integration.layout import MEMORY_SIZE, PERIOD, SUBSTEPS
from softrobot_env.scene.quadrature import HingeLayout
from softrobot_env.scene.registry import scene_of
from softrobot_env.scene.servos import Servos
from softrobot_env.scene.simulation import Simulation

from ..observations.readouts import BatchReadout, BeamReadout, ChainReadout
from ..observations.table import Sizes, observation_space, speed_limit
from ..reference import PLANE, own_axes
from .batch import BatchSimulation

#: Longest time [s] between the instants at which a path of controls is given.
_PATH_STEP = 2e-3


class _Plant:
    """Attributes of all plants.

    Attributes:
        robot: The nominal robot.
        speed: [m/s], limit of the tip's speed.
        axes: Measured coordinates among x, y and z, a slice of (3,).
        config: The scene to render.
    """

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        speed: float | None,
        axes: slice | None,
        scene_options: dict[str, Any],
    ) -> None:
        self.robot, self.speed = robot, speed_limit(robot) if speed is None else speed
        self.axes = own_axes(robot) if axes is None else axes
        own = scene_of(robot)
        self.config: SceneConfig = replace(own, control_period=control_period, **scene_options)

    @property
    def directions(self) -> int:
        """Numbers of curvatures of a piece: 1 in a plane, 2 in space, 3 with torsion."""
        return 1 if self.config.bending == "planar" else 2 + self.config.torsion

    @property
    def sizes(self) -> Sizes:
        """The `Sizes` of its measurements."""
        how = self.speed, self.directions, self.axes
        return Sizes(self.robot, self.layout, self.pieces, *how, strain=self.strain)


class MujocoPlant(_Plant):
    """Builds simulations of a robot and of its variations.

    Attributes:
        nominal: The scene of the nominal robot.
        pieces: Number of pieces whose curvature is measured: the robot's own, or those requested
            for a planar chain.
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
            speed: [m/s], limit of the tip's speed; by default the robot's.
            axes: Measured coordinates among x, y and z; by default x and z for a planar robot, all
                three for others.
            **scene_options: Of `SceneConfig`, instead of those chosen by `scene_of`.

        Raises:
            ValueError: A part that does not fit the robot; the message says which and why.
        """
        super().__init__(robot, control_period, speed, axes, scene_options)
        self.nominal = build_scene(self.config)
        self.config = self.nominal.config
        own = self.config.bending == "spatial" or scene_options.get("pieces") is None
        self.pieces = robot.pieces if own else self.layout.pieces
        _check_pieces(robot, self.layout, self.pieces)
        if self.axes == PLANE:
            robot.require_plane("a planar chain")

    @property
    def layout(self) -> HingeLayout:
        """Positions of the hinges."""
        return self.nominal.layout

    @property
    def discretization_error(self) -> float:
        """[m], of the nominal robot at rest, see `scene.resolution.Discretization`."""
        return self.nominal.discretization.error

    @property
    def cells(self) -> ndarray:
        """Edges (cells + 1,) [m] of the parts whose rotation a readout's `shape` has."""
        return np.append(0.0, np.cumsum(self.layout.weights))

    def readout(
        self, simulation: Simulation | BatchSimulation, servos: Servos | None = None
    ) -> ChainReadout | BatchReadout:
        """Measurements of one or many simulations, and of the servos that drive them."""
        kind = ChainReadout if isinstance(simulation, Simulation) else BatchReadout
        return kind(simulation, self.robot, self.pieces, self.speed, self.axes, servos)

    def equilibrium(self, command: ndarray) -> ndarray:
        """Posture (nq,) at rest under the drives' output, (n_tendons,) [N] or [m]."""
        return self.nominal.equilibrium(command, by_servos=not self.robot.drive.is_ideal)

    def bent(self, curvature: ndarray) -> ndarray:
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


class BeamPlant(_Plant):
    """Builds simulations of a robot and of its variations with a beam model.

    Observables are those of the MuJoCo chain, with the curvature of the robot's own pieces. It also
    sets the hinges in pictures.

    Attributes:
        layout: Hinges of the scene to render.
        pieces: Number of pieces whose curvature is measured, the robot's own.
        discretization_error: Not known.
    """

    discretization_error = nan

    def __init__(
        self,
        robot: RobotParams,
        control_period: float,
        factory: PlantFactory,
        speed: float | None = None,
        axes: slice | None = None,
        **scene_options: Any,
    ) -> None:
        """Build the nominal model.

        Args:
            robot: The nominal robot.
            control_period: [s].
            factory: Builds the model of a robot.
            speed: [m/s], limit of the tip's speed; by default that of the robot.
            axes: Measured coordinates of the tip, see `MujocoPlant`.
            **scene_options: Of `SceneConfig`, instead of those chosen by `scene_of`.

        Raises:
            ValueError: The robot has dry friction, or something that the model does not support.
        """
        super().__init__(robot, control_period, speed, axes, scene_options)
        self.config = replace(self.config, pieces=self.config.n_pieces)
        self.layout: HingeLayout = self.config.layout
        self.pieces, self._factory = robot.pieces, factory
        way = {name: getattr(self.config, name) for name in ("bending", "torsion", "actuation")}
        self._options = {"axes": self.axes, **way}
        self._nominal = self._model(robot)

    def _model(self, robot: RobotParams) -> PlantModel:
        if self.config.actuation == "length" and not robot.drive.is_ideal:
            raise ValueError(
                f"robot {robot.name!r}: beam models have servos of any force, spools of one radius "
                "and wires of one stiffness, only the MuJoCo chain has what its drive says (leave "
                "out `plant`, or the drive's gain, wire_diameter and seating)"
            )
        if robot.has_friction:
            raise ValueError(
                f"robot {robot.name!r}: beam models have no tendon friction, nor one of the "
                "backbone, only the MuJoCo chain has (leave out `plant`, or the friction)"
            )
        return self._factory(robot, **self._options)

    @property
    def directions(self) -> int:
        """See `_Plant`; torsion is not measured."""
        return min(2, super().directions)

    @property
    def cells(self) -> ndarray:
        """Edges (cells + 1,) [m] of the parts whose rotation a readout's `shape` has."""
        return self._nominal.cells

    @property
    def strain(self) -> float:
        """Largest axial strain [1] of the model."""
        return self._nominal.strain

    def equilibrium(self, control: ndarray) -> ndarray:
        """Coordinates (n,) at rest under controls (n_tendons,) [N or m]."""
        return self._nominal.equilibrium(control)

    def bent(self, curvature: ndarray) -> ndarray:
        """Coordinates (n,) for measured curvatures [1/m].

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
        """Measurements of a simulation, and of the servos that drive it."""
        space = observation_space(Measurement._fields, Measurement._fields, self.sizes)
        most = {name: box.high for name, box in space.items()}
        least = {name: box.low for name, box in space.items()}
        return BeamReadout(simulation, Measurement(**least), Measurement(**most), servos)

    def adopt(self, simulation: "BeamSimulation") -> None:
        """Nothing to do: the copy of a simulation already shares the copy of the model."""

    @cached_property
    def _shown(self) -> mujoco.MjModel:
        """The chain rendered instead of the model."""
        return build_scene(self.config).model

    def posture(self, strains: ndarray) -> ndarray:
        """Hinge angles (nq,) [rad] of the scene to render for strains (pieces, 3) [1/m]."""
        angles = strains[self.layout.piece, : super().directions] * self.layout.weights[:, None]
        return posture(self._shown, angles)


class BeamSimulation:
    """A beam model and its state, advanced one control period at a time.

    Attributes:
        plant: The model.
        q, v: Coordinates and velocities (n,); not a number after a failure.
        ctrl: (n_tendons,) [N or m], current controls.
        scene, model, data, estimates: None; the MuJoCo chain has them.
    """

    scene = model = data = estimates = None

    def __init__(self, plant: PlantModel, owner: BeamPlant) -> None:
        self.plant, self._owner = plant, owner
        self._period = period = owner.config.control_period
        number = ceil(period / _PATH_STEP - 1e-9)
        self._clock = np.zeros(MEMORY_SIZE)
        self._clock[[PERIOD, SUBSTEPS]] = period, number
        self._servos: Servos | None = None
        self.ctrl = np.zeros(len(plant.robot.tendons))
        self.reset(plant.rest(), self.ctrl)

    def reset(self, posture: ndarray, ctrl: ndarray) -> None:
        """Set coordinates (n,) at rest, under controls (n_tendons,) [N or m]."""
        self.q, self.v = posture.copy(), np.zeros_like(posture)
        self.ctrl[:] = ctrl
        self._periods, self._failure = 0, None

    def advance(self) -> bool:
        """Integrate over one control period with the controls in `ctrl`, or by the servos.

        Returns:
            Whether it succeeded; if not, `failure` says what happened.
        """
        control = self.ctrl if self._servos is None else self._wound(self._servos)
        self._periods += 1
        reason = self.plant.advance(self.q, self.v, control, self._period)
        if reason is None:
            return True
        self._failure = (
            f"simulation diverged in the control period ending at t = {self.time:.3f} s: {reason}"
        )
        self.q[:] = self.v[:] = np.nan  # the state at that time is not known
        return False

    def drive_by(self, servos: Servos) -> None:
        """Drive the robot by servos from now on; the positions of their horns are the controls."""
        servos.check_drives("length", self.ctrl.shape)
        self._servos = servos

    def _wound(self, servos: Servos) -> ndarray:
        """Turn the servos for this period; returns their horns (1 + k, n_tendons) [m]."""
        from softrobot_env.scene.integration.period import turn  # compiled code takes time to load

        path = np.empty((1 + int(self._clock[SUBSTEPS]), len(self.ctrl)))
        rows = turn(servos.block[0], self._clock, path)
        path[rows:] = path[rows - 1]
        self.ctrl[:] = path[-1]
        return path

    def failure(self) -> str | None:
        """What went wrong and when, or None."""
        return self._failure

    @property
    def time(self) -> float:
        """[s] since the start."""
        return self._periods * self._period

    @property
    def posture(self) -> ndarray:
        """Hinge angles (nq,) [rad] of the scene to render."""
        return self._owner.posture(self.plant.strains(self.q))
