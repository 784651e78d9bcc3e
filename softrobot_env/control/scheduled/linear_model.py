"""Linear models of any robot about equilibria, in the curvatures that are observed.

The chain of MuJoCo, whose static forces have an exact derivative, is restricted to the shapes that
it takes at rest with some mean curvatures of the robot's own pieces: with P from the angles of the
joints to these curvatures q, and W = K_chain^-1 P' (P K_chain^-1 P')^-1 back,

    M q'' + D q' + K (q - q_OP) = B (a - a_OP),    tip = tip_OP + C (q - q_OP),

with M = W' M_chain W and the others likewise. All that a chain knows is in it: tapers, discs,
heads, any route of a tendon, guides, gravity, and the stiffness of tendons driven by length.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.scene.build import Scene
from softrobot_env.scene.chain import mean_curvature
from softrobot_env.scene.tangent import StaticForces

#: [1], step of an action to both sides that the derivative of commands is taken over: the mean of
#: both sides at a kink, where another tendon begins to pull.
_SHIFT = 1e-7


class LinearModel(NamedTuple):
    """M q'' + D q' + K dq = B da, tip = C dq, for n curvatures q [1/m] and m actions a [1].

    Attributes:
        mass, damping, stiffness: (n, n).
        inputs: B (n, m).
        tip: C (3, n) [m2].
        elastic: (n,) [N m2], force of the springs at the equilibrium.
    """

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    inputs: np.ndarray
    tip: np.ndarray
    elastic: np.ndarray

    def state_space(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """A (2 n, 2 n), B (2 n, m) and C (3, 2 n) of x = (dq, q')."""
        n = len(self.mass)
        right = np.hstack([-self.stiffness, -self.damping, self.inputs])
        solved = np.linalg.solve(self.mass, right)
        a = np.vstack([np.eye(n, 2 * n, n), solved[:, : 2 * n]])
        b = np.vstack([np.zeros_like(self.inputs), solved[:, 2 * n :]])
        return a, b, np.hstack([self.tip, np.zeros_like(self.tip)])


class Linearizer:
    """Makes the linear models of a robot.

    Attributes:
        scene: Of the robot.
        inputs: Of the robot, what `robot_inputs` returns.
        mean: (n, nv) [1/m], from the angles of joints to curvatures.
    """

    def __init__(self, scene: Scene) -> None:
        """Look at a scene; ValueError if its joints are no hinges."""
        robot, model, layout = scene.config.robot, scene.model, scene.layout
        self.scene, self.inputs = scene, robot_inputs(robot)
        self._command = self.inputs.per_action().command
        self.mean = mean_curvature(model, layout, robot.pieces)
        self._forces = StaticForces(model)
        self._damping = _damping(model)
        shift = _SHIFT * np.eye(self.inputs.n_inputs)
        self._shifts = np.concatenate([shift, -shift])

    def action(self, inputs: np.ndarray) -> np.ndarray:
        """Actions (..., m) of inputs (..., m) [N or m]."""
        return (inputs - self.inputs.input_centre) / self.inputs.input_scale

    def about(self, angles: np.ndarray, inputs: np.ndarray) -> LinearModel:
        """The model about an equilibrium, with the joints at `angles` (nq,) under inputs (m,)."""
        forces = self._forces
        controls = np.zeros(self.scene.model.nu)
        command = self.inputs.command(inputs)
        controls[: len(command)] = command
        springs = forces.force(angles, controls) - forces.applied
        stiffness = -forces.tangent()
        w = np.linalg.solve(stiffness, self.mean.T)
        w = np.linalg.solve((self.mean @ w).T, w.T).T
        action = self.action(inputs)
        above, below = np.split(self._command(action + self._shifts), 2)
        by_action = (above - below).T / (2 * _SHIFT)
        return LinearModel(
            w.T @ forces.mass() @ w,
            w.T @ self._damping @ w,
            w.T @ stiffness @ w,
            w.T @ forces.by_controls()[:, : len(by_action)] @ by_action,
            forces.tip_by_turns()[1] @ w,
            -w.T @ springs,
        )


def _damping(model: mujoco.MjModel) -> np.ndarray:
    """(nv, nv) [N m s] of joints and of the springs between them, which is the same anywhere."""
    data, columns = mujoco.MjData(model), []
    mujoco.mj_forward(model, data)
    still = data.qfrc_passive.copy()
    for velocity in np.eye(model.nv):
        data.qvel[:] = velocity
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        columns.append(still - data.qfrc_passive)
    return np.array(columns).T
