"""How a scene is integrated: by our own integrator, or by one of MuJoCo's with a rule for its step.

Environments and `Scene.simulate` take our own (`scene.integration`), whose steps are as long as
the accuracy allows: `extrapolation` tells it the longest one and the robot's first frequency.

The rest is for whoever asks for an integrator of MuJoCo, and for programs that step the compiled
model by themselves, such as viewers. The chain, linearised about its straight pose with taut
tendons, is M q.. + D q. + K q = 0: K holds the joints and the tendons driven by length, D only the
joints. For a step h the integrators are

* implicitfast (and Euler, implicit): M (q+ - 2 q + q-) / h^2 + D (q+ - q) / h + K q = 0, stable
  while 4 M / h^2 + 2 D / h - K is positive definite. On a mode of frequency w and damping rate
  mu w^2 that is h < mu + sqrt(mu^2 + 4 / w^2); a stiff tendon brings K without D;
* RK4: stable while |R(h lambda)| <= 1 for every root lambda of M lambda^2 + D lambda + K;
* discrete: also implicit in the stiffness, hence stable for any h, but it damps all motion.

The timestep is the largest divisor of the control period that is at most

* `ACCURACY` times the period of the first mode. implicitfast lets a force act half a step early,
  so this bounds the phase error of the first mode by pi ACCURACY;
* `SAFETY` times the stability limit, because bending stiffens the chain's modes
  (`SAFETY_IMPLICIT` for implicit).

A chain without any damping whose tendons are driven by length takes RK4: stiff tendons excite its
fast modes, and implicitfast, which feeds energy into them where a tendon goes slack or taut, is
wrong or diverges more often and without a word (softrobot benchmark stability).

Otherwise implicitfast is taken unless stability would ask for more than `MAX_SUBSTEPS_RATIO` times
the steps that accuracy asks for; then the rule takes discrete and says that fast modes are damped.
Where tendons rub, discrete is taken as well, with at most `FRICTION_STEP`: the others find the
friction as if the joints were undamped, and an arm whose tensions jitter by 4 N is 19 mm off in
place of 3 mm (2 ms, friction of 0.5 N).
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil, inf, pi, sqrt
from typing import NamedTuple

import mujoco
import numpy as np
from numpy import ndarray
from numpy.linalg import cholesky, eigvals, eigvalsh, inv, solve

from softrobot_env.core.processes import one_blas_thread
from softrobot_env.core.records import Vector2
from softrobot_env.robots import RobotParams

from .tendons import actuator_arms, tendon_arms

ACCURACY = 1 / 500
SAFETY = 0.5
#: `implicit` also takes the Coriolis forces' derivatives, and errs more in large undamped swings
#: (softrobot benchmark stability).
SAFETY_IMPLICIT = 0.4
MAX_SUBSTEPS_RATIO = 32
#: [s], largest timestep with dry friction. MuJoCo makes friction softer in longer ones.
FRICTION_STEP = 2e-3

#: [s], largest timestep with contacts, and share of the first period. The latter is less than
#: `ACCURACY`, as an error in time of a touch is one in all that follows (softrobot benchmark
#: contacts).
CONTACT_STEP, CONTACT_ACCURACY = 5e-4, 1 / 2000

#: Links up to which they hold: shorter ones are lighter, and what touches them moves them faster.
STEP_LINKS = 24

#: Those that take contacts. `discrete` makes them stiffer than asked for, the more the longer the
#: timestep, and RK4 takes four times the work to be as inaccurate.
CONTACT_INTEGRATORS = ("implicitfast", "implicit", "Euler")

#: Our own integrator, of `scene.integration`.
EXTRAPOLATION = "extrapolation"

#: The rate of `scene.integration.extrapolation` over the first angular frequency [1].
RATE = 5.0

#: Decay of swings in a control period, as exponents of e, after which nothing is left of them.
GONE = 7.0

#: [s], longest timestep where servos wind up tendons: their way is set once a timestep.
LONGEST_WINDING = 5e-3

#: DOFs up to which damping counts in the limit of a chain whose modes it couples.
_DENSE = 64


class TimestepWarning(UserWarning):
    """A motion is less accurate than asked for, or a timestep is near or beyond stability."""


class Pace(NamedTuple):
    """How fast robots move, numbers or arrays (k,) of many.

    Attributes:
        rate: [1/s], see `scene.integration.extrapolation`.
        swing: [s], the first period of a robot whose swings outlast a control period, or inf.
        damping_time: mu [s], the least of a robot's sections.
        damping_ratio: [1] of the first mode, at least.
    """

    rate: float | ndarray
    swing: float | ndarray
    damping_time: float | ndarray
    damping_ratio: float | ndarray


#: With MuJoCo's integrators.
NO_PACE = Pace(0.0, inf, 0.0, 0.0)


@dataclass(frozen=True)
class TimestepChoice:
    """Integrator and timestep of a scene, and what they were chosen from.

    Attributes:
        integrator: `EXTRAPOLATION`, or MuJoCo's name of one of its own.
        timestep: [s]; of our own integrator the longest step.
        substeps: Such steps per control period.
        first_period: [s] of the slowest mode.
        stability_limit: [s], largest stable timestep of the linearised chain; may be inf.
        reason: One sentence for people.
        accuracy: [m], error of the backbone's position that is wanted; None where the integrator
            does not look at its error.
        pace: Of the robot, or the least of each number of several.
    """

    integrator: str
    timestep: float
    substeps: int
    first_period: float
    stability_limit: float
    reason: str
    accuracy: float | None = None
    pace: Pace = NO_PACE


@dataclass(frozen=True)
class LinearChain:
    """The chain linearised about its straight pose.

    Attributes:
        mass: (nv, nv) [kg m2].
        stiffness: (nv, nv) [N m], of the joints and of tendons driven by length.
        damping: (nv, nv) [N m s].
        driven: Whether tendons are driven by length, which makes springs of them.
    """

    mass: ndarray
    stiffness: ndarray
    damping: ndarray
    driven: bool = False

    @property
    def is_undamped_spring(self) -> bool:
        """Whether tendons are driven by length and nothing takes energy."""
        return self.driven and not np.any(self.damping)

    @cached_property
    def extremes(self) -> Vector2:
        """Smallest and largest undamped angular frequency [rad/s]."""
        found = self.frequencies()
        return float(found[0]), float(found[-1])

    @property
    def damping_time(self) -> float | None:
        """mu [s] where the damping is mu K, else None."""
        if not np.any(self.damping):
            return 0.0
        mu = float(np.max(self.damping) / np.max(np.diag(self.stiffness)))
        return mu if np.allclose(self.damping, mu * self.stiffness, rtol=1e-9, atol=0) else None

    @one_blas_thread()
    def frequencies(self) -> ndarray:
        """Undamped angular frequencies (nv,) [rad/s], increasing."""
        # As 1 / w^2, so that the slow modes are the accurate ones.
        half = inv(cholesky(self.stiffness))
        return 1 / np.sqrt(eigvalsh(half @ self.mass @ half.T)[::-1])


def linearize(model: mujoco.MjModel) -> LinearChain:
    """Linearise a scene about its straight pose, all tendons taut, without free objects."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    springs = -model.actuator_biasprm[:, 1]  # force per length [N/m], zero for tension drives
    arms = tendon_arms(model, data)
    stiffness = np.diag(model.jnt_stiffness[model.dof_jntid])
    stiffness = stiffness + _acting(springs, actuator_arms(model, data))
    stiffness += _acting(model.tendon_stiffness, arms)
    damping = np.diag(model.dof_damping) + _acting(model.tendon_damping, arms)
    robots = np.ix_(*2 * [model.jnt_type[model.dof_jntid] != mujoco.mjtJoint.mjJNT_FREE])
    return LinearChain(mass[robots], stiffness[robots], damping[robots], driven=bool(springs.any()))


