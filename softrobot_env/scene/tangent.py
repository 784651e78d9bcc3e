"""Static forces of a chain in any posture, and their exact derivative.

At rest the generalised force on the joints is that of their springs, of the tendons (tension times
the derivative of length, which is constant along joints) and of wrenches that act on the links:
weights and loads. Turn k of a joint, about the unit axis a_k through p_k, feels

    f_k = a_k . N_k,    N_k = sum over the wrenches beyond k of  m + r_k x F,    r_k = x - p_k,

and another turn l moves what lies beyond it. With K_k = sum of r_k F^T - (r_k . F) I the derivative
for wrenches of fixed direction is

    d f_k / d l = a_k . K_l a_l                       where l lies beyond k, else
                  a_k . K_k a_l + a_l . (a_k x N_k),

so that sums from the tip to the base and three products of (nv, 3) matrices give all of it, in
O(nv^2). The turns of one ball joint all move each other's axes. Follower loads add that their
vectors turn. A tendon's span from one guide to the next, along the unit vector u, has a length that
depends on the turns between its ends only; its second derivative is, with v_k = a_k x r_k the way
of its upper end,

    u . (a_l x v_k) where l moves a_k, else u . (a_k x v_l);    plus (v_k x u) . (v_l x u) / length.

Driven by length or held by a spring, tension follows from length. A ball joint's spring -k theta(q)
has the derivative -k J^-1 of the rotation vector.

The derivative is along `mj_integratePos`; out of equilibrium a ball joint makes it unsymmetric.
"""

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from mujoco import MjData, MjModel, mjtJoint, mjtTrn, mjtWrap
from numpy import ndarray
from numpy.linalg import norm

from .chain import TIP_SITE, backbone_lengths
from .integration import layout
from .tendons import actuator_arms, is_ideal, tendon_arms

#: [rad] of a bend of the whole robot at which friction of its backbone is whole.
_GIVE = 0.01

#: [m] of sliding at which a tendon's friction is whole.
_LOOSE = 2e-5

#: The same of a zone, over the robot's length; by what share [1] creep may change friction.
_LOOSE_ZONE, _CREEP = 1e-5, 1e-2


