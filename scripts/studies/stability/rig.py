"""The rig with other tendons, stiffness and damping, and what its servos do."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from math import ceil, inf

import numpy as np
from numpy import ndarray

from softrobot_env.robots import RIG, SERVO_SPEED, RobotParams
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.timestep import stability_limit
from studies.lab import quantity
from studies.stability import runs
from studies.stability.runs import CHAIN, CHAIN_INTEGRATORS, Plan, Reference, Trace, Verdict

#: [s], control period of the rig's environments.
PERIOD = 0.02

#: Bend that the lengths belong to [m], and its azimuth [rad], between the tendons.
_PULL, _AZIMUTH = 6e-3, 0.4

#: [m], by which all tendons are let out until they hang slack; [s] between the commands.
_SLACK, _HOLD = -15e-3, 0.4

#: Way [m] of a servo in a control period.
_REACH = SERVO_SPEED * PERIOD

#: [s] simulated.
DURATION = 1.6


@dataclass(frozen=True)
class Variation:
    """What differs from the rig.

    Attributes:
        tendon_stiffness_scale, stiffness_scale, damping_scale: Factors [1]; that of Young's modulus
            keeps the damping time.
        pretension, friction: [N] of every tendon.
        motion: Key of `MOTIONS`.
    """

    tendon_stiffness_scale: float = 1.0
    stiffness_scale: float = 1.0
    damping_scale: float = 1.0
    pretension: float = RIG.tendons[0].pretension
    friction: float = 0.0
    motion: str = "bend"

    def robot(self) -> RobotParams:
        """The rig so varied."""
        varied = RIG.vary(youngs_modulus=self.stiffness_scale, damping_time=self.damping_scale)
        own = {"pretension": self.pretension, "friction": self.friction}
        tendons = (
            replace(tendon, stiffness=self.tendon_stiffness_scale * tendon.stiffness, **own)
            for tendon in varied.tendons
        )
        return replace(varied, tendons=tuple(tendons))

    def system(self, n: int) -> runs.ChainSystem:
        """The chain on n joints, straight, whose servos follow the motion."""
        driven = {"actuation": "length", "bending": "spatial", "control_period": PERIOD}
        config = SceneConfig(self.robot(), pieces=n // 2, **driven)
        return runs.ChainSystem(config, np.zeros(2 * n), MOTIONS[self.motion])


def _bent(size: float) -> ndarray:
    """Lengths (3,) [m] that fit together: each by its tendon's place in the bend."""
    return size * np.cos(_AZIMUTH - 2 * np.pi * np.arange(3) / 3)


def _toward(targets: ndarray) -> Callable[[float], ndarray]:
    """Lengths over time of servos that hold each of targets (k, 3) [m] for a while."""
    path, lengths = [], np.zeros(3)
    for target in targets:
        for _ in range(round(_HOLD / PERIOD)):
            lengths = lengths + np.clip(target - lengths, -_REACH, _REACH)
            path.append(lengths)
    return lambda time: path[min(int(time / PERIOD + 1e-6), len(path) - 1)]


#: What the servos do: bend to one side, to the other and back; or let out all tendons until they
#: are slack, and tighten them again in a bend.
MOTIONS = {
    "bend": _toward(np.array([_bent(_PULL), _bent(-_PULL), _bent(_PULL), np.zeros(3)])),
    "slack": _toward(np.array([_bent(_PULL), np.full(3, _SLACK), _bent(-_PULL), np.zeros(3)])),
}


# ---------------------------------------------------------------- runs

MAP, RULE, ASKED = "rig_map", "rig_rule", "rig_rule_asked"
CASES = (MAP, RULE, ASKED)

TIMESTEPS = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2)
TENDONS = (1e-2, 1e-1, 1.0, 1e1, 1e2, 1e3, 1e4)
DAMPINGS = (0.0, 0.1, 1.0)

#: A quick run: dampings, tendons and timesteps.
QUICK = (0.0, 1.0), (1.0, 1e4), (1e-3, 5e-3, 2e-2)

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
class RigRow(runs.Row):
    """A run of a varied rig.

    Attributes:
        tendon_stiffness_scale: Of the tendons, over nylon's.
        pretension, friction: [N] of every tendon.
        motion: Key of `MOTIONS`.
        e_tension: [N], mean error of the tensions, None where nothing can judge them.
    """

    tendon_stiffness_scale: float = quantity("", "g", "tendons x")
    pretension: float = quantity("N", "g")
    friction: float = quantity("N", "g")
    motion: str
    e_tension: float | None


