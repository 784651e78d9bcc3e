"""Static equilibrium of a compiled scene; with contacts, the rest of a damped motion."""

from copy import copy
from math import pi

import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.core.continuation import Newton, find_equilibrium
from softrobot_env.core.equilibrium import (
    EquilibriumError,
    checked_load_steps,
    require_stable,
    stability_asked,
)
from softrobot_env.core.processes import one_blas_thread
from softrobot_env.robots import RobotParams

from .tangent import RubbingForces, StaticForces

__all__ = ["EquilibriumError", "checked_controls", "equilibrium", "finite"]

_HOLDS = 10  # times at most that friction is found again, for what crept to stick
_LARGE_TURN = 2.0  # rad that all joints make together


@one_blas_thread()
def equilibrium(
    model: mujoco.MjModel,
    ctrl: ndarray,
    guess: ndarray | None = None,
    load_steps: int = 1,
    check_stability: bool | str = True,
    gravity: ndarray | None = None,
    rubbing: StaticForces | None = None,
    nearby: bool = False,
) -> ndarray:
    """Posture (nq,) in equilibrium under constant controls (nu,): the hinge angles [rad].

    Of a chain on ball joints it holds their quaternions; `scene.chain.joint_angles` reads both.
    Newton's method with the exact derivative of `scene.tangent`, see `core.continuation`.

    Args:
        model: A compiled scene; it stays as it is.
        ctrl: (nu,) controls.
        guess: (nq,) where Newton's method starts. Without it, or if that fails, the path of
            equilibria from the posture without loads is followed while they grow.
        load_steps: Least number of equal steps in which controls, gravity and pretension grow
            along that path; as many as it needs are taken anyway.
        check_stability: True or "static" refuses an equilibrium that loads at rest cannot give;
            "dynamic" also one that flutters; False none (`equilibrium.require_stable`).
        gravity: (3,) [m/s2] in place of the scene's.
        rubbing: Other forces: with friction (`RubbingForces`), from where the tendons were, which
            is left out without, and they are then where they stay; or by servos (`StaticForces`).
        nearby: Whether the guess alone is tried, which takes less time where that fails.

    Raises:
        EquilibriumError: None was found, or an unstable one.
        ValueError: An argument is not finite, not of its shape or not one of these, or a control is
            out of its range, to which MuJoCo would clamp it silently.
    """
    kind, load_steps = stability_asked(check_stability), checked_load_steps(load_steps)
    guess = None if guess is None else finite("the guess", guess, (model.nq,))
    ctrl = checked_controls(model, ctrl)
    model = with_gravity(model, gravity)
    forces = StaticForces(model) if rubbing is None else rubbing
    q = _at_rest(forces, ctrl, guess, load_steps, nearby)
    if kind is not None:
        forces.force(q, ctrl)
        require_stable(kind, -forces.tangent(), forces.mass(), np.diag(model.dof_damping))
    if isinstance(rubbing, RubbingForces):
        rubbing.force(q, ctrl)
        rubbing.stay()
    return q


def _at_rest(
    forces: StaticForces, ctrl: ndarray, guess: ndarray | None, load_steps: int, nearby: bool
) -> ndarray:
    """Posture (nq,) in equilibrium, see there."""
    loaded, rest = _LoadedChain(forces, ctrl), forces.model.qpos_spring
    if not isinstance(forces, RubbingForces):
        return find_equilibrium(loaded, rest, guess, load_steps, nearby=nearby)
    q, before = guess, forces.anchors.copy()
    try:
        for more in reversed(range(_HOLDS)):
            q = find_equilibrium(loaded, rest, q, load_steps, careful=True, nearby=nearby)
            forces.force(q, ctrl)
            if not (more and forces.hold()):
                break
    except EquilibriumError:
        forces.anchors = before
        raise
    return q


def with_gravity(model: mujoco.MjModel, gravity: ndarray | None) -> mujoco.MjModel:
    """A copy of a model with another gravity (3,) [m/s2]; itself if that is None."""
    if gravity is not None:
        model = copy(model)  # the caller's may be simulating in another thread
        model.opt.gravity[:] = finite("gravity", gravity, (3,))
    return model


def finite(what: str, values: ndarray, shape: tuple[int, ...]) -> ndarray:
    """A copy of values as floats.

    Raises:
        ValueError: They are not of that shape, or not all finite; the message says what they are.
    """
    values = np.array(values, float)
    if values.shape != shape:
        raise ValueError(f"need {what} of shape {shape}, got {values.shape}")
    if not np.all(np.isfinite(values)):
        raise ValueError(f"{what} must be finite, got {values[~np.isfinite(values)][0]}")
    return values


