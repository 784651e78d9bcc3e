"""Motions that MuJoCo's integrators compute, such as those with contacts, and their derivatives.

At the accelerations a and the forces F of the constraints, the forces on the DOFs and what drives
the constraints are

    R = M a + c - tau - J' F = 0,    y = J a - a_ref,    F = S(y),

where only S, the law of contacts and friction, has bends and narrow places. So R and y at given a
and F are derived by differences, which see nothing of these, and S by its Hessian D, which MuJoCo's
solver knows: (M + J' D J) da = -dR - J' D dy. Where something begins or ceases to touch or slide,
derivatives are of the side on which the motion was.
"""

from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np
from mujoco import MjData, MjModel, mjtConstraintState
from numpy import ndarray
from scipy.linalg import cho_factor, cho_solve

from softrobot_env.core.motion import State

from .model import flat
from .motions import Derivatives, Moved, Observed

if TYPE_CHECKING:
    from .rollout import Rollout

#: Steps of differences, of positions and velocities.
_STEP = 1e-6

_ALL_DIGITS = 1e-15

_SLIDING = [
    int(mjtConstraintState.mjCNSTRSTATE_LINEARNEG),
    int(mjtConstraintState.mjCNSTRSTATE_LINEARPOS),
]


class Periods(NamedTuple):
    """Derivatives of the states (2 nv,) at the ends of periods.

    Attributes:
        by_state: (periods, 2 nv, 2 nv), by those at their starts.
        by_control: (periods, 2 nv, nu).
        by_parameters: (periods, 2 nv, parameters).
        switches: Steps in which a constraint had another state than in the one before.
    """

    by_state: ndarray
    by_control: ndarray
    by_parameters: ndarray
    switches: int


class Balance(NamedTuple):
    """What is in balance in a step, at given accelerations and forces of constraints.

    Attributes:
        forces: (nv,), R.
        drives: (rows,), y.
        damped: (nv,), M a less (M + h B) times the step's acceleration, with implicit damping.
        scale: (rows,), logarithms of what forces are proportional to: D, or dry friction that
            slides.
        kinds: Which constraints there are.
    """

    forces: ndarray
    drives: ndarray
    damped: ndarray
    scale: ndarray
    kinds: bytes


class Held(NamedTuple):
    """What is the same in all balances of a step.

    Attributes:
        acceleration: (nv,), a.
        force: (rows,), F.
        damped: (nv,), acceleration of the step, with implicit damping.
        slides: (rows,), whether a row is dry friction that slides.
    """

    acceleration: ndarray
    force: ndarray
    damped: ndarray
    slides: ndarray


