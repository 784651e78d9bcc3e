"""Inverse statics of any robot: the inputs in whose equilibrium the tip stands at a point.

Posture q and actions a are found together. One iteration linearises the balance of forces and the
tip about both, by the implicit function theorem on the chain's exact tangent K:

    dq = K^-1 f + Q da,  Q = K^-1 B,  J = (d tip / d q) Q,  J da = p - tip - (d tip / d q) K^-1 f

and takes the da of that least-norm a within [-1, 1] which solves it. What is left free relaxes to
the least norm of the actions, a' = a - (1 - J+ J) a, without a term that would bias the tip: at the
end the tip is on the point to rounding. How far to relax in one iteration follows from the last two
(a secant); where the least norm is far away all the same, the last iterations only close the gap.
Where J loses rank, as in the straight pose, its inverse is damped in proportion to the gap, which
vanishes with it.

Actions are those of tensions, whatever drives the robot: the redundancy of opposing tendons is then
resolved, no tendon is slack, and all is smooth. The lengths that servos pull in follow from posture
and tension, s = s_geo + (F - F_pre) / c, audit of (5.35), or of `tendons.Wires`; the equilibrium
under them is the same, with horns there: servos with a gain give way, which is not corrected.
"""

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import mujoco
import numpy as np
from numpy import ndarray
from numpy.linalg import LinAlgError, eigh, lstsq, norm, solve, svd

from softrobot_env.core.equilibrium import EquilibriumError, positive_definite
from softrobot_env.core.processes import one_blas_thread
from softrobot_env.robots import Drive, RobotParams
from softrobot_env.robots.actuation import TendonMap, by_action, robot_inputs

from .build import Scene, build_scene
from .registry import model_scene
from .statics import finite
from .tangent import StaticForces
from .tendons import Wires, full_length

#: Largest distance of a tip from its point, as a share of the robot's reach, that counts as on it.
REACHED = 1e-7

_ITERATIONS, _RELAXING = 30, 10  # in all, and towards the least norm; later ones close the gap
_LARGEST_STEP, _LARGEST_TURN = 0.3, 1.0  # of an action; rad that all joints make together
_BALANCED = 1e-7  # rad
_RELAXED = 1e-6  # step of an action towards the least norm that is left
_DAMPING = 1e-3  # of the gap times the largest singular value
_RANK = 1e-7  # of the largest singular value
_CLOSE = 1e-2  # of the reach: gaps at which the way to the least norm is found by secants
_PATIENCE, _BETTER = (8, 5), (0.9, 0.5)  # iterations that lessen the gap, or a step close to it
_BEND, _FLAT = (0.25, 20.0), 1e-8  # bounds of what bends the way to the least norm; as good as none
_HALVINGS = 4  # of the way to a point
_LEAST_END = 1 / 64  # of full scale, for the end of a line
_FOLLOWING, _FOLLOWED = 0.5, 5  # of the way to the least norm; iterations of `follow`
_NEARLY = 2e-3  # rad, sum of the turns of all joints in its last iteration
_MISSED = 1e-5  # of the reach: what the damping of the inverse may leave
_NARROW = 1e-3  # of the reach: a tip that moves less to a side moves on a line
_SAME = 1e-6  # N
_PROBES, _GROWTH, _WITHIN = 16, 1.5, 0.75  # of the box of samples: 12 of 16 have to stay within
_MIDDLES, _FAR = 3, 4.0  # that are tried; radii, which a ground is long at most
_PLACES, _TRIALS = 48, 3  # to look for points from


class Held(NamedTuple):
    """Points that inputs hold the tip at.

    Attributes:
        inputs: (n, n_inputs) [N or m], as `robots.actuation.robot_inputs` says.
        postures: (n, nq), their equilibria.
        errors: (n,) [m], distances left; inf where no stable equilibrium was found.
    """

    inputs: ndarray
    postures: ndarray
    errors: ndarray


class Sample(NamedTuple):
    """Stable equilibria under inputs that fill the box of actions evenly.

    Attributes:
        inputs: (n, n_inputs) [N or m]; of the action 0 first.
        postures: (n, nq).
        tips: (n, 3) [m].
        left_out: Number of actions without a stable equilibrium, or beyond the drives' travel.
    """

    inputs: ndarray
    postures: ndarray
    tips: ndarray
    left_out: int