def _acting(elements: ndarray, arms: ndarray) -> ndarray:
    """Matrix (nv, nv) of springs or dampers (k,) with moment arms (k, nv) [m]."""
    if not elements.any():
        return np.zeros((arms.shape[1], arms.shape[1]))
    return arms.T @ (elements[:, None] * arms)


@one_blas_thread()
def stability_limit(integrator: str, chain: LinearChain) -> float:
    """Largest stable timestep [s] of the linearised chain, inf where there is none."""
    if integrator == "discrete":
        return inf
    mu = chain.damping_time
    if integrator == "RK4" and mu == 0:
        return sqrt(8) / chain.extremes[1]
    if integrator == "RK4":
        roots = _quadratic_roots(chain.mass, chain.damping, chain.stiffness)
        return float(min(_rk4_limit(root) for root in roots))
    if mu is not None:  # each mode by itself
        return mu + sqrt(mu**2 + 4 / chain.extremes[1] ** 2)
    if len(chain.mass) > _DENSE:
        return 2 / chain.extremes[1]  # damping only helps
    # 4 M x^2 + 2 D x - K turns singular at x = 1 / h; half of the roots are positive.
    roots = _quadratic_roots(4 * chain.mass, 2 * chain.damping, -chain.stiffness)
    return float(1 / np.max(roots.real))


def _quadratic_roots(a: ndarray, b: ndarray, c: ndarray) -> ndarray:
    """Roots (2 n,) x of det(a x^2 + b x + c) = 0 for matrices (n, n)."""
    n = len(a)
    lower = -solve(a, np.hstack([c, b]))
    return eigvals(np.vstack([np.eye(n, 2 * n, n), lower]))