class StaticForces:
    """Forces on a chain at rest and their derivative, for postures of one compiled scene.

    Attributes:
        model: The scene's model; its gravity may change between calls.
        springs: (nv,) [N m], of the last `force` the part of the joints' springs.
        applied: (nv,) [N m], the other part of it, at a share of 1.
    """

    def __init__(self, model: MjModel, by_servos: bool = False) -> None:
        """Look up what moves what.

        Args:
            model: The model.
            by_servos: Whether controls are commands of servos, which give way at rest as their
                gain and limit let them; else they say where the horns are.

        Raises:
            ValueError: The model is no chain, or has parts whose static forces are not known here.
        """
        self.model, self._data, self._share = model, MjData(model), 1.0
        if model not in _STRUCTURES:
            _STRUCTURES[model] = _structure(model)
        self._of = _STRUCTURES[model]
        self._tip, self._pull = model.site(TIP_SITE).id, np.zeros(3)
        self._placed: ndarray | None = None  # the posture whose tendons are known
        self._laws = None if is_ideal(model) else _laws(model, by_servos)
        #: (nu,), stiffness of a drive and its force per control, over those of its spring.
        self._by_slack, self._by_control = np.ones((2, model.nu))

    def force(
        self, qpos: ndarray, ctrl: ndarray, share: float = 1.0, pull: ndarray | None = None
    ) -> ndarray:
        """Generalised force (nv,) [N m] on the chain at rest.

        Args:
            qpos: (nq,) posture.
            ctrl: (nu,) controls.
            share: Factor on all forces but those of the joints' springs.
            pull: (3,) [N] at the tip, along fixed directions; none unless given.
        """
        model, data = self.model, self._data
        self._share, self._pull = share, np.zeros(3) if pull is None else pull
        data.ctrl[:] = ctrl
        self._place(qpos)
        mujoco.mj_transmission(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        if self._laws is not None:
            self._apply_laws(ctrl)
        self.springs = data.qfrc_passive.copy()
        self.applied = data.qfrc_actuator - data.qfrc_bias
        if self._pull.any():
            self.applied += self._pull @ self.tip_by_turns()[1]
        return self.springs + share * self.applied

    def _apply_laws(self, ctrl: ndarray) -> None:
        """Give drives of lengths the forces of their servos and wires."""
        from .integration.motors import hold_all  # compiled code takes time to load

        model, data, (drives, places) = self.model, self._data, self._laws
        bias, stiffness = model.actuator_biasprm[places], drives[:, 0]
        slack = (bias[:, 0] + bias[:, 1] * data.actuator_length[places]) / stiffness
        slack += drives[:, layout.TAKEN]
        limits = np.ascontiguousarray(model.actuator_forcerange[places, 1])
        _, tension, *rates = hold_all(drives.ravel(), ctrl[places], slack, limits)
        more = np.zeros(model.nu)
        more[places] = tension - data.actuator_force[places]
        data.actuator_force[:] += more
        data.qfrc_actuator[:] += more @ actuator_arms(model, data)
        self._by_slack[places], self._by_control[places] = rates / stiffness

    def tangent(self) -> ndarray:
        """Derivative (nv, nv) [N m] of the last `force` by small turns (nv,) of the joints."""
        axes, anchors = self._data.cdof[:, :3], self._data.xanchor[self.model.dof_jntid]
        tension, rate = self._tensions()
        out = self._dead(axes, anchors)
        self._add_followers(axes, anchors, out)
        self._add_spans(axes, anchors, self._along(tension), out)
        self._add_rates(rate, out)
        out *= self._share
        self._add_springs(out)
        return out

    def by_controls(self) -> ndarray:
        """Derivative (nv, nu) [N m] of the last `force` by the controls, at a share of 1."""
        model, data = self.model, self._data
        gain = model.actuator_gainprm[:, 0] * self._unlimited(np.arange(model.nu))
        gain = gain * self._by_control
        return (gain[:, None] * actuator_arms(model, data)).T

    def tip(self, qpos: ndarray) -> ndarray:
        """Tip (3,) [m] in a posture (nq,)."""
        if not np.array_equal(self._placed, qpos):
            self._placed, self._data.qpos[:] = None, qpos
            mujoco.mj_kinematics(self.model, self._data)
        return self._data.site_xpos[self._tip].copy()

    def tendon_length(self, qpos: ndarray) -> ndarray:
        """Lengths (ntendon,) [m] in a posture (nq,), as MuJoCo counts them."""
        self._place(qpos)
        return self._data.ten_length.copy()

    def _place(self, qpos: ndarray) -> None:
        """Take a posture (nq,), unless it is taken already."""
        if np.array_equal(self._placed, qpos):
            return
        self._placed = self._data.qpos[:] = qpos.copy()
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_tendon):
            compute(self.model, self._data)

    def tip_by_turns(self) -> tuple[ndarray, ndarray]:
        """Tip (3,) [m] in the posture of the last `force`, and its derivative (3, nv) by turns."""
        out = np.empty((3, self.model.nv))
        mujoco.mj_jacSite(self.model, self._data, out, None, self._tip)
        return self._data.site_xpos[self._tip].copy(), out

    def mass(self) -> ndarray:
        """Mass matrix (nv, nv) [kg m2] in the posture of the last `force`."""
        out = np.empty((self.model.nv, self.model.nv))
        mujoco.mj_makeM(self.model, self._data)
        mujoco.mj_fullM(self.model, self._data, out)
        return out

    def of_motion(
        self, qpos: ndarray, qvel: ndarray, qacc: ndarray, carried: float = 0.0
    ) -> ndarray:
        """Generalised force (nv,) [N m] of inertia and damping: what a motion takes over a rest.

        Args:
            qpos: (nq,) posture.
            qvel, qacc: (nv,) [rad/s, rad/s2].
            carried: [kg] more at the tip.
        """
        model, data = self.model, self._data
        self._place(qpos)
        mujoco.mj_transmission(model, data)
        out = np.empty(model.nv)
        mujoco.mj_makeM(model, data)
        mujoco.mj_mulM(model, data, out, qacc)
        for sign, velocity in ((1, qvel), (-1, 0.0)):
            data.qvel[:] = velocity
            mujoco.mj_fwdVelocity(model, data)
            out += sign * (data.qfrc_bias - data.qfrc_passive)
            if carried and sign > 0:
                tip, by_turns = self.tip_by_turns()
                change = np.empty_like(by_turns)
                mujoco.mj_jacDot(model, data, change, None, tip, model.site_bodyid[self._tip])
                out += carried * (by_turns.T @ (by_turns @ qacc + change @ qvel))
        return out

    def _dead(self, axes: ndarray, anchors: ndarray) -> ndarray:
        """(nv, nv) of weights and loads as if they kept their directions."""
        points, forces, moments = self._wrenches()
        dyads = (points[:, :, None] * forces[:, None, :]).reshape(-1, 9)
        parts = np.concatenate([forces, moments, dyads], axis=1)[self._of.from_tip]
        sums = np.concatenate([np.zeros((1, 15)), np.cumsum(parts, axis=0)])[self._of.beyond]
        total, moment, dyad = sums[:, :3], sums[:, 3:6], sums[:, 6:].reshape(-1, 3, 3)
        dyad = dyad - anchors[:, :, None] * total[:, None, :]  # sum of r F^T
        flat = dyad.reshape(-1, 9)
        moment = moment + flat[:, [5, 6, 1]] - flat[:, [7, 2, 3]]
        traced = (flat[:, 0] + flat[:, 4] + flat[:, 8])[:, None] * axes
        by_own = (axes[:, None] @ dyad)[:, 0] - traced
        by_other = (dyad @ axes[:, :, None])[:, :, 0] - traced
        turned = _cross(axes, moment)  # where l moves a_k
        out = np.where(self._of.before, (by_own + turned) @ axes.T, axes @ by_other.T)
        k, other = self._of.ahead
        out[k, other] += (turned[k] * axes[other]).sum(axis=1)
        return out

    def _wrenches(self) -> tuple[ndarray, ndarray, ndarray]:
        """Points, forces and moments (k, 3) on the links: weights, the pull, and loads."""
        model, data = self.model, self._data
        first = model.nbody + 1
        points = np.concatenate([data.xipos, data.site_xpos[[self._tip, *self._of.sites]]])
        forces, moments = np.zeros((2, len(points), 3))
        forces[: model.nbody] = model.body_mass[:, None] * model.opt.gravity
        forces[model.nbody] = self._pull
        if len(self._of.on_sites):
            forces[first:], moments[first:] = self._loads()
        return points, forces, moments

    def _loads(self) -> tuple[ndarray, ndarray]:
        """Forces and moments (loads, 3) in the world's axes."""
        gear = self.model.actuator_gear[self._of.on_sites].reshape(-1, 2, 3)
        frames = self._data.site_xmat[self._of.frames].reshape(-1, 3, 3)
        scaled = self._data.actuator_force[self._of.on_sites, None, None] * gear
        world = scaled @ frames.transpose(0, 2, 1)
        return world[:, 0], world[:, 1]

    def _tensions(self) -> tuple[ndarray, ndarray]:
        """Tension (ntendon,) [N] that drives give, and its derivative by length [N/m]."""
        model, data, actuators = self.model, self._data, self._of.on_tendons
        gear = model.actuator_gear[actuators, 0]
        force, spring = data.actuator_force[actuators], model.actuator_biasprm[actuators, 1]
        free = self._unlimited(actuators)
        tension, rate = np.zeros(model.ntendon), np.zeros(model.ntendon)
        tendon = model.actuator_trnid[actuators, 0]
        np.add.at(tension, tendon, -gear * force)
        np.add.at(rate, tendon, -(gear**2) * spring * free * self._by_slack[actuators])
        return tension, rate

    def _along(self, tension: ndarray) -> list[ndarray]:
        """Tensions [N] of the spans, group by group, from those of tendons."""
        return [tension[spans.tendon] for spans in self._of.spans]

    def _unlimited(self, actuators: ndarray) -> ndarray:
        """Which of some actuators are not at the limit of their force."""
        force = self._data.actuator_force[actuators]
        low, high = self.model.actuator_forcerange[actuators].T
        limited = self.model.actuator_forcelimited[actuators].astype(bool)
        return ~limited | ((low < force) & (force < high))

    def _add_followers(self, axes: ndarray, anchors: ndarray, out: ndarray) -> None:
        """The turning of loads that follow their cross-section."""
        if not len(self._of.followers):
            return
        force, moment = self._loads()
        for load in self._of.followers:
            site, f, m = self._of.sites[load], force[load], moment[load]
            n = self._of.moving[self.model.site_bodyid[site]]
            a, arm = axes[:n], self._data.site_xpos[site] - anchors[:n]
            out[:n, :n] += a @ _cross(a, m).T + _cross(a, arm) @ _cross(a, f).T

    def _add_spans(
        self, axes: ndarray, anchors: ndarray, tensions: list[ndarray], out: ndarray
    ) -> None:
        """Tensions times the curvature of the lengths between guides."""
        places = self._data.site_xpos
        for spans, tension in zip(self._of.spans, tensions, strict=True):
            turns, end = spans.turns, places[spans.end]
            span = end - places[spans.start]
            length = norm(span, axis=1)[:, None]
            axis, arm = axes[turns] * spans.real, end[:, None] - anchors[turns]
            across = _cross(_cross(axis, arm), (span / length)[:, None])
            pulled = tension[:, None, None] * across
            later = axis @ pulled.transpose(0, 2, 1)
            block = np.where(spans.moves, later.transpose(0, 2, 1), later)
            block += pulled / length[:, None] @ across.transpose(0, 2, 1)
            np.subtract.at(out.ravel(), spans.places, block.ravel())

    def _add_rates(self, rate: ndarray, out: ndarray) -> None:
        """Tension that follows from length, by its derivative (ntendon,) [N/m]."""
        model, data = self.model, self._data
        size, begin = model.ten_J_rownnz, model.ten_J_rowadr
        if not rate.any():
            return
        for n in np.unique(size[rate != 0]):
            rows = np.flatnonzero((size == n) & (rate != 0))
            place = begin[rows, None] + np.arange(n)
            column, arm = model.ten_J_colind[place], data.ten_J[place]
            block = (rate[rows, None] * arm)[:, :, None] * arm[:, None, :]
            np.subtract.at(out, (column[:, :, None], column[:, None, :]), block)

    def _add_springs(self, out: ndarray) -> None:
        """Springs of joints, and those along the hinges of a station."""
        model, data = self.model, self._data
        dof, address = model.jnt_dofadr[self._of.hinges], model.jnt_qposadr[self._of.hinges]
        angle = data.qpos[address] - model.qpos_spring[address]
        law = model.jnt_stiffness[self._of.hinges], model.jnt_stiffnesspoly[self._of.hinges]
        out[dof, dof] -= _spring_rate(angle, *law)
        if model.ntendon:
            stretch = data.ten_length - model.tendon_lengthspring[:, 0]
            law = model.tendon_stiffness, model.tendon_stiffnesspoly
            self._add_rates(_spring_rate(stretch, *law), out)
        balls = self._of.balls
        if not len(balls):
            return
        address = model.jnt_qposadr[balls, None] + np.arange(4)
        dof = model.jnt_dofadr[balls, None] + np.arange(3)
        turn = _rotation_vectors(self._data.qpos[address], model.qpos_spring[address])
        blocks = model.jnt_stiffness[balls, None, None] * _rotation_rates(turn)
        out[dof[:, :, None], dof[:, None, :]] -= blocks