class Place(NamedTuple):
    """Where inputs hold the tip: actions (m,) of tensions, and inputs and posture as of `Held`."""

    action: ndarray
    inputs: ndarray
    posture: ndarray
    error: float


class Linear(NamedTuple):
    """The statics near actions a (m,) of tensions and a posture.

    Attributes:
        balance: (nv,) [rad], turns to the equilibrium.
        by_actions: (nv, m), derivative of the equilibrium.
        tip_by_actions: (k, m) [m], of the tip along the directions.
        tip: (k,) [m], after the turns, along the directions.
        tip_by_turns: (k, nv) [m].
        stiffness: (nv, nv) [N m], of the chain under the tensions.
    """

    balance: ndarray
    by_actions: ndarray
    tip_by_actions: ndarray
    tip: ndarray
    tip_by_turns: ndarray
    stiffness: ndarray


class ReachableEllipse(NamedTuple):
    """Where a tip gets everywhere in a plane, as some rays from a middle tell.

    Attributes:
        middle: (3,) [m].
        inputs: (n_inputs,), which hold the tip there.
        axes: (2, 3), unit vectors along the longest way through the middle, and across.
        length: [m], how far the tip gets along it, to both sides.
        radius: [m], how far it gets to all of 8 sides; zero, about the action 0, for a tip that
            only moves on a line.
    """

    middle: ndarray
    inputs: ndarray
    axes: ndarray
    length: float
    radius: float


