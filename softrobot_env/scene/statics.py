"""Static equilibrium of a compiled scene."""

from copy import copy

import mujoco
import numpy as np

from softrobot_env.equilibrium import EquilibriumError

_ITERATIONS = 50
_STEP = 1e-6
_LARGEST_TURN = 0.5  # rad a joint may turn in one iteration


def equilibrium(
    model: mujoco.MjModel,
    ctrl: np.ndarray,
    guess: np.ndarray | None = None,
    *,
    load_steps: int = 1,
) -> np.ndarray:
    """Posture (nq,) in equilibrium under constant controls (nu,): the hinge angles [rad].

    Of a chain on ball joints it holds their quaternions; `scene.chain.joint_angles` reads both.
    Newton's method on the generalised forces with a difference Jacobian.

    Args:
        model: A compiled scene; it stays as it is.
        ctrl: (nu,) controls.
        guess: (nq,) start of the iteration, straight unless given.
        load_steps: Equal steps in which controls and gravity grow from zero, each solved from
            the last one's solution. A robot bent far has several equilibria; a single step may
            find another one than the robot reaches when it is loaded slowly.

    Raises:
        EquilibriumError: No convergence (the message gives the remaining force), or the
            equilibrium found is unstable.
        ValueError: `load_steps` is not a positive whole number, or a control is out of its range,
            to which MuJoCo would clamp it silently.
    """
    if not (load_steps >= 1 and load_steps % 1 == 0):
        raise ValueError(f"load_steps must be a whole number, at least one, got {load_steps}")
    q = np.array(model.qpos0 if guess is None else guess, dtype=float)
    ctrl = np.asarray(ctrl, dtype=float)
    _check_range(model, ctrl)
    if load_steps > 1:
        # The caller's model may be simulating in another thread.
        gravity, model = model.opt.gravity.copy(), copy(model)
        for share in np.arange(1, load_steps) / load_steps:
            model.opt.gravity[:] = share * gravity
            q = _solve(model, share * ctrl, q)
        model.opt.gravity[:] = gravity
    return _solve(model, ctrl, q)


def _check_range(model: mujoco.MjModel, ctrl: np.ndarray) -> None:
    low, high = model.actuator_ctrlrange.T
    beyond = np.flatnonzero(model.actuator_ctrllimited & ((ctrl < low) | (ctrl > high)))
    if len(beyond):
        k = int(beyond[0])
        raise ValueError(
            f"control {model.actuator(k).name!r} must lie in [{low[k]:g}, {high[k]:g}], "
            f"got {ctrl[k]:g}"
        )


def _solve(model: mujoco.MjModel, ctrl: np.ndarray, q: np.ndarray) -> np.ndarray:
    data = mujoco.MjData(model)
    data.ctrl[:] = ctrl
    scale = np.max(model.jnt_stiffness)
    for _ in range(_ITERATIONS):
        force = _force(model, data, q)
        jacobian = _jacobian(model, data, q, force)
        if np.max(np.abs(force)) < 1e-12 * scale:
            # Exact for forces with a potential; follower loads may also cause flutter, which this
            # misses.
            if np.max(np.linalg.eigvals(jacobian).real) >= 0:
                raise EquilibriumError(
                    "the equilibrium is unstable: the robot would leave it by itself"
                )
            return q
        turn = np.linalg.solve(jacobian, -force)
        q = _moved(model, q, turn * min(1.0, _LARGEST_TURN / np.max(np.abs(turn))))
    raise EquilibriumError(
        f"no equilibrium after {_ITERATIONS} iterations: {np.max(np.abs(force)):.3g} N m remain"
    )


def _force(model: mujoco.MjModel, data: mujoco.MjData, q: np.ndarray) -> np.ndarray:
    """Generalised force (nv,) on the chain at rest in posture q."""
    data.qpos[:] = q
    data.qvel[:] = 0
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    mujoco.mj_fwdActuation(model, data)
    return data.qfrc_passive + data.qfrc_actuator - data.qfrc_bias


def _jacobian(
    model: mujoco.MjModel, data: mujoco.MjData, q: np.ndarray, force: np.ndarray
) -> np.ndarray:
    moves = _STEP * np.eye(model.nv)
    columns = [_force(model, data, _moved(model, q, move)) - force for move in moves]
    return np.stack(columns, axis=1) / _STEP


def _moved(model: mujoco.MjModel, q: np.ndarray, move: np.ndarray) -> np.ndarray:
    """Posture (nq,) after the small rotations `move` (nv,) [rad] of the joints."""
    moved = q.copy()
    mujoco.mj_integratePos(model, moved, move, 1.0)
    return moved