def _laws(model: MjModel, by_servos: bool) -> tuple[ndarray, ndarray]:
    """Parameters (k, DRIVE_SIZE) of drives by length, see `integration.layout`, and which (k,)."""
    places = np.flatnonzero(model.actuator_biasprm[:, 1] < 0)
    drives = model.actuator_gainprm[places]
    if not by_servos:
        drives[:, [layout.GAIN, layout.COUNT]] = 0.0
    return drives, places


class RubbingForces(StaticForces):
    """The same with dry friction of tendons and backbone, which depends on where they came from.

    A tendon that rubs keeps its length as long as that takes no more than its friction, and a
    station its bend; beyond, they slide and the friction opposes it. Where the backbone rubs, that
    of a tendon is no more than its tension. All break loose within `_LOOSE`, or within a bend of
    `_GIVE` of the whole robot.

    A zone (`integration.capstan`) keeps the length beyond it. With the share s of its friction, -1
    to 1, that this takes, tension grows there by the factor exp(s mu a). It breaks loose within
    `_LOOSE_ZONE` of the robot's length, by which it creeps; `hold` takes that back, as multipliers
    do what a penalty allows (the augmented Lagrangian of constrained optimisation).

    Attributes:
        anchors: (ntendon + zones,) [m], lengths at which friction would vanish, of tendons and then
            of what lies beyond zones; set them before `force`.
        came: (ntendon + zones,) [m], the same lengths at the last `stay`.
        posture: (nq,) at which friction of the joints would vanish.
    """

    def __init__(self, model: MjModel, posture: ndarray, by_servos: bool = False) -> None:
        """Tendons and joints that came to rest in a posture (nq,) without friction."""
        from .integration.zones import Zones  # takes time to load

        super().__init__(model, by_servos)
        self._most, self._zones = model.tendon_frictionloss.copy(), Zones(model)
        self._tendon = model.actuator_trnid[self._zones.drive, 0]
        self._moved = np.arange(model.nv) >= self._zones.first[:, None]
        self._spans_beyond = [
            (x.tendon == self._tendon[:, None]) & (x.turns[:, 0] >= self._zones.first[:, None])
            for x in self._of.spans
        ]
        # What lies beyond zones of one tendon lies beyond those before: sums from base to tip.
        self._upto = np.tril(self._tendon[:, None] == self._tendon)
        loose = _LOOSE_ZONE * backbone_lengths(model).sum()
        self._loose = np.repeat([_LOOSE, loose], [model.ntendon, len(self._tendon)])
        self._bends = _bends(model)
        self._holding = model.dof_frictionloss[self._bends[:, :1]]
        self._give = _GIVE / max(len(self._bends), 1)
        self._away = np.zeros(self._bends.shape)  # from where friction vanishes, over what gives
        self._place(posture)
        self.came, self.posture = self._lengths(), posture.copy()
        self.anchors, self._slid = self.came.copy(), np.zeros(len(self.came))

    def loosen(self, factor: float) -> None:
        """Let all break loose within `factor` times as much, from the friction at `came`."""
        self.anchors = self.came + factor * (self.anchors - self.came)
        self._loose = factor * self._loose

    def hold(self) -> bool:
        """Whether zones crept that stick; then let them hold by as much as they do by creeping.

        Where they are was found with the last `force`, and has to be found again.
        """
        zones = slice(self.model.ntendon, None)
        slid, loose = self._slid[zones], self._loose[zones]
        crept = np.where(np.abs(slid) < 1, self._lengths()[zones] - self.came[zones], 0.0)
        friction = super()._tensions()[0][self._tendon] * self._zones.exponents(self._data)
        if friction @ np.abs(crept) <= _CREEP * (friction @ loose):
            return False
        self.anchors[zones] = self.came[zones] - loose * slid
        return True

    def force(
        self, qpos: ndarray, ctrl: ndarray, share: float = 1.0, pull: ndarray | None = None
    ) -> ndarray:
        """See `StaticForces`."""
        super().force(qpos, ctrl, share, pull)
        model, data = self.model, self._data
        self._slid = np.clip((self._lengths() - self.anchors) / self._loose, -1.0, 1.0)
        pull = self._bound() * self._slid[: model.ntendon]
        self.applied = self.applied - pull @ tendon_arms(model, data)
        if len(self._tendon):
            self.applied -= self._drops() @ self._arms()
        if len(self._bends):
            turned = np.zeros(model.nv)
            mujoco.mj_differentiatePos(model, turned, 1.0, self.posture, qpos)
            self._away = turned[self._bends] / self._give
            self.applied[self._bends] -= self._holding * self._held()
        return data.qfrc_passive + share * self.applied

    def by_controls(self) -> ndarray:
        """See `StaticForces`."""
        out = super().by_controls()
        if not len(self._tendon):
            return out
        beyond, before = self._grown()
        pulls = -self.model.actuator_gear[:, 0] * self.model.actuator_gainprm[:, 0]
        pulls = pulls * self._unlimited(np.arange(self.model.nu)) * self._by_control
        of_zones = self._tendon[:, None] == self.model.actuator_trnid[:, 0]
        return out - self._arms().T @ ((beyond - before)[:, None] * of_zones * pulls)

    def tangent(self) -> ndarray:
        """See `StaticForces`."""
        out = super().tangent()
        if len(self._tendon):
            out -= self._share * self._arms().T @ self._drop_rates()
        if len(self._bends):
            way = self._held()
            far = np.maximum(norm(self._away, axis=1), 1.0)[:, None, None]
            across = np.where(far > 1, way[:, :, None] * way[:, None, :], 0.0)
            rate = self._holding[:, :, None] / self._give * (np.eye(way.shape[1]) - across) / far
            out[self._bends[:, :, None], self._bends[:, None, :]] -= self._share * rate
        return out

    def _lengths(self) -> ndarray:
        """(ntendon + zones,) [m] of tendons, and of what lies beyond zones."""
        model, data = self.model, self._data
        if not len(self._tendon):
            return data.ten_length.copy()
        angles = data.qpos[model.jnt_qposadr[model.dof_jntid]]
        along_joints = model.wrap_type[model.tendon_adr[self._tendon]] == mjtWrap.mjWRAP_JOINT
        beyond = np.where(along_joints, self._arms() @ angles, 0.0)
        for spans, own in zip(self._of.spans, self._spans_beyond, strict=True):
            beyond += own @ norm(data.site_xpos[spans.end] - data.site_xpos[spans.start], axis=1)
        return np.append(data.ten_length, beyond)

    def _arms(self) -> ndarray:
        """Moment arms (zones, nv) [m] of what lies beyond zones."""
        return tendon_arms(self.model, self._data)[self._tendon] * self._moved

    def _grown(self) -> tuple[ndarray, ndarray]:
        """Ratio (zones,) [1] of tensions beyond zones to the drives', and before them."""
        exponents = self._zones.exponents(self._data) * self._slid[self.model.ntendon :]
        total = self._upto @ exponents
        return np.exp(total), np.exp(total - exponents)

    def _drops(self) -> ndarray:
        """(zones,) [N] by which tension grows there."""
        beyond, before = self._grown()
        return super()._tensions()[0][self._tendon] * (beyond - before)

    def _drop_rates(self) -> ndarray:
        """Derivative (zones, nv) [N] of `_drops` by small turns."""
        tension, rate = super()._tensions()
        slid, own = self._slid[self.model.ntendon :], self._arms()
        loose = (np.abs(slid) < 1) / self._loose[self.model.ntendon :]
        exponents, slopes = self._zones.exponents(self._data), self._zones.slopes(self._data)
        of_own = slid[:, None] * slopes + (exponents * loose)[:, None] * own
        of_all = self._upto @ of_own
        beyond, before = (x[:, None] for x in self._grown())
        arms = tendon_arms(self.model, self._data)[self._tendon]
        by_tension = (beyond - before) * rate[self._tendon, None] * arms
        by_ratio = beyond * of_all - before * (of_all - of_own)
        return by_tension + tension[self._tendon, None] * by_ratio

    def _along(self, tension: ndarray) -> list[ndarray]:
        alike, drops = super()._along(tension), self._drops()
        return [x + drops @ own for x, own in zip(alike, self._spans_beyond, strict=True)]

    def _held(self) -> ndarray:
        """(stations, k) share of friction of each station's bends, of length one at most."""
        return self._away / np.maximum(norm(self._away, axis=1, keepdims=True), 1.0)

    def stay(self) -> None:
        """Take the posture of the last `force` for where tendons and joints come from next."""
        self.came = self._lengths()
        self.anchors = self.came - self._loose * self._slid
        self.posture = self._data.qpos.copy()
        back = np.zeros(self.model.nv)
        back[self._bends] = -self._give * self._held()
        mujoco.mj_integratePos(self.model, self.posture, back, 1.0)

    def _bound(self) -> ndarray:
        """(ntendon,) [N], largest friction of each."""
        if not len(self._bends):
            return self._most
        return np.minimum(self._most, np.maximum(super()._tensions()[0], 0.0))

    def _tensions(self) -> tuple[ndarray, ndarray]:
        tension, rate = super()._tensions()
        slid = self._slid[: self.model.ntendon]
        bound, sticks = self._bound(), np.abs(slid) < 1
        grows = np.where(bound < self._most, slid, 0.0)
        return tension + bound * slid, rate * (1 + grows) + sticks * bound / _LOOSE


