"""How far a chain at rest is from the beam it stands for, and how many pieces it needs.

A chain errs by the square of the length of its pieces, so that it is off by 4 / 3 of what halving
them changes, and by more while they are long. Its equilibria are compared with those of the chain
of twice as many pieces all over the robot's range: without inputs, with each of them at full scale
to either side, and with all of them, in directions that alternate in some ways; gravity acts as it
does, loads as they are given. Where the robot has no equilibrium at full scale, or a section folds,
inputs grow in steps as far as they can.

What chains leave out is estimated at the same equilibria: how far stretch and shear of the sections
under the forces of tendons, weight and loads would move the backbone, its bends as they are. In a
robot that is driven by lengths a shorter backbone takes tension from its tendons besides.
"""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from math import ceil, inf, isinf, sqrt
from typing import NamedTuple

import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.robots.actuation import PulledLengths, TendonMap, with_balance

from .chain import joint_angles, posture_like
from .config import SceneConfig
from .kinematics import Kinematics
from .quadrature import HingeLayout
from .spec import build_chain
from .statics import equilibrium

#: Most degrees of freedom of a chain whose pieces are chosen, about as many as three sections with
#: winding tendons have by themselves; a step takes milliseconds then.
MOST_DOFS = 240

#: Share of the length by which stretch and shear may move a robot before `inspect` warns.
STRAINED = 0.005

#: Of what halving the pieces changes, the error in the limit, and room for what it is before that.
_ORDER, _ROOM = 4 / 3, 1.5

#: Parts of full scale at which equilibria are looked for, each from the one before.
_SHARES = (0.1, 0.3, 0.6, 1.0)

#: Paths that may end early before no more are followed.
_PATIENCE = 3

#: Most degrees of freedom of a finer chain that follows paths of its own.
_FOLLOWED = 300

#: Rows of signs with which all inputs act together, and most inputs that act alone.
_TOGETHER, _ALONE = 4, 12

#: Shear coefficient of a round section, as `CosseratRod` has it.
_SHEAR = 0.75


class ResolutionWarning(UserWarning):
    """A scene at rest is less accurate than asked for."""


@dataclass(frozen=True)
class Discretization:
    """How far a chain is from the beam, by what was tried.

    Attributes:
        error: [m], largest distance of an end of a piece at rest from that of infinitely many
            pieces, as estimated; inf where it, or a finer chain, has no such equilibrium.
        left_out: [m], by how much stretch and shear would move it.
        inputs: Number of those that were tried.
        lost: Number of those at which it has an equilibrium at part of full scale only, or none.
    """

    error: float
    left_out: float
    inputs: int
    lost: int