def checked_controls(model: mujoco.MjModel, ctrl: ndarray) -> ndarray:
    """A copy of controls (nu,).

    Raises:
        ValueError: They are not of that shape, not finite, or one is out of its range.
    """
    ctrl = finite("controls", ctrl, (model.nu,))
    low, high = model.actuator_ctrlrange.T
    beyond = np.flatnonzero(model.actuator_ctrllimited & ((ctrl < low) | (ctrl > high)))
    if len(beyond):
        k = int(beyond[0])
        raise ValueError(
            f"control {model.actuator(k).name!r} must lie in [{low[k]:g}, {high[k]:g}], "
            f"got {ctrl[k]:g}"
        )
    return ctrl


class _LoadedChain:
    """A chain under a share of its controls, gravity and pretension, for `continuation`."""

    def __init__(self, forces: StaticForces, ctrl: ndarray) -> None:
        from scipy.linalg.lapack import dgetrf, dgetrs  # takes time to load

        self._factorize, self._substitute = dgetrf, dgetrs
        self._forces, self._ctrl, self._model = forces, ctrl, forces.model
        stations = len(np.unique(self._model.dof_bodyid))
        self.scale = np.full(self._model.nv, _LARGE_TURN / stations)

    def newton(self, q: ndarray, share: float) -> Newton | None:
        """Newton's changes (nv,) at q (nq,), None where the stiffness is singular or not finite."""
        force = self._forces.force(q, self._ctrl, share)
        right = np.stack([force, self._forces.applied], axis=1)
        *self._factors, singular = self._factorize(-self._forces.tangent())
        if singular:
            return None
        found = self._solved(right)
        return Newton(*found.T) if np.all(np.isfinite(found)) else None

    def again(self, q: ndarray, share: float) -> ndarray:
        """The change (nv,) to balance the forces at q (nq,), by the last stiffness."""
        return self._solved(self._forces.force(q, self._ctrl, share))

    def _solved(self, right: ndarray) -> ndarray:
        """Changes (nv, ...) by the factors of the last stiffness."""
        return self._substitute(*self._factors, right)[0]

    def moved(self, q: ndarray, change: ndarray) -> ndarray:
        """Posture (nq,) after small turns (nv,) [rad] of the joints."""
        moved = q.copy()
        mujoco.mj_integratePos(self._model, moved, change, 1.0)
        return moved


#: A scene rests if nothing moves by this share of the robot's length in a relaxation time, and no
#: speed [rad/s or m/s] times it is beyond this: contacts that chatter move nothing in the mean.
_STILL, _QUIET = 1e-9, 1e-5

#: Most relaxation times until then.
_PATIENCE = 200


def settle(
    model: mujoco.MjModel, robot: RobotParams, first_period: float, ctrl: ndarray, start: ndarray
) -> ndarray:
    """Posture (nq,) in which a scene without friction comes to rest under controls (nu,).

    Everything is damped in proportion to its mass, the robot's first mode critically; joints and
    contacts keep their own damping. What is found is an equilibrium of the scene as it is, and a
    stable one. (More damping of the joints would be quicker, but MuJoCo finds the forces of
    contacts without it, and they would chatter.)

    Args:
        model: The compiled scene; it stays as it is.
        robot: Its robot.
        first_period: [s].
        ctrl: (nu,).
        start: Posture (nq,) at rest to begin with.

    Raises:
        EquilibriumError: It diverged, or did not come to rest.
    """
    time = first_period / (2 * pi)
    data = mujoco.MjData(model)
    data.qpos[:], data.ctrl[:] = start, ctrl
    mujoco.mj_forward(model, data)
    steps, still = max(1, round(time / model.opt.timestep)), _STILL * robot.length
    kept = 1 - 2 * model.opt.timestep / time
    for _ in range(_PATIENCE):
        before = data.xpos.copy()
        for _ in range(steps):
            mujoco.mj_step(model, data)
            data.qvel *= kept
        if any(warning.number for warning in data.warning):
            raise EquilibriumError("the scene diverged before it came to rest")
        moved, speed = np.abs(data.xpos - before).max(), np.abs(data.qvel).max()
        if moved < still and speed * time < _QUIET:
            return data.qpos.copy()
    raise EquilibriumError(
        f"the scene did not come to rest: after {_PATIENCE * time:.3g} s something still moves by "
        f"{1e3 * moved / time:.3g} mm/s, or contacts chatter (a shorter timestep may help)"
    )