def _bends(model: MjModel) -> ndarray:
    """(stations, 1 or 2) degrees of freedom that bend a station whose backbone rubs."""
    dofs = np.flatnonzero(model.dof_frictionloss > 0)
    within = dofs - model.jnt_dofadr[model.dof_jntid[dofs]]
    dofs = dofs[within < 2]  # the third of a ball joint twists
    stations = len(np.unique(model.dof_bodyid[dofs]))
    return dofs.reshape(stations, -1) if stations else np.zeros((0, 1), int)


@dataclass(frozen=True)
class _Structure:
    """What moves what in a model, and where forces act.

    Attributes:
        moving: (nbody,) how many turns move each body.
        before: (nv, nv) whether turn k lies beyond turn l, the column, or is the same.
        ahead: Turns k, and turns beyond them that move their axes all the same.
        hinges, balls: Joints.
        on_sites, on_tendons: Actuators.
        frames: (loads,) sites in whose axes the loads are given.
        followers: Loads that turn with what they act on.
        spans: Of the tendons, those with about as many turns between their ends together.
        sites: Of the loads.
        from_tip: Order of bodies, tip and sites from the tip to the base.
        beyond: (nv,) how many of them each turn moves.
    """

    moving: ndarray
    before: ndarray
    ahead: tuple[ndarray, ndarray]
    hinges: ndarray
    balls: ndarray
    on_sites: ndarray
    on_tendons: ndarray
    frames: ndarray
    followers: ndarray
    spans: "tuple[_Spans, ...]"
    sites: ndarray
    from_tip: ndarray
    beyond: ndarray