class InverseStatics:
    """Inverse statics of a scene, for its robot's inputs.

    Attributes:
        scene: The scene.
        inputs: Of its robot, what `robot_inputs` returns.
        forces: Of the robot last linearised, whatever drives it.
        directions: (k, 3), unit vectors of the world along which the tip's place is asked for.
        tolerance: [m], error of a point that counts as reached.
    """

    def __init__(self, scene: Scene, directions: ndarray | None = None) -> None:
        """Look at a scene.

        Args:
            scene: Of any robot with tendons.
            directions: As of the class. Unless given, in the robot's own axes at its base, across
                and along a planar robot, and the two across a spatial one, whose tip's height
                follows from the statics.

        Raises:
            ValueError: The robot has no inputs, or the directions are no unit vectors (k, 3) at
                right angles.
        """
        robot = scene.config.robot
        self.scene, self.inputs = scene, robot_inputs(robot)
        if self.inputs.n_inputs == 0:
            raise ValueError(f"robot {robot.name!r} has no tendons, hence no inverse statics")
        planar = scene.config.bending == "planar"
        own = robot.clamp.axes.T[[0, 2] if planar else [0, 1]]
        given = own if directions is None else directions
        self.directions = np.atleast_2d(np.asarray(given, float))
        square = self.directions @ self.directions.T
        if self.directions.shape[1] != 3 or np.abs(square - np.eye(len(square))).max() > 1e-9:
            raise ValueError(f"directions must be unit vectors (k, 3) at right angles, got {given}")
        self.tolerance = REACHED * robot.reach
        self._pulled, self._by_tension = scene.config.actuation == "length", scene
        if self._pulled:
            plain = replace(robot, drive=Drive())
            config = replace(scene.config, robot=plain, actuation="tension")
            self._by_tension = build_scene(config)
        self.forces = StaticForces(self._by_tension.model)
        self._tensions = TendonMap(robot)
        self._wires, self._straight = Wires(robot), robot.of_tendons("straight_length")
        self._full = full_length(robot, scene.model)
        self._actions = self._tensions.per_action()
        self._command = self._actions.command
        self._turn = _LARGEST_TURN / len(np.unique(scene.model.dof_bodyid))

    def along(self, directions: ndarray) -> "InverseStatics":
        """The same of the tip's place along other directions (k, 3), unit vectors."""
        other = copy(self)
        other.directions = directions
        other.__dict__.pop("_sample", None)
        return other

    def under(self, forces: StaticForces) -> "InverseStatics":
        """The same of a chain under other forces, such as those with friction."""
        other = copy(self)
        other.forces = forces
        return other

    @property
    def freedom(self) -> int:
        """Number of independent tensions: of coordinates that can be asked for at once, at most."""
        return self._tensions.n_inputs

    @one_blas_thread()
    def solve(
        self, points: ndarray, start: ndarray | Held | None = None, anywhere: bool = True
    ) -> Held:
        """Inputs that hold the tip at points, each from those before it.

        Where a point is too far from the one before, points between are solved first.

        Args:
            points: (n, 3) [m] in the world; only their coordinates along `directions` count.
            start: (n_inputs,), where the first point is looked for from, or what another call
                returned, whose last point it then is; the action 0 unless given.
            anywhere: Whether a point that is not reached from the one before is looked for from
                places all over the workspace. The inputs may then jump.

        Returns:
            The inputs of least norm (of actions) near those before, within the actions' box. Of a
            point that cannot be reached they are those that came nearest, and its error says how
            far off the tip stays; the next point is looked for from the last that was reached.

        Raises:
            ValueError: An argument of another shape, or not finite.
            EquilibriumError: There is no equilibrium at the start.
        """
        points = np.asarray(points, float)
        points = finite("points", points, (len(np.atleast_1d(points)), 3))
        here = self._start(start)
        rows = []
        for point in points @ self.directions.T:
            found = self._towards(point, here, _HALVINGS)
            if anywhere and found.error > self.tolerance:
                found = self._elsewhere(point, found)
            rows.append(found)
            here = found if found.error <= self.tolerance else here
        _, inputs, postures, errors = map(np.array, zip(*rows, strict=True))
        return Held(inputs, postures, errors)

    def place(self, inputs: ndarray, posture: ndarray | None = None) -> Place:
        """Where inputs (n_inputs,) lead, or their equilibrium where it is known.

        Raises:
            EquilibriumError: There is no stable equilibrium.
        """
        posture = self.posture(inputs) if posture is None else posture
        reduced = self._tensions.reduced(self._tension(inputs, posture))
        action = self._tensions.to_actions(reduced)
        return Place(np.clip(action, -1.0, 1.0), inputs, posture, 0.0)

    def by_inputs(self, linear: Linear) -> ndarray:
        """Generalised force (nv, n_inputs) [N m] by a full scale of each input.

        Of the robot last linearised.
        """
        if not self._pulled:
            return linear.stiffness @ linear.by_actions
        arms = self.forces.by_controls()[:, : self.inputs.n_inputs]
        return arms * (self._yields * self.inputs.input_scale)

    def inputs_by(self, action: ndarray, step: ndarray) -> ndarray:
        """Change (n_inputs,) of the inputs that is a change (m,) of actions in a held posture."""
        if not self._pulled:
            return step * self._tensions.input_scale
        return self._wires.stretch(self._command(action + step), self._command(action))

    def tip(self, posture: ndarray) -> ndarray:
        """Tip (3,) [m] in a posture (nq,), in a fiftieth of the time of `Scene.tip`."""
        return self.forces.tip(posture)

    def turns(self, posture: ndarray, other: ndarray) -> ndarray:
        """Turns (nv,) [rad] of the joints from a posture (nq,) to another."""
        out = np.empty(self.scene.model.nv)
        mujoco.mj_differentiatePos(self.scene.model, out, 1.0, posture, other)
        return out

    def controls(self, inputs: ndarray) -> ndarray:
        """Controls (nu,) of the scene that give inputs (n_inputs,)."""
        return _controls(self.scene, self.inputs.command(np.asarray(inputs, float)))

    def follow(
        self,
        point: ndarray,
        near: Place,
        share: float = _FOLLOWING,
        stiffer: float = 0.0,
        weight: ndarray | None = None,
    ) -> Place | None:
        """The place of a point (k,) [m], along `directions`, a small step from another.

        For laws that decide again and again: a few iterations and no search, and a part of the way
        to the least norm.

        Args:
            point: Where the tip should be.
            near: Where it is.
            share: Of the way to the least norm.
            stiffer, weight: See `linearised`.

        Returns:
            The place; None where it is too far, or no stable equilibrium under these tensions.
        """
        action, posture = near.action, near.posture
        for k in range(_FOLLOWED):
            linear = self.linearised(action, posture, stiffer, weight=weight)
            if linear is None:
                return None
            gap = point - linear.tip
            step = least_step(linear.tip_by_actions, gap, action, share if k == 0 else 0.0)
            turn = linear.balance + linear.by_actions @ step
            if np.abs(turn).max() > self._turn or np.abs(step).max() > _LARGEST_STEP:
                return None
            action, posture = action + step, self.moved(posture, turn)
            if np.abs(turn).sum() < _NEARLY:  # what is left is its square
                break
        else:
            return None
        left = float(norm(gap - linear.tip_by_actions @ step))
        missed = left > _MISSED * self.scene.config.robot.reach
        if missed or not positive_definite(linear.stiffness):
            return None
        return Place(action, self.inputs_for(action, posture), posture, left)

    def posture(self, inputs: ndarray, guess: ndarray | None = None) -> ndarray:
        """Stable equilibrium (nq,) under inputs (n_inputs,).

        Raises:
            EquilibriumError: There is none.
        """
        return self.scene.equilibrium(self.controls(inputs), guess)

    def ground(self, largest: float) -> ReachableEllipse:
        """Where in the plane of `directions` the tip gets everywhere.

        The middle is where a spatial robot is under the action 0. A planar one is then as far out
        as it gets; of some bent poses, those with most room to first order, the one with the
        largest disc is taken. The tip counts as there where it is held by the least norm, found
        within the iterations; where no disc is, also where it is held by more.

        Args:
            largest: [1], of an action of a planar robot in the middle.
        """
        planar = self.scene.config.bending == "planar"
        places = self._sample[0] if planar else [self._rest]
        room = [self._room(f) if np.abs(f.action).max() <= largest else 0.0 for f in places]
        narrow = _NARROW * self.scene.config.robot.reach
        wide = [k for k in np.argsort(room)[::-1][:_MIDDLES] if room[k] > narrow]
        best, radius = self._rest, 0.0
        for relaxing in (_ITERATIONS, _RELAXING):
            for k in wide:
                found = self._radius(places[k], max(radius, narrow), relaxing)
                best, radius = (places[k], found) if found > radius else (best, radius)
            if radius > 0:
                break
        axes = self._axes(best) if planar and radius > 0 else np.eye(2)
        length = _FAR * radius
        for way in (-axes[0], axes[0]):
            length = self._along(best, way, length, relaxing)
        middle = self.tip(best.posture)
        return ReachableEllipse(middle, best.inputs, axes @ self.directions, length, radius)

    def _axes(self, found: Place) -> ndarray:
        """Unit vectors (2, 2) along which the tip moves most and least."""
        return svd(self._tip_by_actions(found))[0].T

    def _radius(self, middle: Place, least: float, relaxing: int) -> float:
        """How far [m] the tip gets on the shortest of some rays; 0 where that is `least` or less.

        Across where it moves most comes first, where rays differ most; `relaxing` as in `_near`.
        """
        radius = self.scene.config.robot.reach
        axes = self._axes(middle)
        for k in (2, 6, 0, 4, 1, 5, 3, 7):
            turn = np.pi * k / 4
            towards = np.array([np.cos(turn), np.sin(turn)]) @ axes
            radius = self._along(middle, towards, radius, relaxing)
            if radius <= least:
                return 0.0
        return radius

    def _along(self, start: Place, towards: ndarray, length: float, relaxing: int) -> float:
        """How far [m], up to a length, the tip gets straight on in a direction (k,)."""
        origin = self.directions @ self.tip(start.posture)
        here, distance, step = start, 0.0, length / 12
        while distance < length * (1 - 1e-9) and step > length / 100:
            found = self._near(origin + (distance + step) * towards, here, relaxing)
            if found.error <= self.tolerance:
                here, distance = found, distance + step
            else:
                step /= 2
        return min(distance, length)

    def line(
        self, shares: ndarray, known: tuple[ndarray, ndarray] | None = None
    ) -> tuple[ndarray, ndarray]:
        """Tips (n, 3) [m] and postures (n, nq) under shares (n,) of `farthest`.

        They are followed from the action 0 outwards, NaN from where on no equilibrium is found.

        Args:
            shares: Of the action.
            known: Shares (k,) and postures (k, nq) from another call: each is then found from the
                nearest of these.
        """
        inputs = self.inputs.from_actions(np.outer(shares, self.farthest))
        postures = np.full((len(shares), self.scene.model.nq), np.nan)
        tips = np.full((len(shares), 3), np.nan)
        outwards = np.argsort(np.abs(shares))
        for side in (outwards[shares[outwards] < 0], outwards[shares[outwards] >= 0]):
            posture = self._rest.posture
            for k in side:
                if known is not None:
                    posture = known[1][np.abs(known[0] - shares[k]).argmin()]
                try:
                    posture = self.posture(inputs[k], posture)
                except EquilibriumError:
                    break
                tips[k], postures[k] = self.tip(posture), posture
        return tips, postures

    @cached_property
    def farthest(self) -> ndarray:
        """Action (n_inputs,), of at most 1, along which the tip gets farthest from end to end.

        By what each input does alone, as far as the robot stands: one that pulls the tip back is
        pulled against the others.
        """
        actions = (*np.eye(self.inputs.n_inputs), *-np.eye(self.inputs.n_inputs))
        ends = np.array([self._end(action) for action in actions])
        along = svd(np.subtract(*np.split(ends, 2)))[0][:, 0]
        return along / along[np.abs(along).argmax()]

    def _end(self, action: ndarray) -> ndarray:
        """Tip (3,) [m] under an action, or a half, a quarter and so on where none is stable."""
        share, guess = 1.0, None
        while share >= _LEAST_END:
            try:
                return self.tip(self.posture(self.inputs.from_actions(share * action), guess))
            except EquilibriumError:
                share, guess = share / 2, self._rest.posture
        return self.tip(self._rest.posture)

    def _room(self, found: Place) -> float:
        """How far [m] the tip moves to its worst side before an action reaches its bound."""
        singular = svd(self._tip_by_actions(found), compute_uv=False)
        side = singular[-1] if len(singular) == len(self.directions) else 0.0
        return float(side * (1 - np.abs(found.action).max()))

    def _tip_by_actions(self, found: Place) -> ndarray:
        """(k, m) [m], in an equilibrium; EquilibriumError where the stiffness is singular."""
        linear = self.linearised(found.action, found.posture)
        if linear is None:
            raise EquilibriumError("the stiffness of an equilibrium is singular")
        return linear.tip_by_actions

    def _start(self, start: ndarray | Held | None) -> Place:
        if start is None:
            return self._rest
        if isinstance(start, Held):
            return self.place(start.inputs[-1], start.postures[-1])
        return self.place(finite("start", start, (self.inputs.n_inputs,)))

    @cached_property
    def _rest(self) -> Place:
        return self.place(self.inputs.input_centre)

    def _tension(self, inputs: ndarray, posture: ndarray) -> ndarray:
        """(n_tendons,) [N] at rest."""
        tension = self.inputs.command(inputs)
        if not self._pulled:
            return tension
        limit = self.scene.config.robot.of_tendons("tension_limit")
        return np.clip(self._wires.tension(tension, self._shortened(posture)), 0.0, limit)

    def _shortened(self, posture: ndarray) -> ndarray:
        """How much shorter the tendons (n_tendons,) [m] are than in the straight robot."""
        length = self.forces.tendon_length(posture)[: len(self._full)]
        return self._straight - (length + self._full)

    def controls_for(self, action: ndarray) -> ndarray:
        """Controls of `forces` for actions of tensions."""
        return _controls(self._by_tension, self._command(action))

    def tensions(self, action: ndarray) -> ndarray:
        """(n_tendons,) [N] for actions of tensions."""
        return self._command(action)

    def inputs_for(self, action: ndarray, posture: ndarray) -> ndarray:
        """Inputs (n_inputs,) for actions of tensions, within their box."""
        if not self._pulled:
            return self._tensions.from_actions(action)
        pulled = self._wires.pulled(self._command(action), self._shortened(posture))
        return np.clip(pulled, -self.inputs.input_scale, self.inputs.input_scale)

    @one_blas_thread()
    def sample(self, count: int) -> Sample:
        """Stable equilibria all over the box of actions, by a number of them.

        The actions, of tensions, fill their box evenly; each equilibrium is looked for from that of
        the nearest action found before.
        """
        found = self._spread(count, self._box)
        _, inputs, postures, _ = map(np.array, zip(*found, strict=True))
        return Sample(inputs, postures, self.scene.tip(postures), count + 1 - len(found))

    def _spread(self, count: int, box: float) -> list[Place]:
        found, actions = [self._rest], [self._rest.action]
        for action in box * spread(count, self._tensions.n_inputs):
            near = found[int(np.argmin(norm(np.array(actions) - action, axis=1)))]
            commanded = _controls(self._by_tension, self._command(action))
            try:
                guess = self._ahead(near, action)
                posture = self._by_tension.equilibrium(commanded, guess)
            except EquilibriumError:
                continue
            inputs = self.inputs_for(action, posture)
            if np.all(np.abs(self._tension(inputs, posture) - self._command(action)) < _SAME):
                found.append(Place(action, inputs, posture, 0.0))
                actions.append(action)
        return found

    def _ahead(self, near: Place, action: ndarray) -> ndarray:
        """Posture (nq,) under an action, in steps from a place near it."""
        posture, far = near.posture, float(np.abs(action - near.action).max())
        for part in np.linspace(0, 1, 2 + int(far / _LARGEST_STEP))[1:]:
            here = near.action + part * (action - near.action)
            for _ in range(2):
                linear = self.linearised(here, posture)
                if linear is None:
                    return near.posture
                turn = linear.balance
                posture = self.moved(posture, turn / max(1.0, np.abs(turn).max() / self._turn))
        return posture

    @cached_property
    def _box(self) -> float:
        """Largest action of tensions in samples: 1, or where lengths begin to leave their travel.

        What they do to first order about the action 0, then larger while most of a few are within.
        """
        if not self._pulled:
            return 1.0
        linear = self.linearised(self._rest.action, self._rest.posture)
        if linear is None:
            raise EquilibriumError("the stiffness under the action 0 is singular")
        tensions = by_action(self._actions, self._rest.action)
        shorter = self.forces.by_controls()[:, : len(tensions)].T @ linear.by_actions
        pulled = shorter + tensions / self._yields[:, None]
        box = min(1.0, float((self.inputs.input_scale / norm(pulled, axis=1)).min()))
        while box < 1.0:
            larger = min(1.0, _GROWTH * box)
            if len(self._spread(_PROBES, larger)) <= _WITHIN * _PROBES:
                break
            box = larger
        return box

    @cached_property
    def _sample(self) -> tuple[list[Place], ndarray]:
        """Places to look for points from, and their tips (n, k)."""
        found = self._spread(_PLACES, self._box)
        tips = self.scene.tip(np.array([f.posture for f in found]))
        return found, tips @ self.directions.T

    def _elsewhere(self, point: ndarray, found: Place) -> Place:
        """The point from the nearest places of a sample, if that is better."""
        places, tips = self._sample
        for k in np.argsort(norm(tips - point, axis=1))[:_TRIALS]:
            found = min(found, self._towards(point, places[k], 1), key=lambda f: f.error)
            if found.error <= self.tolerance:
                break
        return found

    def _towards(self, point: ndarray, start: Place, halvings: int) -> Place:
        """The point from a start that is reached, by points between where it is too far."""
        found = self._near(point, start)
        if found.error <= self.tolerance or halvings == 0:
            return found
        between = (point + self.directions @ self.tip(start.posture)) / 2
        half = self._towards(between, start, halvings - 1)
        if half.error > self.tolerance:
            return min(found, self._from(half, point), key=lambda f: f.error)
        return min(found, self._towards(point, half, halvings - 1), key=lambda f: f.error)

    def _from(self, found: Place, point: ndarray) -> Place:
        """The same with its distance to a point, unless it is no equilibrium."""
        if not np.isfinite(found.error):
            return found
        error = norm(self.directions @ self.tip(found.posture) - point)
        return found._replace(error=float(error))

    def _near(self, point: ndarray, start: Place, relaxing: int = _RELAXING) -> Place:
        """Iterate from a start, `relaxing` times towards the least norm besides closing the gap.

        Fewer times where that ends at a kink, where one tendon goes slack as another is pulled. A
        point that comes no nearer from afar is given up.
        """
        action, posture = start.action, start.posture
        share, before, bend = 1.0, None, np.eye(len(action))
        least, stuck = [np.inf, np.inf], [0, 0]  # from afar, and close to the point
        for k in range(_ITERATIONS):
            linear = self.linearised(action, posture)
            if linear is None:
                return Place(action, self.inputs_for(action, posture), posture, np.inf)
            gap, by_actions = point - linear.tip, linear.tip_by_actions
            close = int(before is not None and norm(gap) < _CLOSE * self.scene.config.robot.reach)
            if close:
                share, bend = 1.0, _bent(bend, action, by_actions, *before)
            step = least_step(by_actions, gap, action, share * (k < relaxing), bend=bend)
            before, left = (action, by_actions), norm(step if close else gap)
            stuck[close] = 0 if left < _BETTER[close] * least[close] else stuck[close] + 1
            least[close] = min(left, least[close])
            relaxing = min(relaxing, k) if stuck[1] == _PATIENCE[1] else relaxing
            if stuck[0] == _PATIENCE[0]:
                break
            turn = linear.balance + linear.by_actions @ step
            size = max(np.abs(step).max() / _LARGEST_STEP, np.abs(turn).max() / self._turn, 1.0)
            action = np.clip(action + step / size, -1.0, 1.0)
            posture = self.moved(posture, turn / size)
            if np.abs(turn).max() < _BALANCED and np.abs(step).max() < _RELAXED:
                return self._settled(point, action, posture, linear.stiffness)
            share /= size
        return self._settled(point, action, posture)

    def _settled(
        self, point: ndarray, action: ndarray, posture: ndarray, stiffness: ndarray | None = None
    ) -> Place:
        """What iterations have led to, in a stable equilibrium under the robot's inputs.

        With the stiffness (nv, nv) there, the posture is in balance under the tensions; tendons
        that are driven by length only stiffen it, as long as these lengths are within their travel.
        """
        inputs = self.inputs_for(action, posture)
        travel = self.inputs.input_scale if self._pulled else np.inf
        known = stiffness is not None and np.all(np.abs(inputs) < travel)
        if not (known and positive_definite(stiffness)):
            try:
                posture = self.posture(inputs, posture)
            except EquilibriumError:
                return Place(action, inputs, posture, np.inf)
        return self._from(Place(action, inputs, posture, 0.0), point)

    def linearised(
        self,
        action: ndarray,
        posture: ndarray,
        stiffer: float = 0.0,
        driven: bool = False,
        weight: ndarray | None = None,
        less: ndarray | float = 0.0,
    ) -> Linear | None:
        """The statics near actions (m,) of tensions and a posture (nq,).

        None where the stiffness is singular or not finite.

        Args:
            action, posture: Where.
            stiffer: Share by which springs are stiffer than the robot's.
            driven: Whether by its inputs: where these are lengths, tensions change with the
                posture, and a change of an action is the one that `inputs_by` makes of it.
            weight: (3,) [N], more of it at the tip.
            less: (nv,) [N m], force that a motion takes.
        """
        forces, factor = self.forces, 1 + stiffer
        command = self._command(action)
        controls = _controls(self._by_tension, command)
        self._yields = self._wires.stiffness(command)
        force = factor * forces.force(posture, controls, 1 / factor, weight) - less
        pulled = by_action(self._actions, action)
        arms, stiffness = forces.by_controls()[:, : len(pulled)], -factor * forces.tangent()
        right = arms @ pulled
        if driven and self._pulled:
            stiffness = stiffness + (arms * self._yields) @ arms.T
        try:
            found = solve(stiffness, np.column_stack([force, right]))
        except LinAlgError:
            return None
        if not np.isfinite(found).all():
            return None
        tip, by_turns = forces.tip_by_turns()
        balance, by_actions = found[:, 0], found[:, 1:]
        by_turns = self.directions @ by_turns
        tip = self.directions @ tip + by_turns @ balance
        return Linear(balance, by_actions, by_turns @ by_actions, tip, by_turns, stiffness)

    def moved(self, posture: ndarray, turn: ndarray) -> ndarray:
        """The posture (nq,) after small turns (nv,) [rad] of the joints."""
        moved = posture.copy()
        mujoco.mj_integratePos(self.scene.model, moved, turn, 1.0)
        return moved