class Stepper:
    """Periods of a scene, and their derivatives.

    Args:
        model: Of the scene.
        substeps: Of a period.
        varied: Models with larger and smaller values of each parameter, and how far these are
            apart.
    """

    def __init__(
        self, model: MjModel, substeps: int, varied: Sequence[tuple[MjModel, MjModel, float]]
    ) -> None:
        self._model, self._substeps = copy(model), substeps
        self._model.opt.tolerance = _ALL_DIGITS
        self._data, self._other = MjData(self._model), MjData(self._model)
        self._varied = [
            ([(x, MjData(x)) for x in (more, less)], apart) for more, less, apart in varied
        ]

    def derivatives(self, starts: ndarray, controls: ndarray) -> Periods:
        """Of periods that begin in states (periods, 3, nv), see `state_of`, under controls."""
        model, n = self._model, 2 * self._model.nv
        count, own, nu = len(starts), len(self._varied), model.nu
        shapes = (count, n, n), (count, n, nu), (count, n, own)
        found, switches, before = Periods(*map(np.zeros, shapes), 0), 0, b""
        for period, start in enumerate(starts):
            _set(self._data, start, controls[period])
            by = np.eye(n, n + nu + own)
            for _ in range(self._substeps):
                mujoco.mj_forward(model, self._data)
                step = self._step()
                by = step[:, :n] @ by
                by[:, n:] += step[:, n:]
                held = self._data.efc_state.tobytes()
                switches, before = switches + (held != before), held
                mujoco.mj_step(model, self._data)
            parts = np.split(by, [n, n + nu], axis=1)
            for whole, part in zip(found, parts, strict=False):
                whole[period] = part
        return found._replace(switches=max(switches - 1, 0))

    def _step(self) -> ndarray:
        """Derivatives (2 nv, 2 nv + nu + parameters) of the next step, which was prepared."""
        model, data, h = self._model, self._data, self._model.opt.timestep
        nv, mass = model.nv, _mass(model, data)
        braked = mass + h * np.diag(model.dof_damping)
        jacobian = _jacobian(model, data)
        stiff = _stiffness(model, data, jacobian @ data.qacc - data.efc_aref)
        held = Held(
            data.qacc.copy(),
            data.efc_force.copy(),
            np.linalg.solve(braked, mass @ data.qacc),
            np.isin(data.efc_state, _SLIDING),
        )
        forces, drives, damped = self._by_state_and_parameters(held)
        system = cho_factor(mass + jacobian.T @ stiff @ jacobian)
        own = -cho_solve(system, forces + jacobian.T @ (stiff @ drives))
        by_control = cho_solve(system, _by_control(model, data))
        ends = np.linalg.solve(
            braked,
            mass @ np.hstack([own, by_control]) + np.hstack([damped, np.zeros_like(by_control)]),
        )
        order = [*range(2 * nv), *range(own.shape[1], ends.shape[1]), *range(2 * nv, own.shape[1])]
        velocity = h * ends[:, order]
        velocity[:, nv : 2 * nv] += np.eye(nv)
        position = h * velocity
        position[:, :nv] += np.eye(nv)
        return np.vstack([position, velocity])

    def _by_state_and_parameters(self, held: Held) -> tuple[ndarray, ndarray, ndarray]:
        """Derivatives of `Balance` by positions, velocities and parameters, in columns.

        Those of what forces of constraints are proportional to are in those of the forces.
        """
        model, data, other = self._model, self._data, self._other
        state, here, columns = state_of(data), _balance(model, data, held), []
        for i in range(model.nv):
            sides = []
            for way in (_STEP, -_STEP):
                _set(other, state, data.ctrl)
                other.qpos[i] += way
                sides.append(_looked(model, other, held))
            columns.append(_slope(here, sides, 2 * _STEP))
        columns += self._by_velocities(state)
        for both, apart in self._varied:
            sides = []
            for varied, own in both:
                _set(own, state, data.ctrl)
                sides.append(_looked(varied, own, held))
            columns.append(_slope(here, sides, apart))
        forces, drives, damped, scale = (np.array(x).T for x in zip(*columns, strict=True))
        if scale.size:
            forces = forces - _jacobian(model, data).T @ (held.force[:, None] * scale)
        return forces, drives, damped

    def _by_velocities(self, state: ndarray) -> list[tuple[ndarray, ...]]:
        """Columns of derivatives by velocities, of which forces are polynomials of second order."""
        model, data, other = self._model, self._data, self._other
        _set(other, state, data.ctrl)
        mujoco.mj_fwdPosition(model, other)
        forces, side, none = np.diag(model.dof_damping), np.empty(model.nv), np.zeros(model.nv)
        for i in range(model.nv):
            for way in (0.5, -0.5):
                other.qvel[i] = state[1, i] + way
                mujoco.mj_comVel(model, other)
                mujoco.mj_rne(model, other, 0, side)
                forces[i] += 2 * way * side
            other.qvel[i] = state[1, i]
        drives = data.efc_KBIP[:, 1, None] * _jacobian(model, data)
        rows = zip(forces, drives.T, strict=True)
        return [(force, drive, none, np.zeros(data.nefc)) for force, drive in rows]


def _looked(model: MjModel, data: MjData, held: Held) -> Balance:
    """The balance in a state that was set."""
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_fwdActuation(model, data)
    return _balance(model, data, held)


def _balance(model: MjModel, data: MjData, held: Held) -> Balance:
    """The balance in a state that was looked at, at what is held."""
    (a, force, end, slides), jacobian = held, _jacobian(model, data)
    kinds = data.efc_type.tobytes() + data.efc_id.tobytes()
    if len(jacobian) != len(force):
        return Balance(a, force, end, force, kinds)
    forces, damped = np.empty((2, model.nv))
    mujoco.mj_mulM(model, data, forces, a)
    mujoco.mj_mulM(model, data, damped, a - end)
    forces += data.qfrc_bias - data.qfrc_passive - data.qfrc_actuator - force @ jacobian
    damped -= model.opt.timestep * model.dof_damping * end
    scale = np.log(np.where(slides, data.efc_frictionloss, data.efc_D))
    return Balance(forces, jacobian @ a - data.efc_aref, damped, scale, kinds)


def _slope(here: Balance, sides: list[Balance], apart: float) -> list[ndarray]:
    """Derivative between two sides, or of the one that has the same constraints as here."""
    same = [side.kinds == here.kinds for side in sides]
    if not any(same):
        raise ValueError("what touches changes with the least motion, so there is no derivative")
    ends = [side if ok else here for side, ok in zip(sides, same, strict=True)]
    share = apart if all(same) else apart / 2
    return [(x - y) / share for x, y in zip(ends[0][:4], ends[1][:4], strict=True)]


def _mass(model: MjModel, data: MjData) -> ndarray:
    """(nv, nv)."""
    out = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, out)
    return out