def _rk4_limit(root: complex) -> float:
    """First timestep [s] at which RK4 amplifies a decaying motion exp(root t)."""
    root = complex(min(root.real, 0.0), root.imag)  # rounding must not make an undamped mode grow
    # |R| <= 1 inside the stability region, which ends before |h root| = 3.
    z = np.linspace(0, 3, 3001)[1:] * (root / abs(root))
    growth = np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24)
    unstable = np.flatnonzero(growth > 1 + 1e-9)
    return 3 * (unstable[0] if len(unstable) else 3000) / 3000 / abs(root)


def choose_timestep(
    chain: LinearChain,
    control_period: float,
    timestep: float | None = None,
    integrator: str | None = None,
    *,
    friction: bool = False,
    contacts: float | None = None,
    links: int = STEP_LINKS,
) -> TimestepChoice:
    """Apply the rule of this module, or check what the caller fixed.

    Args:
        chain: The linearised robot.
        control_period: [s].
        timestep: [s], rounded to a divisor of the control period (down); None applies the rule.
        integrator: MuJoCo's name; None applies the rule.
        friction: Whether tendons or the backbone rub.
        contacts: [s] that resolve what touches; None if nothing does.
        links: Of a robot that touches things.

    Warns:
        TimestepWarning: The choice is outside the stability bound, or stiffness forced discrete.
    """
    period, touching = 2 * pi / chain.extremes[0], contacts is not None
    share = CONTACT_ACCURACY if touching else ACCURACY
    accurate = min(share * period, control_period)
    if touching:
        accurate = min(accurate, CONTACT_STEP)
        accurate /= max(1.0, links / STEP_LINKS) ** 2  # shorter ones are lighter
        accurate = max(min(accurate, contacts), accurate / MAX_SUBSTEPS_RATIO)
    if integrator is not None:
        reason = f"{integrator} was asked for"
    else:
        integrator, reason = _choose_integrator(chain, accurate, friction, touching)
        accurate = min(accurate, FRICTION_STEP if integrator == "discrete" and friction else inf)
    limit = stability_limit(integrator, chain)
    if timestep is None:
        safety = SAFETY_IMPLICIT if integrator == "implicit" else SAFETY
        step = min(accurate, safety * limit)
        if step < accurate:
            bound = f"{safety:g} times the stability limit"
        elif step == control_period:
            bound = "the control period"
        else:
            accuracy = f"1/{1 / share:g} of the first period, for accuracy"
            bound = "the most with contacts" if touching and step != share * period else accuracy
        reason += f"; timestep at most {1e3 * step:.3g} ms: {bound}"
    else:
        step = timestep
        reason += "; the timestep was asked for"
    substeps = max(1, ceil(control_period / step - 1e-9))
    chosen = control_period / substeps
    if touching and chosen > min(accurate, contacts) * (1 + 1e-9):
        _warn(
            f"contacts may be inaccurate with a timestep of {chosen:.3g} s, they want "
            f"{min(accurate, contacts):.3g} s or a smaller stiffness"
        )
    if chosen > limit:
        _warn(
            f"timestep {chosen:.3g} s with {integrator} is beyond the stability limit "
            f"{limit:.3g} s of the linearised robot: expect divergence"
        )
    return TimestepChoice(integrator, chosen, substeps, period, limit, reason)


def _warn(text: str, above: int = 0) -> None:
    """Warn whoever has built a scene, from `choose_timestep` or so many calls deeper."""
    warnings.warn(text, TimestepWarning, stacklevel=5 + above)


def _choose_integrator(
    chain: LinearChain, accurate: float, friction: bool, touching: bool
) -> tuple[str, str]:
    """The integrator, and why."""
    if touching:
        return "implicitfast", "implicitfast takes contacts as they are given"
    if chain.is_undamped_spring:
        return "RK4", "RK4 neither damps nor drives undamped motion"
    if friction:
        return "discrete", "discrete includes the damping where something rubs"
    limit = stability_limit("implicitfast", chain)
    if SAFETY * limit * MAX_SUBSTEPS_RATIO >= accurate:
        return "implicitfast", "implicitfast is stable"
    _warn(
        f"the robot is too stiff and too lightly damped for implicitfast (stable below "
        f"{limit:.3g} s): using discrete, which damps fast modes numerically",
        above=1,
    )
    return "discrete", "implicitfast would need very small steps, discrete damps fast modes"


