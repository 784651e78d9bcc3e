"""Linear models of a robot about equilibria as a beam model has them, in place of its chain.

So that laws can be tuned on one model of a robot and tried on another. What is observed, the mean
curvatures of the robot's own pieces and the tip, follows the velocities of the model exactly
linearly, which gives the maps that `scene.linearised` restricts to.
"""

from typing import NamedTuple

import numpy as np

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.core.motion import State
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.scene.linearised import LinearModel
from softrobot_env.scene.registry import model_scene

#: [1], step of an action to both sides, as of `scene.linearised`.
_SHIFT = 1e-7


class Rest(NamedTuple):
    """A robot at rest.

    Attributes:
        action: (m,) [1].
        curvature: (n,) [1/m].
        tip: (3,) [m].
        model: The linear model about it.
    """

    action: np.ndarray
    curvature: np.ndarray
    tip: np.ndarray
    model: LinearModel


class BeamLinearizer:
    """Makes the linear models of a robot's beam model.

    Attributes:
        stepped: The model with its read-outs.
        inputs: Of the robot.
    """

    def __init__(self, robot: RobotParams, plant: str) -> None:
        """Build the model.

        Args:
            robot: The robot.
            plant: One of `beams.registry.PLANTS`, except the chain.

        Raises:
            ValueError: The model lacks what the robot has.
        """
        scene = model_scene(robot)
        self.stepped = BeamPlant(plant)(
            scene.robot,
            axes=slice(0, 3),
            bending=scene.bending,
            torsion=scene.torsion,
            actuation=scene.actuation,
        )
        self.inputs = robot_inputs(robot)
        self._command = self.inputs.per_action().command
        self._bare = self.stepped.bare()
        self._last: np.ndarray | None = None

    def rest(self, inputs: np.ndarray) -> Rest:
        """The robot at rest under inputs (m,) [N or m], looked for from the one before.

        Raises:
            EquilibriumError: There is none, or it is unstable.
        """
        model, command = self.stepped.model, self.inputs.command(inputs)
        q = self._last = model.equilibrium(command, self._last)
        space = model.linearize(State(q, np.zeros_like(q)), command)
        ways = model.tangent(q)
        rates = [self.stepped.measure(q, np.ascontiguousarray(way)) for way in ways.T]
        mean = np.array([rate.curvature_rate for rate in rates]).T
        tip = np.array([rate.tip_velocity for rate in rates]).T
        w = np.linalg.solve(space.stiffness, mean.T)
        w = np.linalg.solve((mean @ w).T, w.T).T
        action = (inputs - self.inputs.input_centre) / self.inputs.input_scale
        shift = _SHIFT * np.eye(len(action))
        by_action = (self._command(action + shift) - self._command(action - shift)).T / (2 * _SHIFT)
        forces = space.mass @ space.b[len(space.mass) :, : len(by_action)]
        still = np.zeros_like(q)
        found = LinearModel(
            w.T @ space.mass @ w,
            w.T @ space.damping @ w,
            w.T @ space.stiffness @ w,
            w.T @ forces @ by_action,
            tip @ w,
            w.T @ ways.T @ self._bare.residual(q, still, still),
        )
        seen = self.stepped.measure(q, still)
        return Rest(action, seen.curvature, seen.tip_position, found)