@dataclass(frozen=True)
class _Chain(Kinematics):
    """A chain whose equilibria are sought, as a scene without a timestep."""

    config: SceneConfig
    layout: HingeLayout
    model: mujoco.MjModel

    @property
    def scene(self) -> "_Chain":
        """Itself, see `Kinematics`."""
        return self

    def rest(self, controls: ndarray, guess: ndarray | None) -> ndarray | None:
        """Posture (nq,) at rest near a guess, None if there is none; far from all unless given."""
        nearby = guess is not None
        try:
            return equilibrium(self.model, controls, guess, nearby=nearby)
        except EquilibriumError:
            return None

    def folds(self, q: ndarray) -> bool:
        """Whether a section bends to more than the inverse of its radius."""
        bends = np.hypot.reduce(joint_angles(self.model, q)[:, :2], axis=1) / self.layout.weights
        radius = self.config.robot.backbone.outer_radius(self.layout.stations)
        return bool(np.any(bends * radius > 1))

    def left_out(self, q: ndarray, controls: ndarray) -> float:
        """Way [m] by which stretch and shear move a point of the backbone at rest at q."""
        robot, stations = self.config.robot, self.layout.stations
        backbone, data = robot.backbone, mujoco.MjData(self.model)
        data.qpos[:], data.ctrl[:] = q, controls
        mujoco.mj_forward(self.model, data)
        links = self.model.body("link0").id + np.arange(len(stations))
        frames = data.xmat[links].reshape(-1, 3, 3)
        tension = data.actuator_force[: len(robot.tendons)]
        force = self._outside(data, links) - self._pull(frames, tension)
        across = _SHEAR * backbone.shear(stations)
        stiffness = np.stack([across, across, backbone.axial(stations)], axis=1)
        strain = _turned(frames.transpose(0, 2, 1), force) / stiffness
        moved = np.cumsum(_turned(frames, self.layout.weights[:, None] * strain), axis=0)
        if self.config.actuation == "length":
            moved = moved + self._slackened(q, controls, strain[:, 2])
        return float(np.linalg.norm(moved, axis=1).max())

    def _outside(self, data: mujoco.MjData, links: ndarray) -> ndarray:
        """Weight and loads (stations, 3) [N] beyond each station."""
        robot, stations = self.config.robot, self.layout.stations
        force = self.model.body_subtreemass[links, None] * self.model.opt.gravity
        scales = data.ctrl[len(robot.tendons) :]
        for load, scale in zip(self.config.loads, scales, strict=True):
            site = data.site(f"{load.name}_point").xmat.reshape(3, 3)
            along = site @ load.force if load.follows else np.array(load.force)
            force = force + scale * np.outer(stations < load.station, along)
        return force

    def _pull(self, frames: ndarray, tension: ndarray) -> ndarray:
        """Sum (stations, 3) [N] of the tensions of the tendons that pass each station."""
        stations, force = self.layout.stations, np.zeros((len(frames), 3))
        for tendon, pull in zip(self.config.robot.tendons, tension, strict=True):
            along = np.column_stack([tendon.slope(stations), np.ones(len(stations))])
            along /= np.linalg.norm(along, axis=1, keepdims=True)
            force += _turned(frames, pull * (stations < tendon.end)[:, None] * along)
        return force

    def _slackened(self, q: ndarray, controls: ndarray, strain: ndarray) -> ndarray:
        """Way (stations, 3) [m] by the tension that tendons driven by length lose.

        A tendon of stiffness c gives c / (1 + c a) times the length that its part of the backbone
        loses, if a is the part's own compliance.
        """
        robot, stations = self.config.robot, self.layout.stations
        given = controls.copy()
        for k, tendon in enumerate(robot.tendons):
            part = self.layout.weights * (stations < tendon.end)
            give = tendon.stiffness * np.sum(part / robot.backbone.axial(stations))
            given[k] += np.sum(part * strain) / (1 + give)
        low, high = self.model.actuator_ctrlrange[: len(robot.tendons)].T
        given[: len(robot.tendons)] = given[: len(robot.tendons)].clip(low, high)
        after = self.rest(given, q)
        if after is None:  # it would go far: what it does by itself has to say so
            return np.zeros((len(stations), 3))
        return self.positions(after, stations) - self.positions(q, stations)


class _Rest(NamedTuple):
    """A chain, controls (nu,) and its posture (nq,) at rest."""

    chain: _Chain
    controls: ndarray
    q: ndarray


def _turned(frames: ndarray, vectors: ndarray) -> ndarray:
    """Vectors (n, 3) by matrices (n, 3, 3)."""
    return (frames @ vectors[:, :, None])[:, :, 0]


def discretization(config: SceneConfig) -> Discretization:
    """How far the chain of a scene is from the beam; found once in a process.

    Raises:
        ValueError: A part does not fit the robot.
    """
    plain = _plain(config)
    if config.robot.adaptive_pieces:
        factor, found = _search(plain, adaptive=True)
        if factor * config.robot.pieces == config.n_pieces:
            return found
    return _search(replace(plain, pieces=_counts(config)))[1]


