"""Static equilibrium of a compiled scene."""

from copy import copy

import mujoco
import numpy as np

from softrobot_env.equilibrium import (
    EquilibriumError,
    checked_load_steps,
    require_stable,
    stability_asked,
)
from softrobot_env.scene.tangent import StaticForces

_ITERATIONS = 30
_LARGEST_TURN = 0.5  # rad a joint may turn in one iteration
_SMALLEST_LOAD_STEP = 1 / 256
#: Of the softest joint's stiffness, the force that may remain.
_CONVERGED = 1e-12
_STALLED = 1e-8  # rad of a correction that is rounding error where it no longer shrinks


def equilibrium(
    model: mujoco.MjModel,
    ctrl: np.ndarray,
    guess: np.ndarray | None = None,
    *,
    load_steps: int = 1,
    check_stability: bool | str = True,
    gravity: np.ndarray | None = None,
) -> np.ndarray:
    """Posture (nq,) in equilibrium under constant controls (nu,): the hinge angles [rad].

    Of a chain on ball joints it holds their quaternions; `scene.chain.joint_angles` reads both.
    Newton's method with the exact derivative of `scene.tangent`.

    Args:
        model: A compiled scene; it stays as it is.
        ctrl: (nu,) controls.
        guess: (nq,) start of the iteration, straight unless given.
        load_steps: Least number of equal steps in which controls, gravity and pretension grow from
            zero; smaller ones are taken where Newton's method fails. A robot bent far has several
            equilibria; too few steps may find another one than the robot reaches when it is loaded
            slowly.
        check_stability: True or "static" refuses an equilibrium that loads at rest cannot give;
            "dynamic" also one that flutters; False none (`equilibrium.require_stable`).
        gravity: (3,) [m/s2] in place of the scene's.

    Raises:
        EquilibriumError: None was found, or an unstable one.
        ValueError: An argument is not finite, not of its shape or not one of these, or a control is
            out of its range, to which MuJoCo would clamp it silently.
    """
    kind, load_steps = stability_asked(check_stability), checked_load_steps(load_steps)
    start = finite("the guess", model.qpos0 if guess is None else guess, (model.nq,))
    ctrl = finite("controls", ctrl, (model.nu,))
    _check_range(model, ctrl)
    if gravity is not None:
        model = copy(model)  # the caller's may be simulating in another thread
        model.opt.gravity[:] = finite("gravity", gravity, (3,))
    forces = StaticForces(model)
    q = _follow_loads(forces, ctrl, start, 1 / load_steps)
    if kind is not None:
        require_stable(kind, -forces.tangent(), forces.mass(), np.diag(model.dof_damping))
    return q


def finite(what: str, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A copy of values as floats.

    Raises:
        ValueError: They are not of that shape, or not all finite; the message says what they are.
    """
    values = np.array(values, dtype=float)
    if values.shape != shape:
        raise ValueError(f"need {what} of shape {shape}, got {values.shape}")
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{what} must be finite, got {values[~np.isfinite(values)][0]}")
    return values


def _check_range(model: mujoco.MjModel, ctrl: np.ndarray) -> None:
    low, high = model.actuator_ctrlrange.T
    beyond = np.flatnonzero(model.actuator_ctrllimited & ((ctrl < low) | (ctrl > high)))
    if len(beyond):
        k = int(beyond[0])
        raise ValueError(
            f"control {model.actuator(k).name!r} must lie in [{low[k]:g}, {high[k]:g}], "
            f"got {ctrl[k]:g}"
        )


def _follow_loads(
    forces: StaticForces, ctrl: np.ndarray, q: np.ndarray, first: float
) -> np.ndarray:
    """Equilibrium under all loads, reached in steps that are halved where Newton's method fails."""
    reached, step = 0.0, first
    while reached < 1:
        share = min(1.0, reached + step)
        share = 1.0 if share > 1 - 1e-12 else share
        found = _newton(forces, ctrl, q, share)
        if found is not None:
            q, reached, step = found, share, min(2 * step, first)
        elif step > _SMALLEST_LOAD_STEP:
            step /= 2
        else:
            raise EquilibriumError(
                f"no equilibrium beyond {reached:.1%} of the loads: Newton's method fails for "
                f"steps of {step:.2%} of them"
            )
    return q


def _newton(
    forces: StaticForces, ctrl: np.ndarray, q: np.ndarray, share: float
) -> np.ndarray | None:
    """Posture (nq,) in equilibrium under a share of the loads; None if not found."""
    model = forces.model
    tolerance = _CONVERGED * np.min(model.jnt_stiffness)
    largest = before = np.inf
    for _ in range(_ITERATIONS):
        force = forces.force(q, ctrl, share)
        remaining = np.max(np.abs(force))
        if remaining < tolerance or (largest < _STALLED and remaining > before / 2):
            return q
        try:
            turn = np.linalg.solve(forces.tangent(), -force)
        except np.linalg.LinAlgError:
            return None
        largest = np.max(np.abs(turn))
        if not np.isfinite(largest):
            return None
        q = _moved(model, q, turn * min(1.0, _LARGEST_TURN / largest))
        before = remaining
    return None


def _moved(model: mujoco.MjModel, q: np.ndarray, move: np.ndarray) -> np.ndarray:
    """Posture (nq,) after the small rotations `move` (nv,) [rad] of the joints."""
    moved = q.copy()
    mujoco.mj_integratePos(model, moved, move, 1.0)
    return moved
