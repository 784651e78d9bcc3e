"""The tip of a robot that differs from its model, to first order about the model's equilibrium.

Forces f on the joints move a tip at rest by J K^-1 f, with the stiffness K and the tip's Jacobian J
of the robot with its estimated stiffness and tip weight. The motion there, along a path q_0(t),
follows from the first modes P of the chain, q = q_0 + P y + an instantaneous part in f:

    P' (M P y'' + (D + h_v) P y' + (K + h_q) P y - f) = 0,

where h(q, q', q'') are the forces of inertia, with the derivatives h_q and h_v along the path: a
fast robot oscillates differently from one at rest.
"""

from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from numpy import ndarray
from numpy.linalg import solve
from scipy.linalg import eigh, expm

from softrobot_env.scene.build import build_scene
from softrobot_env.scene.inverse import Linear
from softrobot_env.scene.linearised import linearised
from softrobot_env.scene.tangent import StaticForces

from .motion import Differences, Motion
from .statics import ChainStatics, Rest

#: [rad], rotation of the tendons for a difference quotient.
_TURN = 0.01

#: Largest number of modes; [rad], step of derivatives along one.
_MODES, _STEP = 4, 1e-4


class Path(NamedTuple):
    """Motion along the reference: joint rates (nv,) [rad/s], velocity (3,) [m/s] of the tip."""

    rate: ndarray
    speed: ndarray

    def since(self, before: "Path", period: float) -> "Path":
        """Mean rate of change of both over a period [s], including jumps of the reference."""
        return Path((self.rate - before.rate) / period, (self.speed - before.speed) / period)


class Nearby(NamedTuple):
    """Linearisation about a rest, in k coordinates of the tip.

    Attributes:
        rest: Equilibrium of the robot that differs.
        linear: Its statics.
        forces: (nv, n) [N m], due to each of `Differences`.
        by_inputs: (nv, n_inputs) [N m], due to inputs at full scale.
        ways: (n, k) [m], displacements of the tip due to the differences.
        moving: (k,) [m], its displacement due to all differences except those in `rest` and the
            offsets.
        held: (nv,) [N m], forces included in `rest`, beyond the model's rest.
        path: Motion of the tip.
        free, forced: (2 r, 2 r) and (2 r, nv), y and y' a period later from those before, and from
            f.
        tip, at_once: (k, r) and (k, nv), the tip [m] from y, and instantaneously from forces.
    """

    rest: Rest
    linear: Linear
    forces: ndarray
    by_inputs: ndarray
    ways: ndarray
    moving: ndarray
    held: ndarray
    path: Path
    free: ndarray
    forced: ndarray
    tip: ndarray
    at_once: ndarray

    def later(self, mode: ndarray, forces: ndarray) -> tuple[ndarray, ndarray]:
        """y and y' (2 r, n) after a period under forces (nv, n), and the tip (n, k) [m] then."""
        after = self.free @ mode + self.forced @ forces
        return after, (self.tip @ after[: self.tip.shape[1]] + self.at_once @ forces).T


