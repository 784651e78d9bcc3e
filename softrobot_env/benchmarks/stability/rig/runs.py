"""Runs of a varied rig, judged by their tip and tensions against refined ones."""

from dataclasses import dataclass, replace
from math import ceil, inf, isinf

import numpy as np

from softrobot_env.benchmarks.accuracy.rows import distance
from softrobot_env.benchmarks.stability.rig.cases import DURATION, PERIOD, Variation
from softrobot_env.benchmarks.stability.runs import (
    CHAIN,
    ChainSystem,
    Plan,
    Reference,
    Trace,
    steps_for,
)
from softrobot_env.benchmarks.stability.verdicts import NO_TRUTH, WRONG, Row, Verdict, judge
from softrobot_env.robots import RIG
from softrobot_env.scene.timestep import stability_limit

#: Joints of the rig's environments.
JOINTS = 8

#: [m], 5 % of the length; [N], a twentieth of the tensions' limit, in the mean over the run.
BOUND = 0.05 * RIG.length
TENSION_BOUND = RIG.tendons[0].tension_limit / 20

MOST_STEPS = 16_000
_REFERENCE_STEP, _FRICTION_STEP = 2e-4, 1e-4
_LIMIT_SHARE = 0.4

#: [m], largest distance of refined runs that can judge another one.
TRUSTED = BOUND / 3


@dataclass(frozen=True)
class RigRow(Row):
    """A run of a varied rig.

    Attributes:
        tendon_stiffness_scale: Of the tendons, over nylon's.
        pretension, friction: [N] of every tendon.
        motion: Key of `MOTIONS`.
        e_tension: [N], mean error of the tensions, None where nothing can judge them.
    """

    tendon_stiffness_scale: float
    pretension: float
    friction: float
    motion: str
    e_tension: float | None


@dataclass(frozen=True)
class Truth:
    """A refined run.

    Attributes:
        trace: The run.
        uncertainty: [m], its distance from one with steps twice as long; infinite if one failed.
    """

    trace: Trace
    uncertainty: float


def reference(rig: Variation, system: ChainSystem) -> Truth:
    """A refined run, compared with steps twice as long."""
    integrator, step = _refinement(rig, system)
    count = 2 * ceil(PERIOD / step)
    coarse, fine = (
        system.run(Plan(integrator, PERIOD / k, round(DURATION / PERIOD) * k, PERIOD))
        for k in (count // 2, count)
    )
    if coarse.failure or fine.failure:
        return Truth(fine, inf)
    return Truth(fine, distance(coarse.tip, fine.tip))


def _refinement(rig: Variation, system: ChainSystem) -> tuple[str, float]:
    """Integrator and largest step [s]: RK4 neither damps nor drives undamped motion.

    With damping, discrete is the only integrator that finds friction.
    """
    if rig.damping and rig.friction:
        return "discrete", _FRICTION_STEP
    integrator = "implicitfast" if rig.damping else "RK4"
    limit = stability_limit(integrator, system.linear)
    return integrator, min(_REFERENCE_STEP, _LIMIT_SHARE * limit)


def run(
    rig: Variation, system: ChainSystem, truth: Truth, integrator: str, timestep: float, case: str
) -> RigRow:
    """One run, of at most `MOST_STEPS` steps, judged by its tip and its tensions."""
    plan = Plan(integrator, timestep, steps_for(DURATION, timestep, 1, MOST_STEPS), PERIOD)
    trace = system.run(plan)
    verdict, error = judged(trace, truth)
    limit = stability_limit(integrator, system.linear)
    return RigRow.of(
        case,
        CHAIN,
        JOINTS,
        plan,
        verdict,
        BOUND,
        trace.wall_time,
        stiffness_scale=rig.modulus,
        damping_scale=rig.damping,
        stability_limit=None if isinf(limit) else float(limit),
        reference="refined run of the same model",
        uncertainty=None if isinf(truth.uncertainty) else truth.uncertainty,
        tendon_stiffness_scale=rig.tendon_stiffness,
        pretension=rig.pretension,
        friction=rig.friction,
        motion=rig.motion,
        e_tension=error,
    )


def judged(trace: Trace, truth: Truth) -> tuple[Verdict, float | None]:
    """How a run ended, and the mean error [N] of its tensions, None where it has none."""
    if trace.failure is None and truth.uncertainty > TRUSTED:
        gap = f"{1e3 * truth.uncertainty:.3g} mm" if truth.uncertainty < inf else "no bound"
        text = f"no truth: refined runs differ by {gap}"
        return Verdict(NO_TRUTH, text, None), None
    path = Reference(truth.trace.time, truth.trace.tip, truth.uncertainty)
    verdict = judge(trace, path, BOUND)
    if verdict.e_max is None:
        return verdict, None
    error = tension_error(trace, truth.trace)
    if verdict.failure is None and error > TENSION_BOUND:
        text = f"finite but wrong: tensions {error:.3g} N from the refined run in the mean"
        return replace(verdict, outcome=WRONG, failure=text), error
    return verdict, error


def tension_error(trace: Trace, truth: Trace) -> float:
    """Mean distance [N] of the tensions of two runs, as long as both last."""
    count = min(len(trace.tension), len(truth.tension))
    return float(np.mean(np.abs(trace.tension[:count] - truth.tension[:count])))