def resolved(config: SceneConfig) -> SceneConfig:
    """The scene with pieces: as many as its accuracy asks for where nobody says any.

    That is where neither the scene nor the file of its robot does. They are then a multiple of the
    robot's, of as many as give `MOST_DOFS` at most.

    Raises:
        ValueError: As `discretization`.

    Warns:
        ResolutionWarning: Once in a process: they do not suffice, or the robot has no equilibrium
            somewhere in its range.
    """
    if config.pieces is not None or not config.robot.adaptive_pieces:
        return config
    plain = _plain(config)
    factor, found = _search(plain, adaptive=True)
    _warn(plain, found)
    return replace(config, pieces=max(factor * config.robot.pieces, config.n_pieces))


def remarks(config: SceneConfig, found: Discretization) -> Iterator[str]:
    """What there is to warn about in a scene whose pieces follow from its accuracy."""
    wanted = config.wanted_accuracy
    if isinf(found.error):
        yield "its chain's error at rest is unknown: a finer chain has another equilibrium, or none"
    elif found.error > wanted:
        yield (
            f"at rest its chain may be {1e3 * found.error:.3g} mm off, {1e3 * wanted:.3g} mm are "
            "wanted: give more `pieces`, or another `accuracy`"
        )
    if found.lost:
        yield (
            f"at {found.lost} of {found.inputs} inputs that were tried it has no equilibrium at "
            "full scale, so the error at rest is unknown there"
        )


@lru_cache(maxsize=128)
def _warn(config: SceneConfig, found: Discretization) -> None:
    """Warn whoever builds a scene, once."""
    for remark in remarks(config, found):
        warnings.warn(f"robot {config.robot.name!r}: {remark}", ResolutionWarning, stacklevel=4)


def _plain(config: SceneConfig) -> SceneConfig:
    """The scene without what its equilibria do not depend on."""
    return SceneConfig(
        config.robot,
        rule=config.rule,
        actuation=config.actuation,
        loads=config.loads,
        bending=config.bending,
        torsion=config.torsion,
        accuracy=config.accuracy,
        channels=config.channels,
    )


def _counts(config: SceneConfig) -> tuple[int, ...]:
    """Pieces of each section."""
    ends = np.searchsorted(config.edges, config.robot.backbone.ends * (1 - 1e-9))
    return tuple(np.diff(ends).tolist())


def _chain(config: SceneConfig, factor: int) -> _Chain:
    """The chain of a scene with so many times its pieces."""
    finer = replace(config, pieces=tuple(factor * n for n in _counts(config)))
    return _Chain(finer, finer.layout, build_chain(finer).spec.compile())