def spread(count: int, dimension: int) -> ndarray:
    """Points (count, dimension) that fill the box [-1, 1] evenly, nearest to its middle first.

    The additive recurrence of the generalised golden ratio (Roberts, "The unreasonable
    effectiveness of quasirandom sequences", 2018).
    """
    ratio = 2.0
    for _ in range(60):
        ratio = (1 + ratio) ** (1 / (dimension + 1))
    steps = ratio ** -np.arange(1.0, dimension + 1)
    points = 2 * ((0.5 + np.outer(np.arange(1, count + 1), steps)) % 1.0) - 1
    return points[np.argsort(np.abs(points).max(axis=1))]


def _controls(scene: Scene, commanded: ndarray) -> ndarray:
    """Controls (nu,) of a scene: tensions or lengths (n_tendons,), and no loads."""
    controls = np.zeros(scene.model.nu)
    low, high = scene.model.actuator_ctrlrange[: len(commanded)].T
    within = np.clip(commanded, low, high)
    rounding = np.abs(within - commanded) <= 1e-9 * high
    controls[: len(commanded)] = np.where(rounding, within, commanded)
    return controls


def least_step(
    jacobian: ndarray,
    gap: ndarray,
    action: ndarray,
    share: float,
    damping: float = 0.0,
    bend: ndarray | None = None,
) -> ndarray:
    """Change (m,) of actions that closes a gap (k,) within their box.

    Actions that would leave the box are held at its bounds and the others make up for them.

    Args:
        jacobian: (k, m) [m].
        gap: [m].
        action: Before.
        share: Of the way to the least norm.
        damping: [m], singular values well below it are not inverted.
        bend: (m, m), how the gradient of the norm changes along the tips; the unit matrix, as if
            the jacobian were constant, unless given.
    """
    held = np.full(len(action), np.nan)
    bend = np.eye(len(action)) if bend is None else bend
    while True:
        free = np.isnan(held)
        step = np.where(free, 0.0, held - action)
        if free.any():
            left = gap - jacobian @ step
            slope, within = (action + bend @ step)[free], bend[np.ix_(free, free)]
            step[free] = _free_step(jacobian[:, free], left, slope, share, damping, within)
        beyond = free & (np.abs(action + step) > 1.0)
        if not beyond.any():
            return step
        held[beyond] = np.sign(action + step)[beyond]