#: Looking it up takes as long as some iterations for a small robot.
_STRUCTURES: WeakKeyDictionary[MjModel, _Structure] = WeakKeyDictionary()


def _structure(model: MjModel) -> _Structure:
    """Raises ValueError for what a scene never builds and this module does not know."""
    moving = _dofs_below(model)
    _check(model, moving)
    joint, index = model.dof_jntid, np.arange(model.nv)
    balls = model.jnt_type == mjtJoint.mjJNT_BALL
    # All turns of one ball joint move each other's axes.
    ends = np.maximum(index, model.jnt_dofadr[joint] + 3 * balls[joint])
    kind, (site, reference) = model.actuator_trntype, model.actuator_trnid.T
    on_sites = np.flatnonzero(kind == mjtTrn.mjTRN_SITE)
    moves, before = index[None, :] < ends[:, None], index[None, :] <= index[:, None]
    sites = site[on_sites]
    points = model.site_bodyid[[model.site(TIP_SITE).id, *sites]]
    count = moving[np.concatenate([np.arange(model.nbody), points])]
    return _Structure(
        moving=moving,
        before=before,
        ahead=np.nonzero(moves & ~before),
        hinges=np.flatnonzero(~balls),
        balls=np.flatnonzero(balls),
        on_sites=on_sites,
        on_tendons=np.flatnonzero(kind == mjtTrn.mjTRN_TENDON),
        frames=np.where(reference >= 0, reference, site)[on_sites],
        followers=np.flatnonzero(reference[on_sites] < 0),
        spans=_spans(model, moving, moves),
        sites=sites,
        from_tip=np.argsort(-count, kind="stable"),
        beyond=np.searchsorted(np.sort(-count), -index),
    )


