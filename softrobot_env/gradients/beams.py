"""Equilibria of beam models and their derivatives, by the implicit function theorem."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy import ndarray

from softrobot_env.beams.model import BeamModel, LoadedModel
from softrobot_env.beams.numerics import linearization
from softrobot_env.robots import RobotParams
from softrobot_env.scene.statics import finite

from .parameters import Parameter, derivative, parameter


class BeamRest:
    """An equilibrium of a beam model, to be looked at and derived.

    Attributes:
        beam: The model.
        inputs: (n_inputs,), that hold it.
        q: Coordinates (n,).
        points: (k, 3) [m], of the backbone at the stations.
        parameters: Names of the numbers of the robot by which derivatives are found.
    """

    def __init__(
        self,
        build: Callable[[RobotParams], BeamModel],
        robot: RobotParams,
        inputs: ndarray | None = None,
        parameters: Iterable[str | Parameter] = (),
        stations: ndarray | None = None,
        guess: ndarray | None = None,
    ) -> None:
        """Find the equilibrium.

        Args:
            build: Function from a robot to its model, such as `partial(PCC, pieces=6)`.
            robot: The robot.
            inputs: (n_inputs,), zero unless given.
            parameters: Numbers of the robot, see `parameters.parameter`.
            stations: Arc lengths (k,) [m] of the points; the tip unless given.
            guess: Coordinates (n,) to start from, see `BeamModel.equilibrium`.

        Raises:
            EquilibriumError: None was found.
            ValueError: A parameter is none, or of the model.
        """
        self._build, self._robot, self._stations = build, robot, stations
        self._wanted = [parameter(robot, x) if isinstance(x, str) else x for x in parameters]
        self.parameters = tuple(one.name for one in self._wanted)
        self.beam = build(robot)
        self.inputs = np.zeros(self.beam.n_inputs) if inputs is None else np.array(inputs, float)
        self.q = self.beam.equilibrium(self.inputs, guess)
        self.points = self.beam.positions(self.q, self._places(self.beam))

    def _places(self, beam: BeamModel) -> ndarray:
        """Arc lengths (k,) [m] of the points of a model of the robot or one like it."""
        return np.array([beam.robot.length]) if self._stations is None else self._stations

    def vjp(self, points: ndarray) -> tuple[ndarray, dict[str, float]]:
        """Derivatives of weights (k, 3) times the points, summed up.

        At rest the missing force r(q, u, p) is 0, so that weights w on coordinates are
        w dq = -(w / r_q) (r_u du + r_p dp), along what constraints leave free. Tendons that are
        slack stay so.

        Returns:
            By inputs (n_inputs,), and by parameters by name.

        Raises:
            ValueError: Weights of another shape or not finite, or a parameter that changes the
                number of coordinates or cannot differ to both sides.
        """
        weights, q = finite("weights of points", points, self.points.shape), self.q
        beam, u, way = self.beam, self.inputs, self.beam.tangent(self.q)
        stiffness = way.T @ LoadedModel(beam, u).stiffness(q) @ way
        by_q = weights.ravel() @ beam._point_jacobian(q, self._places(beam))
        adjoint = way @ np.linalg.solve(stiffness.T, by_q @ way)
        inputs = np.empty((beam.n, beam.n_inputs))
        linearization.input_derivatives(beam.data, q, u, inputs)
        found = {}
        for one in self._wanted:
            missing, moved = np.split(derivative(one, self._numbers(one)), [beam.n])
            found[one.name] = float(weights.ravel() @ moved - adjoint @ missing)
        return adjoint @ inputs, found

    def _numbers(self, one: Parameter) -> Callable[[float], ndarray]:
        """Missing forces (n,) and points (3 k,) where the coordinates stay, by a parameter."""
        still = np.zeros_like(self.q)

        def numbers(value: float) -> ndarray:
            try:
                beam = self._build(one.apply(self._robot, value))
                missing = beam.residual(self.q, still, still, self.inputs)
            except ValueError as error:
                raise ValueError(f"no derivative by {one.name!r}: at {value:g} {error}") from error
            return np.hstack([missing, beam.positions(self.q, self._places(beam)).ravel()])

        return numbers
