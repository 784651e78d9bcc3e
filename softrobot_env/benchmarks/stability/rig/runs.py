"""Which timesteps are safe for the rig: elastic tendons, pretension, slack and friction.

The map is over the timestep and the stiffness of the tendons, from a hundredth of nylon's to that
of steel. Servos that hold the ends of stiff tendons bring stiffness without damping, and tendons
cannot push nor pull beyond their limit, so a run may be unstable without ever growing: its tensions
jump between zero and the limit. Hence tensions are judged besides the tip. Stiff tendons that
tighten on an undamped rig strike like hammers: then small errors grow to any size within a second,
refined runs differ, and all that can be said of a run is whether it ended.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from math import ceil, inf, isinf

import numpy as np

from softrobot_env.benchmarks.accuracy.rows import distance
from softrobot_env.benchmarks.stability.rig.cases import DURATION, PERIOD, Variation
from softrobot_env.benchmarks.stability.runs import (
    CHAIN,
    CHAIN_INTEGRATORS,
    ChainSystem,
    Plan,
    Reference,
    Trace,
    rule_choice,
    steps_for,
)
from softrobot_env.benchmarks.stability.verdicts import NO_TRUTH, WRONG, Row, Verdict, judge
from softrobot_env.core.jobs import Job
from softrobot_env.robots import RIG
from softrobot_env.scene.timestep import stability_limit

MAP, RULE, ASKED = "rig_map", "rig_rule", "rig_rule_asked"
CASES = (MAP, RULE, ASKED)

TIMESTEPS = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)
TENDONS = (1e-2, 1e-1, 1.0, 1e1, 1e2, 1e3, 1e4)
DAMPINGS = (0.0, 0.1, 1.0)

#: A quick run.
QUICK_TIMESTEPS, QUICK_TENDONS, QUICK_DAMPINGS = (1e-3, 5e-3, 2e-2), (1.0, 1e4), (0.0, 1.0)

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


@dataclass(frozen=True, kw_only=True)
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


def reference(rig: Variation, system: ChainSystem) -> Reference:
    """A refined run, compared with steps twice as long; the uncertainty is infinite if it fails."""
    integrator, step = _refinement(rig, system)
    plan = Plan(integrator, PERIOD, round(DURATION / PERIOD), PERIOD).finer(ceil(PERIOD / step))
    coarse, fine = system.run(plan), system.run(plan.finer(2))
    failed = coarse.failure or fine.failure
    uncertainty = inf if failed else distance(coarse.tip, fine.tip)
    return Reference(fine.time, fine.tip, uncertainty, fine.tension)


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
    rig: Variation,
    system: ChainSystem,
    truth: Reference,
    integrator: str,
    timestep: float,
    case: str,
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


def judged(trace: Trace, truth: Reference) -> tuple[Verdict, float | None]:
    """How a run ended, and the mean error [N] of its tensions, None where it has none."""
    if trace.failure is None and truth.uncertainty > TRUSTED:
        gap = f"{1e3 * truth.uncertainty:.3g} mm" if truth.uncertainty < inf else "no bound"
        text = f"no truth: refined runs differ by {gap}"
        return Verdict(NO_TRUTH, text, None), None
    verdict = judge(trace, truth, BOUND)
    if verdict.e_max is None:
        return verdict, None
    error = tension_error(trace, truth)
    if verdict.failure is None and error > TENSION_BOUND:
        text = f"finite but wrong: tensions {error:.3g} N from the refined run in the mean"
        return replace(verdict, outcome=WRONG, failure=text), error
    return verdict, error


def tension_error(trace: Trace, truth: Reference) -> float:
    """Mean distance [N] of the tensions of two runs, as long as both last."""
    count = min(len(trace.tension), len(truth.tension))
    return float(np.mean(np.abs(trace.tension[:count] - truth.tension[:count])))


def jobs(quick: bool = False) -> Iterator[Job]:
    """The map with what the timestep rule picks on it, and the rule for all kinds of rigs."""
    tendons, dampings = (QUICK_TENDONS, QUICK_DAMPINGS) if quick else (TENDONS, DAMPINGS)
    steps = QUICK_TIMESTEPS if quick else TIMESTEPS
    for damping in dampings:
        for tendon in tendons:
            rig = Variation(tendon_stiffness=tendon, damping=damping)
            name = f"rig, tendons x {tendon:g}, damping x {damping:g}"
            yield name, lambda r=rig: variation_rows(r, steps)
    for rig in () if quick else variations():
        yield "rig, timestep rule", lambda r=rig: variation_rows(r, ())


def variations() -> Iterator[Variation]:
    """Rigs beyond the map that the rule has to keep stable."""
    for tendon, modulus, damping in product((1e-2, 1.0, 1e2, 1e4), (0.5, 10.0, 100.0), (0, 1, 10)):
        yield Variation(tendon, modulus, damping)
    for tendon, damping in product((1.0, 1e2, 1e4), (0.0, 1.0)):
        for drive in product((0.0, 0.5, 10.0), (0.0, 0.3), ("bend", "slack")):
            rig = Variation(tendon, 1.0, damping, *drive)
            if rig != Variation(tendon, damping=damping):  # on the map
                yield rig


def variation_rows(rig: Variation, timesteps: tuple[float, ...]) -> list[RigRow]:
    """Runs of a rig with given timesteps and every integrator, and with the rule's choices."""
    system = rig.system(JOINTS)
    truth = reference(rig, system)
    rows = [
        run(rig, system, truth, integrator, timestep, MAP)
        for integrator in CHAIN_INTEGRATORS
        for timestep in timesteps
    ]
    for asked in (None, *CHAIN_INTEGRATORS):
        choice = rule_choice(system, asked, rig.friction > 0)
        case = RULE if asked is None else ASKED
        rows.append(run(rig, system, truth, choice.integrator, choice.timestep, case))
    return rows