@dataclass(frozen=True)
class _Spans:
    """Straight pieces of the tendons between guides on two links.

    Attributes:
        tendon: (k,) index.
        start, end: (k,) sites, from base to tip.
        turns: (k, n) those between them, and the first again where others of the group have more.
        real: (k, n, 1) those between them.
        moves: (k, n, n) whether turn l, the column, moves the axis of turn k.
        places: (k n n,) of pairs of them in a matrix (nv, nv) without its shape: NumPy adds up at
            these twenty times as fast as at pairs of indices.
    """

    tendon: ndarray
    start: ndarray
    end: ndarray
    turns: ndarray
    real: ndarray
    moves: ndarray
    places: ndarray


def _spans(model: MjModel, moving: ndarray, moves: ndarray) -> tuple[_Spans, ...]:
    sites = model.wrap_type == mjtWrap.mjWRAP_SITE
    tendon = np.repeat(np.arange(model.ntendon), model.tendon_num)
    first = np.flatnonzero((tendon[:-1] == tendon[1:]) & sites[:-1] & sites[1:])
    pairs = model.wrap_objid[np.stack([first, first + 1])]
    count = moving[model.site_bodyid[pairs]]
    start, end = np.where(count[0] > count[1], pairs[::-1], pairs)  # from base to tip
    low, size = count.min(axis=0), np.abs(count[1] - count[0])
    groups, doublings = [], np.ceil(np.log2(np.maximum(size, 1)))
    for group in np.unique(doublings[size > 0]):
        chosen = (doublings == group) & (size > 0)
        own = np.arange(size[chosen].max())
        real = own < size[chosen, None]
        turns = np.where(real, low[chosen, None] + own, low[chosen, None])
        places = (turns[:, :, None] * model.nv + turns[:, None, :]).ravel()
        between = moves.ravel()[places].reshape(-1, len(own), len(own))
        ends = start[chosen], end[chosen]
        groups.append(
            _Spans(tendon[first[chosen]], *ends, turns, real[:, :, None], between, places)
        )
    return tuple(groups)