def _free_step(
    jacobian: ndarray, gap: ndarray, slope: ndarray, share: float, least: float, bend: ndarray
) -> ndarray:
    """As `least_step`, without the box, for the slope (m,) of half the squared norm."""
    left, singular, right = svd(jacobian)
    singular = singular[singular > _RANK * max(singular[0], 1e-300)]
    if not len(singular):
        return np.zeros(len(slope))
    rank = len(singular)
    damping = _DAMPING * norm(gap) * singular[0] + least**2
    to_point = right[:rank].T @ (singular / (singular**2 + damping) * (left[:, :rank].T @ gap))
    idle = right[rank:]
    if not share or not len(idle):
        return to_point
    values, ways = eigh(idle @ bend @ idle.T)
    idle = ways.T @ idle
    away = idle @ (slope + bend @ to_point) / np.clip(np.abs(values), *_BEND)
    return to_point - share * idle.T @ away


def _bent(
    bend: ndarray, action: ndarray, by_actions: ndarray, last: ndarray, last_by: ndarray
) -> ndarray:
    """What a step between two actions (m,) and jacobians (k, m) tells about `bend`.

    The symmetric rank-one update of the Hessian of the Lagrangian (Nocedal and Wright, "Numerical
    Optimization", 2006, 6.2 and 18.3).
    """
    free = np.abs(action) < 1.0
    holds = lstsq(by_actions[:, free].T, action[free], rcond=_RANK)[0]
    step = action - last
    off = step - (by_actions - last_by).T @ holds - bend @ step
    along = off @ step
    if abs(along) <= _FLAT * norm(off) * norm(step):
        return bend
    return bend + np.outer(off, off) / along


#: Actions of a sample unless said otherwise.
SAMPLE = 300

#: Largest action [1] in the middle of the ground of a planar robot: room is left to all sides.
_BENT = 0.6


@dataclass(frozen=True, eq=False)
class Workspace:
    """Where a robot's tip rests.

    Attributes:
        inverse: Its inverse statics.
        ground: Where the tip gets everywhere, in the plane of its tasks.
    """

    inverse: InverseStatics
    ground: ReachableEllipse

    @property
    def scene(self) -> Scene:
        """Of the robot."""
        return self.inverse.scene


@lru_cache(maxsize=32)
def workspace_of(robot: RobotParams) -> Workspace:
    """The workspace of a robot under its own weight, found once in a process.

    Raises:
        ValueError: The robot has no tendons.
        EquilibriumError: There is none for the action 0.
    """
    inverse = InverseStatics(build_scene(model_scene(robot)))
    return Workspace(inverse, inverse.ground(_BENT))


@lru_cache(maxsize=8)
def sample_of(robot: RobotParams, count: int = SAMPLE) -> Sample:
    """A sample of a robot's workspace by `count` actions; errors as `workspace_of`."""
    return workspace_of(robot).inverse.sample(count)
