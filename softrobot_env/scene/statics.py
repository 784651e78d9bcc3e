"""Static equilibrium of a compiled scene."""

import mujoco
import numpy as np

_ITERATIONS = 50
_STEP = 1e-6
_LARGEST_TURN = 0.5  # rad a hinge may turn in one iteration


class EquilibriumError(RuntimeError):
    """Newton's method found no equilibrium."""


def equilibrium(
    model: mujoco.MjModel, ctrl: np.ndarray, guess: np.ndarray | None = None
) -> np.ndarray:
    """Hinge angles (nq,) [rad] in equilibrium under constant controls (nu,).

    Newton's method on the generalised forces with a difference Jacobian; loads are applied
    in one go, so follow large ones in steps and pass the last solution as the guess.

    Raises:
        EquilibriumError: No convergence (the message gives the remaining force), or the
            equilibrium found is unstable.
    """
    data = mujoco.MjData(model)
    data.ctrl[:] = ctrl
    q = np.zeros(model.nq) if guess is None else np.array(guess, dtype=float)
    scale = np.max(model.jnt_stiffness)
    for _ in range(_ITERATIONS):
        force = _force(model, data, q)
        jacobian = _jacobian(model, data, q, force)
        if np.max(np.abs(force)) < 1e-12 * scale:
            _check_stability(jacobian)
            return q
        turn = np.linalg.solve(jacobian, -force)
        q = q + turn * min(1.0, _LARGEST_TURN / np.max(np.abs(turn)))
    raise EquilibriumError(
        f"no equilibrium after {_ITERATIONS} iterations: {np.max(np.abs(force)):.3g} N m remain"
    )


def _check_stability(jacobian: np.ndarray) -> None:
    # With a positive mass matrix a restoring force field has eigenvalues left of the axis.
    if np.max(np.linalg.eigvals(jacobian).real) >= 0:
        raise EquilibriumError("the equilibrium is unstable: the robot would leave it by itself")


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
    columns = [_force(model, data, q + _STEP * e) - force for e in np.eye(len(q))]
    return np.stack(columns, axis=1) / _STEP