def _dofs_below(model: MjModel) -> ndarray:
    """(nbody,) how many turns move each body."""
    first, own, parent = (
        x.tolist() for x in (model.body_dofadr, model.body_dofnum, model.body_parentid)
    )
    count = [0] * model.nbody
    for body in range(1, model.nbody):
        count[body] = first[body] + own[body] if own[body] else count[parent[body]]
    return np.array(count)


def _spring_rate(x: ndarray, first: ndarray, higher: ndarray) -> ndarray:
    """(k,) derivative of first x + higher[0] x^2 + ..., for coefficients (k,) and (k, powers)."""
    powers = np.arange(1, higher.shape[1] + 1)
    return first + ((powers + 1) * higher * x[:, None] ** powers).sum(axis=1)


def _rotation_vectors(q: ndarray, reference: ndarray) -> ndarray:
    """(k, 3) of the rotations from quaternions (k, 4) to others, along the shorter way."""
    w, v = reference[:, :1], -reference[:, 1:]
    real = w[:, 0] * q[:, 0] - (v * q[:, 1:]).sum(axis=1)
    imaginary = w * q[:, 1:] + q[:, :1] * v + _cross(v, q[:, 1:])
    sine = norm(imaginary, axis=1)
    angle = 2 * np.arctan2(sine, np.abs(real)) * np.where(real < 0, -1, 1)
    return imaginary * np.where(sine > 0, angle / np.where(sine > 0, sine, 1), 2)[:, None]