class Neighbourhood:
    """Linearisations about the equilibria of a robot's chain.

    Attributes:
        statics: Of the chain.
        reach: [m], of the robot.
        mass: [kg], of the robot.
    """

    def __init__(self, statics: ChainStatics, period: float) -> None:
        """Linearise a chain every `period` [s]."""
        self.statics, self._period = statics, period
        self.reach = statics.scene.config.robot.reach
        self.mass = statics.scene.model.body_mass.sum()
        self._weight = self.mass * statics.scene.model.opt.gravity
        linear = linearised(statics.inverse, statics.inputs.input_centre)
        self._damping = linear.damping
        stiffness, last = (linear.stiffness + linear.stiffness.T) / 2, min(_MODES, len(linear.mass))
        self.modes = eigh(stiffness, linear.mass, subset_by_index=[0, last - 1])[1]

    @cached_property
    def _turned(self) -> StaticForces:
        """The statics of a spatial robot with its tendons turned about the axis."""
        config = self.statics.scene.config
        tendons = tuple(tendon.turned(_TURN) for tendon in config.robot.tendons)
        other = replace(config, robot=replace(config.robot, tendons=tendons))
        return StaticForces(build_scene(other).model)

    @cached_property
    def _uneven(self) -> list[ndarray]:
        """Matrices (nv, nv) from forces of even springs to those of springs stiffer one way.

        They are stiffer by half of a share along x, or halfway between x and y, and softer across.
        """
        model = self.statics.scene.model
        axes = model.jnt_axis[model.dof_jntid].copy()
        balls = model.jnt_type[model.dof_jntid] == mujoco.mjtJoint.mjJNT_BALL
        axes[balls] = np.tile(np.eye(3), (balls.sum() // 3, 1))
        same = model.dof_bodyid[:, None] == model.dof_bodyid
        sides = ((-0.5, 0.0), (0.0, 0.5)), ((0.0, -0.5), (-0.5, 0.0))
        return [same * (axes[:, :2] @ np.array(side) @ axes[:, :2].T) for side in sides]

    @property
    def n_built(self) -> int:
        """Number of ways in which the robot's build may differ."""
        return 3 if self.statics.scene.config.bending == "spatial" else 0

    def about(
        self, rest: Rest, motion: Motion, differs: Differences, before: "Nearby | None"
    ) -> Nearby | None:
        """The linearisation about a rest; None if the stiffness there is singular.

        Args:
            rest: Of the chain.
            motion: Of the tip through this point, (k,) each.
            differs: How the robot differs.
            before: The linearisation a period ago; None at the start.
        """
        if rest.place is None:
            return None
        world, more = self.statics.world, differs.weight * self._weight
        own = self._own_rest(rest, motion.position, before, differs.stiffer, more)
        place = (own or rest).place
        linear = world.linearised(place.action, place.posture, differs.stiffer, True, more)
        if linear is None:
            return None
        axes = self.statics.axes(len(motion.position))
        rate = self._rate(linear, axes, motion.velocity)
        path = Path(rate, linear.tip_by_turns @ rate)
        change = path.since(path if before is None else before.path, self._period)
        by_inputs = world.by_inputs(linear)
        forces, held = self._forces(linear, rest, by_inputs, path, change, differs)
        offsets = by_inputs @ differs.mean[3 : 3 + by_inputs.shape[1]]
        left = np.column_stack([forces, forces @ differs.mean - held - offsets])
        *ways, moving = (linear.tip_by_turns[axes] @ solve(linear.stiffness, left)).T
        modes = self._modes(linear, axes, place.posture, path, change, differs)
        if not all(np.isfinite(x).all() for x in (*modes, *ways)):  # absurdly fast
            return None
        held = held if own else np.zeros_like(held)
        ways = np.array(ways)
        return Nearby(own or rest, linear, forces, by_inputs, ways, moving, held, path, *modes)

    def _forces(
        self,
        linear: Linear,
        rest: Rest,
        by_inputs: ndarray,
        path: Path,
        change: Path,
        differs: Differences,
    ) -> tuple[ndarray, ndarray]:
        """Forces (nv, n) [N m] due to each difference, and those (nv,) included in a rest."""
        springs, braked = self.statics.world.forces.springs, self._damping @ path.rate
        pulled, inert = (self._weight, self.mass * change.speed) @ linear.tip_by_turns
        always = springs - braked, -(1 + differs.stiffer) * braked, pulled - inert
        forces = np.column_stack([*always, by_inputs, *self._otherwise(rest, springs)])
        return forces, differs.stiffer * springs + differs.weight * pulled

    def _modes(
        self,
        linear: Linear,
        axes: list[int],
        posture: ndarray,
        path: Path,
        change: Path,
        differs: Differences,
    ) -> tuple[ndarray, ndarray, ndarray, ndarray]:
        """Transition of the modes over a period, and the tip from modes and forces (`Nearby`)."""
        by_turns, p = linear.tip_by_turns, self.modes
        carried = differs.weight * self.mass * by_turns.T @ by_turns
        mass, stiffness = self.statics.world.forces.mass() + carried, p.T @ linear.stiffness @ p
        by_rate, by_turn = self._inertial(posture, path.rate, change.rate, differs)
        tip = by_turns[axes]
        at_once = solve(linear.stiffness.T, tip.T).T
        at_once = at_once - tip @ p @ solve(stiffness, p.T)
        free, forced = _held(p.T @ mass @ p, by_rate, stiffness + by_turn, self._period)
        return free, forced @ p.T, tip @ p, at_once

    def _own_rest(
        self, rest: Rest, target: ndarray, before: Nearby | None, stiffer: float, weight: ndarray
    ) -> Rest | None:
        """The rest of a robot that differs, on a target (k,) [m]; None if that is too far away."""
        near = rest.place if before is None else before.rest.place
        solver = self.statics.solver(rest.spatial)
        point = self.statics.point(target, rest.spatial)
        for start in (near, rest.place):
            found = solver.follow(point, start, stiffer=stiffer, weight=weight)
            if found is not None:
                return rest._replace(inputs=found.inputs, place=found)
        return None

    def _inertial(
        self, posture: ndarray, rate: ndarray, turning: ndarray, differs: Differences
    ) -> tuple[ndarray, ndarray]:
        """P' (D + h_v) P and P' h_q P (r, r), for joint rates and accelerations (nv,) of a path."""
        world, modes = self.statics.world, self.modes
        share = (1 + differs.stiffer) * (1 + differs.damped)
        damping = share * modes.T @ self._damping @ modes
        if not (rate.any() or turning.any()):
            return damping, np.zeros_like(damping)
        carried = differs.weight * self.mass

        def force(shift: ndarray, faster: ndarray) -> ndarray:
            moved = world.moved(posture, shift)
            found = world.forces.of_motion(moved, rate + faster, turning, carried)
            return modes.T @ (found - self._damping @ (rate + faster))

        none = np.zeros_like(rate)
        here = force(none, none)
        by_rate = [force(none, way) - here for way in modes.T]
        # Terms of second order in the rate are neglected.
        by_turn = [(force(_STEP * way, none) - here) / _STEP for way in modes.T]
        back = [here - force(none, -way) for way in modes.T]
        by_rate = (np.array(by_rate) + np.array(back)) / 2
        return damping + by_rate.T, np.array(by_turn).T

    def _rate(self, linear: Linear, axes: list[int], velocity: ndarray) -> ndarray:
        """Joint rates (nv,) [rad/s] along the equilibria for a velocity (k,) [m/s] of the tip."""
        tip = linear.tip_by_actions[axes]
        square = tip @ tip.T + self.statics.damping**2 * np.eye(len(axes))
        return linear.by_actions @ (tip.T @ solve(square, velocity))

    def _otherwise(self, rest: Rest, springs: ndarray) -> list[ndarray]:
        """Forces (nv,) [N m] due to differences in the build of a spatial robot.

        Due to tendons turned about the axis, per rad, and due to uneven springs.
        """
        if not self.n_built:
            return []
        controls = self.statics.inverse.controls(rest.place.inputs)
        turned = self._turned.force(rest.place.posture, controls) / _TURN
        return [turned, *(uneven @ springs for uneven in self._uneven)]


def _held(
    inertia: ndarray, damping: ndarray, stiffness: ndarray, period: float
) -> tuple[ndarray, ndarray]:
    """Transition of M y'' + D y' + K y = f over a period of constant f: (2 r, 2 r) and (2 r, r)."""
    r = len(inertia)
    rates = np.zeros((3 * r, 3 * r))
    rates[:r, r : 2 * r] = np.eye(r)
    rates[r : 2 * r] = solve(inertia, np.hstack([-stiffness, -damping, np.eye(r)]))
    found = expm(period * rates)[: 2 * r]
    return found[:, : 2 * r], found[:, 2 * r :]
