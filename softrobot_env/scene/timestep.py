"""The rule that picks integrator and timestep from a robot's stiffness and damping.

The chain, linearised about its straight pose, splits into modes with frequency w and damping
rate mu w^2 (stiffness-proportional damping). On each mode the integrators act as

* implicitfast (and Euler, implicit): v+ = (v - h w^2 q) / (1 + h mu w^2), q+ = q + h v+, stable
  while h < mu + sqrt(mu^2 + 4 / w^2);
* RK4: stable while |R(h lambda)| <= 1 for both roots lambda of the mode;
* discrete: also implicit in the stiffness, hence stable for any h, but it damps all motion.

The timestep is the largest divisor of the control period that is at most

* `ACCURACY` times the period of the first mode. Both implicit methods let a force act half a
  step early, so this bounds the phase error of the first mode by pi ACCURACY;
* `SAFETY` times the stability limit, because bending stiffens the chain's modes.

implicitfast is taken unless stability would ask for more than `MAX_SUBSTEPS_RATIO` times the
steps that accuracy asks for; then the rule takes discrete and says that fast modes are damped.
"""

import warnings
from dataclasses import dataclass
from math import ceil, inf, pi, sqrt

import mujoco
import numpy as np

ACCURACY = 1 / 500
SAFETY = 0.5
MAX_SUBSTEPS_RATIO = 32


class TimestepWarning(UserWarning):
    """A timestep or integrator outside the rule's bounds was asked for, or forced by stiffness."""


@dataclass(frozen=True)
class TimestepChoice:
    """Integrator and timestep of a scene, and what they were chosen from.

    Attributes:
        integrator: MuJoCo's name.
        timestep: [s].
        substeps: Steps per control period.
        first_period: [s] of the slowest mode.
        stability_limit: [s], largest stable timestep of the linearised chain; may be inf.
        reason: One sentence for people.
    """

    integrator: str
    timestep: float
    substeps: int
    first_period: float
    stability_limit: float
    reason: str


def modal_frequencies(model: mujoco.MjModel) -> np.ndarray:
    """Undamped angular frequencies (nv,) [rad/s], increasing, of the straight chain."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    scale = 1 / np.sqrt(model.jnt_stiffness)
    return 1 / np.sqrt(np.linalg.eigvalsh(scale[:, None] * mass * scale)[::-1])


def stability_limit(integrator: str, frequencies: np.ndarray, damping_time: float) -> float:
    """Largest stable timestep [s] of the linearised chain, inf where there is none."""
    if integrator == "discrete":
        return inf
    if integrator == "RK4":
        return min(_rk4_limit(w, damping_time) for w in frequencies)
    return damping_time + sqrt(damping_time**2 + 4 / frequencies[-1] ** 2)


def _rk4_limit(frequency: float, damping_time: float) -> float:
    """First timestep at which RK4's amplification of a damped mode exceeds one."""
    rate = damping_time * frequency**2 / 2
    root = -rate + np.emath.sqrt(complex(rate**2 - frequency**2))
    fastest = max((root, -2 * rate - root), key=abs)
    # |R| <= 1 inside the stability region, which ends before |h lambda| = 3.
    z = np.linspace(0, 3, 3001)[1:] * (fastest / abs(fastest))
    growth = np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24)
    unstable = np.flatnonzero(growth > 1 + 1e-9)
    return 3 * (unstable[0] if len(unstable) else 3000) / 3000 / abs(fastest)


def choose_timestep(
    frequencies: np.ndarray,
    damping_time: float,
    control_period: float,
    timestep: float | None = None,
    integrator: str | None = None,
) -> TimestepChoice:
    """Apply the rule of this module, or check what the caller fixed.

    Args:
        frequencies: (nv,) [rad/s], increasing.
        damping_time: mu [s].
        control_period: [s].
        timestep: [s], rounded to a divisor of the control period (down); None applies the rule.
        integrator: MuJoCo's name; None applies the rule.

    Warns:
        TimestepWarning: The choice is outside the stability bound, or stiffness forced discrete.
    """
    period = 2 * pi / frequencies[0]
    accurate = min(ACCURACY * period, control_period)
    if integrator is None:
        integrator, reason = _choose_integrator(frequencies, damping_time, accurate)
    else:
        reason = f"{integrator} was asked for"
    limit = stability_limit(integrator, frequencies, damping_time)
    if timestep is None:
        step = min(accurate, SAFETY * limit)
        bound = "accuracy" if step == accurate else "stability"
        reason += f"; {bound} bounds the timestep"
    else:
        step = timestep
        reason += "; the timestep was asked for"
    substeps = max(1, ceil(control_period / step - 1e-9))
    chosen = control_period / substeps
    if chosen > limit:
        warnings.warn(
            f"timestep {chosen:.3g} s with {integrator} is beyond the stability limit "
            f"{limit:.3g} s of the linearised robot: expect divergence",
            TimestepWarning,
            stacklevel=2,
        )
    return TimestepChoice(integrator, chosen, substeps, period, limit, reason)


def _choose_integrator(
    frequencies: np.ndarray, damping_time: float, accurate: float
) -> tuple[str, str]:
    limit = stability_limit("implicitfast", frequencies, damping_time)
    if SAFETY * limit * MAX_SUBSTEPS_RATIO >= accurate:
        return "implicitfast", "implicitfast is stable"
    warnings.warn(
        f"the robot is too stiff and too lightly damped for implicitfast (stable below "
        f"{limit:.3g} s): using discrete, which damps fast modes numerically",
        TimestepWarning,
        stacklevel=3,
    )
    return "discrete", "implicitfast would need very small steps, discrete damps fast modes"
