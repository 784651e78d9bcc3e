"""The tip of a robot that differs from its model, to first order about where the model is at rest.

Forces f on the joints move a tip at rest by J K^-1 f, with the stiffness K and the tip's Jacobian J
of a robot that is stiffer by a share and carries a weight at its tip. How it gets there along a
path q_0(t) follows from the first modes P of the chain, q = q_0 + P y + what moves with f at once:

    P' (M P y'' + (D + h_v) P y' + (K + h_q) P y - f) = 0,

where h(q, q', q'') are the forces of inertia, with the derivatives h_q and h_v along the path: what
moves fast swings otherwise than what is at rest.
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

#: [rad], by which tendons are turned to see what that changes.
_TURN = 0.01

#: Most modes of the tip; [rad], step of derivatives along one.
_MODES, _STEP = 4, 1e-4


class Path(NamedTuple):
    """How a tip that follows its reference moves: rate (nv,) [rad/s], speed (3,) [m/s]."""

    rate: ndarray
    speed: ndarray

    def since(self, before: "Path", period: float) -> "Path":
        """Mean change of both per time, in a period [s]: jumps of the reference are in it."""
        return Path((self.rate - before.rate) / period, (self.speed - before.speed) / period)


class Nearby(NamedTuple):
    """About a rest, in k coordinates of the tip.

    Attributes:
        rest: Of the robot that differs.
        linear: Its statics.
        forces: (nv, n) [N m], by each of `Differences`.
        by_inputs: (nv, n_inputs) [N m], by the inputs' full scale.
        ways: (n, k) [m], of the tip by them.
        moving: (k,) [m], its way by all that differs but what `rest` accounts for and the offsets.
        held: (nv,) [N m], what `rest` accounts for, over the rest of the model.
        path: Of the tip.
        free, forced: (2 r, 2 r) and (2 r, nv), y and y' a period later by those before, and by f.
        tip, at_once: (k, r) and (k, nv), the tip [m] by y, and by forces at once.
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
    """What is near the rests of a robot's chain.

    Attributes:
        statics: Of the chain.
        reach: [m], of the robot.
        mass: [kg], of the robot.
    """

    def __init__(self, statics: ChainStatics, period: float) -> None:
        """Look at a chain every `period` [s]."""
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
        """Of a robot in space with its tendons turned about the axis."""
        config = self.statics.scene.config
        tendons = tuple(tendon.turned(_TURN) for tendon in config.robot.tendons)
        other = replace(config, robot=replace(config.robot, tendons=tendons))
        return StaticForces(build_scene(other).model)

    @cached_property
    def _uneven(self) -> list[ndarray]:
        """(nv, nv) each, by even springs' forces those of springs stiffer in one direction.

        Stiffer by half of a share towards x, or halfway between x and y, and softer across.
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
        """Number of ways in which the robot may be built otherwise."""
        return 3 if self.statics.scene.config.bending == "spatial" else 0

    def about(
        self, rest: Rest, motion: Motion, differs: Differences, before: "Nearby | None"
    ) -> Nearby | None:
        """What is near a rest; None where the stiffness there is singular.

        Args:
            rest: Of the chain.
            motion: Of the tip, (k,) each, through there.
            differs: How the robot does.
            before: What was near a period ago; None at the start.
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
        """Forces (nv, n) [N m] by each difference, and those (nv,) that a rest accounts for."""
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
        """How the modes go on in a period, and the tip by them and by forces: see `Nearby`."""
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
        """Where a robot that differs holds a target (k,) [m]; None if that is too far away."""
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
        """P' (D + h_v) P and P' h_q P (r, r), along a path of rate and change (nv,) of turns."""
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
        # What is of second order in the rate is left out.
        by_turn = [(force(_STEP * way, none) - here) / _STEP for way in modes.T]
        back = [here - force(none, -way) for way in modes.T]
        by_rate = (np.array(by_rate) + np.array(back)) / 2
        return damping + by_rate.T, np.array(by_turn).T

    def _rate(self, linear: Linear, axes: list[int], velocity: ndarray) -> ndarray:
        """Rate (nv,) [rad/s] of the turns by that of the tip (k,) [m/s] along the rests."""
        tip = linear.tip_by_actions[axes]
        square = tip @ tip.T + self.statics.damping**2 * np.eye(len(axes))
        return linear.by_actions @ (tip.T @ solve(square, velocity))

    def _otherwise(self, rest: Rest, springs: ndarray) -> list[ndarray]:
        """Forces (nv,) [N m] by how the robot may be built, in space.

        With tendons turned about the axis, per rad, and with springs that differ.
        """
        if not self.n_built:
            return []
        controls = self.statics.inverse.controls(rest.place.inputs)
        turned = self._turned.force(rest.place.posture, controls) / _TURN
        return [turned, *(uneven @ springs for uneven in self._uneven)]


def _held(
    inertia: ndarray, damping: ndarray, stiffness: ndarray, period: float
) -> tuple[ndarray, ndarray]:
    """How M y'' + D y' + K y = f goes on in a period under held f: (2 r, 2 r) and (2 r, r)."""
    r = len(inertia)
    rates = np.zeros((3 * r, 3 * r))
    rates[:r, r : 2 * r] = np.eye(r)
    rates[r : 2 * r] = solve(inertia, np.hstack([-stiffness, -damping, np.eye(r)]))
    found = expm(period * rates)[: 2 * r]
    return found[:, : 2 * r], found[:, 2 * r :]