def extrapolation(
    robot: RobotParams,
    control_period: float,
    accuracy: float,
    timestep: float | None = None,
    *,
    winding: bool = False,
) -> TimestepChoice:
    """The choice of our own integrator.

    Args:
        robot: The robot.
        control_period: [s].
        accuracy: [m], wanted.
        timestep: [s], longest step, if asked for.
        winding: Whether tendons are driven by length.
    """
    beam = bent_beam(robot, winding)
    longest = timestep or (LONGEST_WINDING if winding else control_period)
    substeps = max(1, ceil(control_period / longest - 1e-9))
    return TimestepChoice(
        integrator=EXTRAPOLATION,
        timestep=control_period / substeps,
        substeps=substeps,
        first_period=2 * pi / float(beam.frequency({})),
        stability_limit=inf,
        reason=f"steps are as long as {1e3 * accuracy:.3g} mm allow, at most "
        f"{1e3 * control_period / substeps:.3g} ms",
        accuracy=accuracy,
        pace=Pace(*map(float, beam.pace({}, control_period))),
    )


def slowest(robot: RobotParams, winding: bool) -> float:
    """About the first angular frequency [rad/s] of a robot, see `BentBeam`."""
    return float(bent_beam(robot, winding).frequency({}))


@dataclass(frozen=True)
class BentBeam:
    """Rayleigh's quotient of a robot that bends as a uniform one does under a force at its tip.

    Gravity counts only where it stiffens: an upright robot is as fast as without it.

    Attributes:
        mass: [kg] of the backbone, and of what it carries, by the squares of their ways.
        pull: [kg/m] of both, twice how far they sink, over the square of the tip's way.
        stiffness: [N/m] of the backbone, and of tendons whose lengths are held.
        damping_time: mu [s], the least of its sections.
        upward: [m/s2], gravity towards the tip, or 0.
    """

    mass: Vector2
    pull: Vector2
    stiffness: Vector2
    damping_time: float
    upward: float

    def frequency(self, variation: Mapping[str, float | ndarray]) -> ndarray:
        """Angular frequencies (...) [rad/s] by values (...) as `RobotParams.vary` takes them."""
        modulus, density, radius = (
            variation.get(name, 1.0) for name in ("youngs_modulus", "density", "tendon_radius")
        )
        mass, pull = (part[0] * density + part[1] for part in (self.mass, self.pull))
        stiffness = self.stiffness[0] * modulus + self.stiffness[1] * radius**2
        return np.sqrt((stiffness + self.upward * pull) / mass)

    def damping_ratio(self, variation: Mapping[str, float | ndarray]) -> ndarray:
        """Damping ratios (...) [1], at least.

        The backbone has dampers, tendons and weight have none: no mode decays more slowly than the
        backbone's first alone.
        """
        modulus, density = (variation.get(name, 1.0) for name in ("youngs_modulus", "density"))
        damping_time = self.damping_time * np.asarray(variation.get("damping_time", 1.0))
        mass = self.mass[0] * density + self.mass[1]
        decay = damping_time * self.stiffness[0] * modulus / mass / 2
        return decay / self.frequency(variation)

    def pace(self, variation: Mapping[str, float | ndarray], control_period: float) -> Pace:
        """How fast it moves with a control period [s], by values as of `frequency`."""
        frequency, ratio = self.frequency(variation), self.damping_ratio(variation)
        damping_time = self.damping_time * np.asarray(variation.get("damping_time", 1.0))
        swings = (ratio < 1) & (ratio * frequency * control_period < GONE)
        swing = np.where(swings, 2 * pi / frequency, inf)
        return Pace(RATE * frequency, swing, damping_time, ratio)


def bent_beam(robot: RobotParams, winding: bool) -> BentBeam:
    """A robot as a bent beam; winding: whether its tendons are driven by length."""
    backbone, length, ends = robot.backbone, robot.length, robot.backbone.ends

    def shape(s: ndarray) -> ndarray:
        return (3 * length - s) * s**2 / (2 * length**3)

    def raised(s: ndarray) -> ndarray:
        """Twice how far [1/m] a place sinks as the tip moves sideways, over that squared."""
        x = s / length
        return (12 - 9 * x + 9 / 5 * x**2) * x**3 / (4 * length)

    def parts(s: ndarray) -> ndarray:
        mass = backbone.mass(s)
        give = (length - s) ** 2 / backbone.bending(s)
        return np.stack([mass * shape(s) ** 2, mass * raised(s), give])

    mass, pull, give = backbone.integrals(parts, ends).sum(axis=1).tolist()
    carried = [] if robot.head is None else [(length, robot.head.mass)]
    carried += [(disc.station, disc.mass) for disc in robot.discs]
    wound = sum(t.stiffness * t.mean_square() * t.end for t in robot.tendons) / 2 if winding else 0
    return BentBeam(
        mass=(mass, sum(m * shape(s) ** 2 for s, m in carried)),
        pull=(pull, sum(m * raised(s) for s, m in carried)),
        stiffness=(1 / give, 3 * wound / length**3),
        damping_time=min(section.damping_time for section in backbone.sections),
        upward=max(robot.own_gravity[2], 0.0),
    )