def _rotation_rates(turns: ndarray) -> ndarray:
    """(k, 3, 3) change of rotation vectors (k, 3) by small rotations in the turned frames."""
    skew = np.zeros((len(turns), 3, 3))
    skew[:, [2, 0, 1], [1, 2, 0]], skew[:, [1, 2, 0], [2, 0, 1]] = turns, -turns
    angle = norm(turns, axis=1)
    large = np.maximum(angle, 1e-2)
    # 1 / t^2 - cot(t / 2) / (2 t), whose difference cancels for small angles.
    exact = (1 - large / 2 / np.tan(large / 2)) / large**2
    second = np.where(angle > 1e-2, exact, 1 / 12 + angle**2 / 720)
    return np.eye(3) + skew / 2 + second[:, None, None] * skew @ skew


def _cross(a: ndarray, b: ndarray) -> ndarray:
    """Cross products (..., 3), in a fifth of the time of NumPy's."""
    ahead, back = [1, 2, 0], [2, 0, 1]
    return a[..., ahead] * b[..., back] - a[..., back] * b[..., ahead]


def _check(model: MjModel, moving: ndarray) -> None:
    balls = model.jnt_type == mjtJoint.mjJNT_BALL
    elastic = np.hstack([model.tendon_stiffness[:, None], model.tendon_stiffnesspoly]).any(axis=1)
    fixed = model.wrap_type[model.tendon_adr] == mjtWrap.mjWRAP_JOINT
    low, high = model.tendon_lengthspring.T
    kind, (_, frames) = model.actuator_trntype, model.actuator_trnid.T
    frames = frames[(kind == mjtTrn.mjTRN_SITE) & (frames >= 0)]
    wraps = [mjtWrap.mjWRAP_JOINT, mjtWrap.mjWRAP_SITE, mjtWrap.mjWRAP_PULLEY]
    known = {
        "one chain of joints": model.dof_parentid == np.arange(-1, model.nv - 1),
        "hinges and ball joints": balls | (model.jnt_type == mjtJoint.mjJNT_HINGE),
        "ball joints with linear springs": model.jnt_stiffnesspoly[balls] == 0,
        "tendons along joints and sites": np.isin(model.wrap_type, wraps),
        "straight tendons without springs": ~elastic | (fixed & (low == high)),
        "actuators of tendons and sites": np.isin(kind, [mjtTrn.mjTRN_TENDON, mjtTrn.mjTRN_SITE]),
        "frames of loads in the world": moving[model.site_bodyid[frames]] == 0,
    }
    for what, holds in known.items():
        if not np.all(holds):
            raise ValueError(f"the static forces of a chain are known for {what} only")
