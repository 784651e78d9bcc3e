"""Robots linearised about equilibria, in the turns of their joints or in their mean curvatures.

About an equilibrium under constant inputs (tensions, or lengths that servos hold),

    M q'' + D q' + K (q - q_0) = B (u - u_0),    tip - tip_0 = C (q - q_0),

of the chain of MuJoCo, with the exact tangent K of `scene.tangent`, so that all that a chain knows
is in it: tapers, discs, heads, any route of a tendon, guides, gravity, loads, and the stiffness of
tendons driven by length. Restricted to the shapes that it takes at rest with some mean curvatures
of the robot's own pieces, with P from the angles of the joints to these curvatures and
W = K^-1 P' (P K^-1 P')^-1 back, M becomes W' M W, and the others likewise.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy import ndarray
from numpy.linalg import eigvals, solve

from softrobot_env.robots.actuation import by_action, robot_inputs

from .build import Scene
from .chain import mean_curvature
from .inverse import InverseStatics
from .tangent import StaticForces
from .timestep import linearize


class LinearModel(NamedTuple):
    """M q'' + D q' + K dq = B du, tip = C dq, for n coordinates q and m inputs u.

    Attributes:
        mass, damping, stiffness: (n, n), of turns of joints [kg m2] and so on, or of curvatures.
        inputs: B (n, m), force by inputs [N or m], or actions [1].
        tip: C (3, n), or the rows of a plane.
        elastic: (n,), force of the springs at the equilibrium.
    """

    mass: ndarray
    damping: ndarray
    stiffness: ndarray
    inputs: ndarray
    tip: ndarray
    elastic: ndarray

    @property
    def frequencies(self) -> ndarray:
        """Natural frequencies (n,) [Hz] without damping, the lowest first."""
        squared = eigvals(solve(self.mass, self.stiffness)).real
        return np.sqrt(np.sort(squared)) / (2 * np.pi)

    def first_mode(self) -> tuple[float, float]:
        """Angular frequency [rad/s] and damping time [s] of the slowest mode."""
        from scipy.linalg import eigh

        stiffness = (self.stiffness + self.stiffness.T) / 2
        (square,), mode = eigh(stiffness, self.mass, subset_by_index=[0, 0])
        return float(np.sqrt(square)), float(mode[:, 0] @ self.damping @ mode[:, 0] / square)

    def response(self, rate: float) -> ndarray:
        """Complex amplitudes (3, m) [m] of the tip by those of inputs at a rate [rad/s]."""
        dynamic = self.stiffness - rate**2 * self.mass + 1j * rate * self.damping
        return self.tip @ solve(dynamic, self.inputs)

    def state_space(self) -> tuple[ndarray, ndarray, ndarray]:
        """A (2 n, 2 n), B (2 n, m) and C (3, 2 n) of x = (dq, q')."""
        n = len(self.mass)
        right = np.hstack([-self.stiffness, -self.damping, self.inputs])
        solved = solve(self.mass, right)
        a = np.vstack([np.eye(n, 2 * n, n), solved[:, : 2 * n]])
        b = np.vstack([np.zeros_like(self.inputs), solved[:, 2 * n :]])
        return a, b, np.hstack([self.tip, np.zeros_like(self.tip)])

    def seen_as(self, mean: ndarray) -> "LinearModel":
        """The same in coordinates P q, for P (k, n): W as above."""
        w = solve(self.stiffness, mean.T)
        w = solve((mean @ w).T, w.T).T
        square = (w.T @ x @ w for x in (self.mass, self.damping, self.stiffness))
        return LinearModel(*square, w.T @ self.inputs, self.tip @ w, w.T @ self.elastic)


class Linearizer:
    """Makes the linear models of a robot.

    Attributes:
        scene: Of the robot.
        inputs: Of the robot, what `robot_inputs` returns.
    """

    def __init__(self, scene: Scene) -> None:
        """Look at a scene; ValueError if it is no chain."""
        self.scene, self.inputs = scene, robot_inputs(scene.config.robot)
        self._actions, self._forces = self.inputs.per_action(), StaticForces(scene.model)
        self._damping = linearize(scene.model).damping  # the same anywhere

    @cached_property
    def mean(self) -> ndarray:
        """P (n, nv) [1/m], from turns of joints to curvatures; ValueError unless all are hinges."""
        scene = self.scene
        return mean_curvature(scene.model, scene.layout, scene.config.robot.pieces)

    def action(self, inputs: ndarray) -> ndarray:
        """Actions (..., m) of inputs (..., m) [N or m]."""
        return self.inputs.to_actions(inputs)

    def about(self, angles: ndarray, inputs: ndarray) -> LinearModel:
        """By curvatures and actions, about an equilibrium with postures (nq,) and inputs (m,)."""
        return self.chain_about(angles, inputs).seen_as(self.mean)

    def chain_about(self, angles: ndarray, inputs: ndarray) -> LinearModel:
        """The same by turns of joints and actions."""
        forces = self._forces
        controls = np.zeros(self.scene.model.nu)
        command = self.inputs.command(inputs)
        controls[: len(command)] = command
        forces.force(angles, controls)
        pulled = by_action(self._actions, self.action(inputs))
        return LinearModel(
            forces.mass(),
            self._damping,
            -forces.tangent(),
            forces.by_controls()[:, : len(pulled)] @ pulled,
            forces.tip_by_turns()[1],
            -forces.springs,
        )


def linearised(inverse: InverseStatics, inputs: ndarray) -> LinearModel:
    """The chain of inverse statics about its equilibrium under inputs (m,), by these inputs.

    Raises:
        EquilibriumError: There is none, or it is unstable.
    """
    inputs = np.asarray(inputs, float)
    made = Linearizer(inverse.scene)
    found = made.chain_about(inverse.posture(inputs), inputs)
    return found._replace(inputs=found.inputs / made.inputs.input_scale)