def _jacobian(model: MjModel, data: MjData) -> ndarray:
    """(rows, nv), of the constraints."""
    if not mujoco.mj_isSparse(model):
        return data.efc_J.reshape(-1, model.nv)
    out = np.zeros((data.nefc, model.nv))
    mujoco.mju_sparse2dense(
        out, data.efc_J.ravel(), data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind.ravel()
    )
    return out


def _stiffness(model: MjModel, data: MjData, drives: ndarray) -> ndarray:
    """(rows, rows), by how much the forces of the constraints fall with what drives them."""
    mujoco.mj_constraintUpdate(model, data, drives, np.zeros(1), True)  # else states are older
    quadratic = data.efc_state == int(mjtConstraintState.mjCNSTRSTATE_QUADRATIC)
    out = np.diag(np.where(quadratic, data.efc_D, 0.0))
    for contact in data.contact:
        first = contact.efc_address
        if first >= 0 and data.efc_state[first] == int(mjtConstraintState.mjCNSTRSTATE_CONE):
            rows = slice(first, first + contact.dim)
            out[rows, rows] = contact.H[: contact.dim**2].reshape(contact.dim, -1)
    return out


def _by_control(model: MjModel, data: MjData) -> ndarray:
    """Derivative (nv, nu) of the drives' forces on the DOFs by controls within their limits."""
    moment, low, high = np.zeros((model.nu, model.nv)), *model.actuator_forcerange.T
    mujoco.mju_sparse2dense(
        moment, data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
    )
    force = data.actuator_force
    free = ~model.actuator_forcelimited.astype(bool) | ((force > low) & (force < high))
    return moment.T * np.where(free, model.actuator_gainprm[:, 0], 0.0)


def state_of(data: MjData) -> ndarray:
    """(3, nv): positions, velocities, and the accelerations with which the solver begins."""
    return np.stack([data.qpos, data.qvel, data.qacc_warmstart])


def _set(data: MjData, state: ndarray, control: ndarray) -> None:
    data.qpos[:], data.qvel[:], data.qacc_warmstart[:] = state
    data.ctrl[:] = control


class SteppedMotion(Moved):
    """A motion by one of MuJoCo's integrators."""

    def __init__(
        self,
        rollout: "Rollout",
        inputs: ndarray,
        starts: ndarray,
        seen: tuple[ndarray, ndarray],
        resting: bool,
    ) -> None:
        super().__init__(rollout, inputs, seen, resting)
        self._starts = starts

    @cached_property
    def _periods(self) -> Periods:
        return self._rollout.stepper.derivatives(self._starts, self._controls[1:])

    def vjp(self, **weights: ndarray) -> Derivatives:
        """As `Motion.vjp`; all of it is found at once for all weights, when first asked for."""
        own, back = self._rollout, self._rollout.zero()
        by_state, by_control = self._by_seen(weights, back)
        count = len(by_control)
        by_state, applied = by_state.reshape(count, -1), by_control[1:].copy()
        wanted, named = by_state[-1], own.by_parameters @ flat(back.values)
        periods = self._periods
        for p in range(count - 2, -1, -1):
            applied[p] += wanted @ periods.by_control[p]
            named = named + wanted @ periods.by_parameters[p]
            wanted = wanted @ periods.by_state[p] + by_state[p]
        if not own.is_placed:
            applied[0] += by_control[0]
        position, velocity = wanted.reshape(2, -1)
        parameters = self._named(named, position)
        inputs = self._by_given(applied)
        return Derivatives(position, velocity, inputs, parameters, periods.switches)

    def linearised(self) -> tuple[ndarray, ndarray]:
        """As `Motion.linearised`."""
        return self._periods.by_state, self._by_given(self._periods.by_control)

    def jvp(
        self,
        start: State | None = None,
        inputs: ndarray | None = None,
        parameters: dict[str, float] | None = None,
    ) -> Observed:
        """As `Motion.jvp`."""
        own, periods = self._rollout, self._periods
        change = np.zeros_like(self.inputs) if inputs is None else inputs
        way = np.array([(parameters or {}).get(name, 0.0) for name in own.parameters])
        maps = [own.by_action(action) for action in self.inputs]
        applied = [x if m is None else m @ x for x, m in zip(change, maps, strict=True)]
        first = np.zeros_like(applied[0]) if own.is_placed else applied[0]
        state = np.zeros(periods.by_state.shape[1])
        states = [state if start is None else np.concatenate(start)]
        for p, control in enumerate(applied):
            moved = periods.by_state[p] @ states[-1] + periods.by_control[p] @ control
            states.append(moved + periods.by_parameters[p] @ way)
        ways = np.array(states).reshape(self._states.shape)
        return self._along(ways, np.array([first, *applied]), way)