@lru_cache(maxsize=128)
def _search(config: SceneConfig, adaptive: bool = False) -> tuple[int, Discretization]:
    """How many times a scene's pieces its accuracy asks for, and the error with them.

    Unless pieces are adaptive they are as they are.
    """
    chain, factor = _chain(config, 1), 1
    most = max(1, MOST_DOFS // chain.model.nv) if adaptive else 1
    near, lost = _everywhere(chain)
    left_out = max((chain.left_out(rest.q, rest.controls) for rest in near), default=0.0)
    error, near = _compared(config, factor, near, [*near])
    while error > config.wanted_accuracy and factor < most and near:
        larger, finer = sqrt(error / config.wanted_accuracy), 2 * factor
        factor = min(most, finer, ceil(factor * larger) if larger < 2 else most)
        if factor == finer:  # it is known already
            pieces = finer * chain.layout.pieces
            rests = [x if x.chain.layout.pieces == pieces else None for x in near]
        else:
            rests = _moved(near, _chain(config, factor))
        error, near = _compared(config, factor, near, rests)
    return factor, Discretization(error, left_out, len(_controls(chain)[1]), lost)


def _compared(
    config: SceneConfig, factor: int, near: list[_Rest], rests: list[_Rest | None]
) -> tuple[float, list[_Rest]]:
    """Error [m] of a chain at rest, with so many times the pieces; and all at rest in a finer one.

    Of chains that do not stand near they keep what is near; none are left if a finer chain is too
    light for MuJoCo.
    """
    try:
        finer = _moved(near, _chain(config, 2 * factor))
    except ValueError:
        return inf, []
    error = _ROOM * _ORDER * max(map(_distance, rests, finer), default=inf)
    return error, [two or one for one, two in zip(near, finer, strict=True)]


def _moved(rests: list[_Rest], chain: _Chain) -> list[_Rest | None]:
    """Another chain at rest near the same, or where its own path leads; until one ends early.

    The paths of chains that only tell the error of large ones would take most of the time.
    """
    out, follows = [], chain.model.nv <= _FOLLOWED
    for other in rests:
        q = chain.rest(other.controls, posture_like(chain, other.chain, other.q))
        if q is None and follows:
            q = chain.rest(other.controls, None)
            follows = q is not None
        out.append(None if q is None else _Rest(chain, other.controls, q))
    return out


def _everywhere(chain: _Chain) -> tuple[list[_Rest], int]:
    """The chain at rest all over its robot's range, and under how many inputs it is lost.

    Paths of growing loads that end early take long: after some of them steps are taken.
    """
    none, rows = _controls(chain)
    rests, lost, ended = [], 0, 0
    for row in rows:
        q = chain.rest(row, None) if ended < _PATIENCE else None
        ended += q is None
        if q is None and rests:
            q = chain.rest(row, rests[0].q)
        if q is None or chain.folds(q):
            rest, gone = _in_steps(chain, none, row)
        else:
            rest, gone = _Rest(chain, row, q), False
        lost += gone
        if rest is not None:
            rests.append(rest)
    return rests, lost


def _in_steps(chain: _Chain, none: ndarray, row: ndarray) -> tuple[_Rest | None, bool]:
    """The chain at rest as near to controls as it gets on the way from none, before it folds.

    And whether it is lost on the way: there is no equilibrium further on.
    """
    reached, q = None, None
    for share in _SHARES:
        controls = none + share * (row - none)
        q = chain.rest(controls, q)
        if q is None:
            return reached, True
        if chain.folds(q):
            break
        reached = _Rest(chain, controls, q)
    return reached, False


def _distance(one: _Rest | None, two: _Rest | None) -> float:
    """Largest distance [m] of ends of pieces of the first, or of a head; inf without both."""
    if one is None or two is None:
        return inf
    stations = one.chain.config.edges[1:]
    gaps = one.chain.positions(one.q, stations) - two.chain.positions(two.q, stations)
    if one.chain.config.robot.head is not None:
        gaps = np.append(gaps, [one.chain.tip(one.q) - two.chain.tip(two.q)], axis=0)
    return float(np.linalg.norm(gaps, axis=1).max())


def _controls(chain: _Chain) -> tuple[ndarray, list[ndarray]]:
    """Controls (nu,) of no input and no load, and those from all over the robot's range."""
    config, robot = chain.config, chain.config.robot
    pulled = config.actuation == "length"
    inputs = PulledLengths(robot) if pulled else TendonMap(with_balance(robot))
    low, high = chain.model.actuator_ctrlrange[: len(robot.tendons)].T

    def controls(action: ndarray, load: float) -> ndarray:
        command = inputs.command(inputs.from_actions(action)).clip(low, high)
        return np.append(command, np.full(len(config.loads), load))

    count = inputs.n_inputs
    none = np.zeros(count) if pulled else -inputs.input_centre / inputs.input_scale
    actions = [none]
    for k in range(min(count, _ALONE)):
        for sign in (1.0, -1.0):
            actions.append(none.copy())
            actions[-1][k] = sign
    places = np.arange(count)
    together = [np.zeros(count, int), *(places >> k & 1 for k in range(_TOGETHER - 1))]
    actions += [1.0 - 2.0 * signs for signs in together]
    rows = [controls(action, 1.0) for action in actions]
    rest = controls(none, 0.0)
    different = {row.tobytes(): row for row in (rest, *rows)}
    return rest, list(different.values())