def reference(rig: Variation, system: runs.ChainSystem) -> Reference:
    """A refined run, compared with steps twice as long; the uncertainty is infinite if it fails."""
    integrator, step = _refinement(rig, system)
    plan = Plan(integrator, PERIOD, round(DURATION / PERIOD), PERIOD).finer(ceil(PERIOD / step))
    try:
        return runs.refined(system, plan, (1, 2))
    except RuntimeError:
        return Reference(np.empty(0), np.empty((0, 3)), inf)


def _refinement(rig: Variation, system: runs.ChainSystem) -> tuple[str, float]:
    """Integrator and largest step [s]: RK4 neither damps nor drives undamped motion.

    With damping, discrete is the only integrator that finds friction.
    """
    if rig.damping_scale and rig.friction:
        return "discrete", _FRICTION_STEP
    integrator = "implicitfast" if rig.damping_scale else "RK4"
    limit = stability_limit(integrator, system.linear)
    return integrator, min(_REFERENCE_STEP, _LIMIT_SHARE * limit)


def run(
    rig: Variation,
    system: runs.ChainSystem,
    truth: Reference,
    integrator: str,
    timestep: float,
    case: str,
) -> RigRow:
    """One run, of at most `MOST_STEPS` steps, judged by its tip and its tensions."""
    plan = Plan(integrator, timestep, runs.steps_for(DURATION, timestep, 1, MOST_STEPS), PERIOD)
    trace = system.run(plan)
    verdict, error = judged(trace, truth)
    about = {"case": case, "model": CHAIN, "n": JOINTS, "e_bound": BOUND, "e_tension": error}
    about |= {"reference": runs.REFINED, "stability_limit": system.limit(integrator)}
    about["uncertainty"] = None if truth.uncertainty == inf else truth.uncertainty
    return RigRow.of(plan, trace, verdict, **about, **vars(rig))


def judged(trace: Trace, truth: Reference) -> tuple[Verdict, float | None]:
    """How a run ended, and the mean error [N] of its tensions, None where it has none."""
    if trace.failure is None and truth.uncertainty > TRUSTED:
        gap = f"{1e3 * truth.uncertainty:.3g} mm" if truth.uncertainty < inf else "no bound"
        text = f"no truth: refined runs differ by {gap}"
        return Verdict(runs.NO_TRUTH, text, None), None
    verdict = runs.judge(trace, truth, BOUND)
    if verdict.e_max is None:
        return verdict, None
    error = float(np.mean(np.abs(trace.tension - truth.tension[: len(trace.tension)])))
    if verdict.failure is None and error > TENSION_BOUND:
        text = f"finite but wrong: tensions {error:.3g} N from the refined run in the mean"
        return replace(verdict, outcome=runs.WRONG, failure=text), error
    return verdict, error


def jobs(quick: bool = False) -> Iterator[runs.Job]:
    """The map with what the timestep rule picks on it, and the rule for all kinds of rigs."""
    dampings, tendons, steps = QUICK if quick else (DAMPINGS, TENDONS, TIMESTEPS)
    for damping, tendon in product(dampings, tendons):
        rig = Variation(tendon, damping_scale=damping)
        name = f"rig, tendons x {tendon:g}, damping x {damping:g}"
        yield name, partial(variation_rows, rig, steps)
    for rig in () if quick else variations():
        yield "rig, timestep rule", partial(variation_rows, rig, ())


def variations() -> Iterator[Variation]:
    """Rigs beyond the map that the rule has to keep stable."""
    for tendon, modulus, damping in product((1e-2, 1.0, 1e2, 1e4), (0.5, 10.0, 100.0), (0, 1, 10)):
        yield Variation(tendon, modulus, damping)
    for tendon, damping in product((1.0, 1e2, 1e4), (0.0, 1.0)):
        for drive in product((0.0, 0.5, 10.0), (0.0, 0.3), ("bend", "slack")):
            rig = Variation(tendon, 1.0, damping, *drive)
            if rig != Variation(tendon, damping_scale=damping):  # on the map
                yield rig


def variation_rows(rig: Variation, timesteps: tuple[float, ...]) -> list[RigRow]:
    """Runs of a rig with given timesteps and every integrator, and with the rule's choices."""
    system = rig.system(JOINTS)
    truth = reference(rig, system)
    cells = [(*cell, MAP) for cell in product(CHAIN_INTEGRATORS, timesteps)]
    for asked in (None, *CHAIN_INTEGRATORS):
        choice = runs.rule_choice(system, asked, rig.friction > 0)
        cells.append((choice.integrator, choice.timestep, ASKED if asked else RULE))
    return [run(rig, system, truth, *cell) for cell in cells]
