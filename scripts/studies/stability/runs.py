"""Run one model with one integrator and timestep, or refined.

Both kinds of systems, the MuJoCo chain and the beam models, run through the same interface: `run`
returns a `Trace`, which says how the run ended instead of raising.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from math import ceil, isinf
from time import perf_counter
from typing import Any, Self

import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.beams.model import BeamModel, IntegrationError, State
from softrobot_env.beams.signals import Signal
from softrobot_env.evaluation.models.runs import distance, silent_warnings, unwarned
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.simulation import DIVERGING
from softrobot_env.scene.timestep import TimestepChoice, choose_timestep, linearize, stability_limit
from studies.beams import zero_timestep
from studies.lab import Record, quantity

#: How a run can fail: its motion grows beyond all bounds, or it gives up because Newton's
#: iteration failed or adapted steps became too many.
DIVERGED, NOT_CONVERGED = "diverged", "not_converged"

#: Integrators of the MuJoCo chain, and methods of the beam models.
CHAIN_INTEGRATORS = ("implicitfast", "discrete", "Euler", "implicit", "RK4")
BEAM_METHODS = ("implicit_euler", "sdirk2", "sdirk4", "rk4")

#: Suffix of a beam's method whose steps follow its error estimate.
ADAPTIVE = " adaptive"

CHAIN = "mujoco_chain/balanced2"

#: Tolerances of adapted reference runs, the coarser first.
_REFERENCE_TOLERANCES = (1e-6, 1e-7)

#: Steps after which an adaptive run gives up.
_MOST_ADAPTED = 20_000

#: Description for the progress bar, and what makes rows.
Job = tuple[str, Callable[[], list]]


@dataclass(frozen=True)
class Trace:
    """The tip during a run.

    Attributes:
        time: (k,) [s].
        tip: (k, 2) [m] in (x, z), of a spatial chain (k, 3); without the part after a failure.
        failure: What failed and when, or None.
        wall_time: [s].
        steps: Steps taken.
        tension: (k, nu) [N] of the chain's tendons, in the step before each instant.
    """

    time: ndarray
    tip: ndarray
    failure: str | None
    wall_time: float
    steps: int
    tension: ndarray | None = None

    @property
    def outcome(self) -> str | None:
        """`DIVERGED` or `NOT_CONVERGED` if the run failed, else None."""
        if self.failure is None:
            return None
        return DIVERGED if self.failure.startswith(DIVERGED) else NOT_CONVERGED


@dataclass(frozen=True)
class Plan:
    """What to simulate.

    Attributes:
        integrator: Name of the integrator or method; `ADAPTIVE` after it adapts the steps.
        timestep: [s].
        steps: Steps in all.
        sample: [s], about the distance of the instants at which the tip is read.
        tolerance: Of a beam's adapted steps and Newton's iteration, see `BeamModel.simulate`.
    """

    integrator: str
    timestep: float
    steps: int
    sample: float
    tolerance: float = 1e-6

    def finer(self, factor: int) -> "Plan":
        """The same with so many times as many steps."""
        return replace(self, timestep=self.timestep / factor, steps=self.steps * factor)


def steps_for(duration: float, timestep: float, least: int, most: int) -> int:
    """Steps that cover a duration [s], but between `least` and `most`."""
    return max(least, min(most, ceil(duration / timestep - 1e-9)))


#: Controls (nu,) over time [s]; called before every step when they change.
Controls = Callable[[float], ndarray]


class ChainSystem:
    """The MuJoCo chain.

    Args:
        config: The scene; its timestep and integrator are replaced in every run.
        posture: (nq,) [rad] at the start.
        controls: (nu,), constant; or their function of time, held for a control period.
    """

    def __init__(self, config: SceneConfig, posture: ndarray, controls: ndarray | Controls) -> None:
        self.scene, self.posture, self.controls = neutral_scene(config), posture, controls
        self.axes = [0, 2] if config.bending == "planar" else [0, 1, 2]
        self.linear = linearize(self.scene.model)

    def limit(self, integrator: str) -> float | None:
        """Stability limit [s] of the linearised chain; None without one."""
        limit = stability_limit(integrator, self.linear)
        return None if isinf(limit) else float(limit)

    @silent_warnings()
    def run(self, plan: Plan) -> Trace:
        """Simulate; failures are reported, not raised."""
        model, varying = self.scene.model, callable(self.controls)
        model.opt.timestep = plan.timestep
        model.opt.integrator = mujoco_integrator(plan.integrator)
        data = mujoco.MjData(model)
        data.qpos[:] = self.posture
        if not varying:
            data.ctrl[:] = self.controls
        sample = self.scene.config.control_period if varying else plan.sample
        chunk = max(1, round(sample / plan.timestep))
        tip = data.site("tip").xpos
        times, tips, tensions, done, failure = [], [], [], 0, None
        begin = perf_counter()
        while failure is None:
            mujoco.mj_kinematics(model, data)
            failure = chain_failure(data, tip)
            if failure is None:
                times.append(done * plan.timestep)
                tips.append(tip[self.axes])
                tensions.append(data.actuator_force.copy())
            count = min(chunk, plan.steps - done)
            if count == 0:
                break
            if varying:
                data.ctrl[:] = self.controls(done * plan.timestep)
            mujoco.mj_step(model, data, count)
            done += count
        series = np.array(times), np.array(tips)
        return Trace(*series, failure, perf_counter() - begin, done, np.array(tensions))


@unwarned()
def rule_choice(
    system: ChainSystem, asked: str | None = None, friction: bool = False
) -> TimestepChoice:
    """What `scene.timestep` picks for a chain; `asked` fixes the integrator."""
    period = system.scene.config.control_period
    return choose_timestep(system.linear, period, integrator=asked, friction=friction)


def neutral_scene(config: SceneConfig) -> Scene:
    """The scene with an integrator that no timestep warns of; both are set before every run."""
    return build_scene(replace(config, integrator="discrete", timestep=config.control_period))


def mujoco_integrator(name: str) -> int:
    """MuJoCo's number of an integrator."""
    return int(getattr(mujoco.mjtIntegrator, f"mjINT_{name.upper()}"))


def chain_failure(data: mujoco.MjData, tip: ndarray) -> str | None:
    """What diverged and when, or None; `tip` (3,) [m] must be up to date."""
    bad = [name for index, name in DIVERGING.items() if data.warning[index].number]
    if not bad and np.all(np.isfinite(tip)):
        return None
    what = " and ".join(bad) or "tip position"
    return f"diverged at t = {data.time:.4g} s: {what} not finite or huge"


class BeamSystem:
    """A beam model.

    Args:
        model: The model.
        q: Its coordinates (n,) at the start, at rest.
        inputs: Constant inputs (n_inputs,), or a signal.
    """

    def __init__(self, model: BeamModel, q: ndarray, inputs: ndarray | Signal) -> None:
        self.model, self.inputs = model, inputs
        self.start = State(q, np.zeros(model.n))

    def limit(self, integrator: str) -> None:
        """None is known."""

    def run(self, plan: Plan) -> Trace:
        """Simulate; failures are reported, not raised."""
        h, adaptive = plan.timestep, plan.integrator.endswith(ADAPTIVE)
        chunk = max(1, round(plan.sample / h))
        samples = h * np.unique([*range(0, plan.steps, chunk), plan.steps])
        begin = perf_counter()
        try:
            method = plan.integrator.removesuffix(ADAPTIVE)
            own = {"method": method, "tolerance": plan.tolerance, "samples": samples}
            own |= {"step": h, "max_steps": plan.steps + 1}
            own |= {"step": None, "max_steps": _MOST_ADAPTED} if adaptive else {}
            motion = self.model.simulate(samples[-1], self.inputs, self.start, **own)
        except IntegrationError as error:
            # The message starts with what happened and goes on with " at t = ".
            what = str(error).split(" at t = ")[0].removeprefix("the motion ")
            failure = f"{what} at t = {error.time:.4g} s"
            return Trace(np.empty(0), np.empty((0, 2)), failure, perf_counter() - begin, 0)
        wall_time = perf_counter() - begin
        tip = self.model.tip(motion.q)[:, [0, 2]]
        return Trace(motion.time, tip, None, wall_time, motion.steps)


#: A model at rest whose inputs are about to change.
System = ChainSystem | BeamSystem


@dataclass(frozen=True)
class Reference:
    """A refined motion of the same model.

    Attributes:
        time: (k,) [s].
        tip: (k, 2) or (k, 3) [m].
        uncertainty: [m], largest distance to the same with coarser steps.
        tension: (k, nu) [N] as that of a `Trace`, where it is judged.
    """

    time: ndarray
    tip: ndarray
    uncertainty: float
    tension: ndarray | None = None

    @classmethod
    def of(cls, coarse: Trace, fine: Trace) -> Self:
        """The finer of two refined runs; the coarser one says how well it is known."""
        return cls(fine.time, fine.tip, distance(coarse.tip, fine.tip), fine.tension)

    def at(self, time: ndarray) -> ndarray:
        """Tip (k, 2) or (k, 3) [m] at instants (k,) [s] that it covers."""
        from scipy.interpolate import CubicSpline

        return CubicSpline(self.time, self.tip)(time)

    def stretched(self, factor: float) -> "Reference":
        """The motion of a robot that is slower by a factor and otherwise similar."""
        return Reference(factor * self.time, self.tip, self.uncertainty)


def chain_reference(system: ChainSystem, duration: float, sample: float, most: float) -> Reference:
    """Extrapolate implicitfast to zero timestep with steps h, h/2 and h/4 (Neville's scheme).

    Args:
        system: The chain.
        duration: [s].
        sample: [s] between the instants; the steps divide it.
        most: [s], largest step h; it has to be stable.
    """
    count = ceil(sample / most)
    plan = Plan("implicitfast", sample, round(duration / sample), sample).finer(count)
    traces = refined_runs(system, [plan.finer(k) for k in (1, 2, 4)])
    limit, second = zero_timestep([trace.tip for trace in traces])
    return Reference(traces[0].time, limit, distance(limit, second))


def beam_reference(system: BeamSystem, duration: float, sample: float) -> Reference:
    """Refined motion of a beam with four steps a sample, compared with steps twice as large.

    Where Newton's iteration fails for such steps, they are adapted to a tight tolerance, and
    compared with those of one ten times as large.
    """
    plan = Plan("sdirk4", sample, round(duration / sample), sample)
    try:
        return refined(system, plan, (2, 4))
    except RuntimeError:
        adapted = replace(plan, integrator=plan.integrator + ADAPTIVE)
        plans = [replace(adapted, tolerance=tolerance) for tolerance in _REFERENCE_TOLERANCES]
        return Reference.of(*refined_runs(system, plans))


def refined(system: System, plan: Plan, factors: tuple[int, int]) -> Reference:
    """A run with so many times as many steps, compared with one with fewer.

    Raises:
        RuntimeError: One of them failed, or both are equal: the steps had no effect.
    """
    found = Reference.of(*refined_runs(system, [plan.finer(factor) for factor in factors]))
    if found.uncertainty == 0:
        raise RuntimeError("the refined runs are equal: they cannot verify each other")
    return found


def refined_runs(system: System, plans: Iterable[Plan]) -> list[Trace]:
    """Runs that others are judged by.

    Raises:
        RuntimeError: One of them failed.
    """
    traces = [system.run(plan) for plan in plans]
    for trace in traces:
        if trace.failure:
            raise RuntimeError(f"the refined run failed: {trace.failure}")
    return traces


# ---------------------------------------------------------------- verdicts

#: How a run can end, besides `DIVERGED` and `NOT_CONVERGED`. A wrong run stays finite, but its tip
#: leaves the error bound. One without truth ended, but refined runs differ too much to judge it by
#: them.
STABLE, WRONG, NO_TRUTH = "stable", "wrong", "no_truth"

#: What runs are judged by.
REFINED = "refined run of the same model"
OUTCOMES = (STABLE, WRONG, DIVERGED, NOT_CONVERGED, NO_TRUTH)

#: Instants in three periods, with the first, below which the motion between them is compared too.
_LEAST_INSTANTS = 7


@dataclass(frozen=True)
class Verdict:
    """How a run ended.

    Attributes:
        outcome: One of `OUTCOMES`.
        failure: What failed and when, or None.
        e_max: [m], largest distance of the tip from the truth; None if the run did not end.
    """

    outcome: str
    failure: str | None
    e_max: float | None


def judge(trace: Trace, truth: Reference, bound: float) -> Verdict:
    """Classify a run; instants that the truth does not cover count for failures only.

    A run with very few instants, which could be right by chance, is compared between them too.
    """
    if trace.failure:
        return judge_errors(trace, np.empty(0), bound, "")
    covered = trace.time <= truth.time[-1] * (1 + 1e-9)
    known = replace(
        trace, time=trace.time[covered].clip(max=truth.time[-1]), tip=trace.tip[covered]
    )
    if len(known.time) < _LEAST_INSTANTS:
        time = truth.time[truth.time <= trace.time[-1]]
        tip = np.stack([np.interp(time, trace.time, x) for x in trace.tip.T], axis=1)
        known = replace(trace, time=time, tip=tip)
    gap = np.linalg.norm(known.tip - truth.at(known.time), axis=1)
    return judge_errors(known, gap, bound, "the refined run")


def judge_errors(trace: Trace, errors: ndarray, bound: float, name: str) -> Verdict:
    """Classify a run by its errors (k,) [m] at its last k instants, against what has a name."""
    if trace.failure:
        return Verdict(trace.outcome, trace.failure, None)
    worst = int(np.argmax(errors))
    e_max, time = float(errors[worst]), trace.time[worst - len(errors)]
    if e_max <= bound:
        return Verdict(STABLE, None, e_max)
    text = f"finite but wrong: tip {1e3 * e_max:.3g} mm from {name} at t = {time:.4g} s"
    return Verdict(WRONG, text, e_max)


@dataclass(frozen=True, kw_only=True)
class Row(Record):
    """A run.

    Attributes:
        case: What was run: see `stability.study.run`.
        model, n: Model, and its number of hinges or pieces.
        timestep: [s], the mean one where it adapts.
        integrator: Its name.
        stiffness_scale, damping_scale: Young's modulus and damping time over those of the robot.
        damping_ratio: [1] of the first mode.
        stable, outcome, failure: How it ended: one of `OUTCOMES`, and why.
        e_max: [m], largest distance of the tip from the truth; None for runs that did not reach
            their end, or that nothing can judge.
        e_bound: [m].
        wall_time: [s].
        duration: [s] simulated, had it not failed.
        stability_limit: [s] of the linearised chain.
        reference: The truth.
        uncertainty: [m] of the truth.
    """

    case: str
    model: str
    n: int
    timestep: float = quantity("ms", ".3g", "h")
    integrator: str
    stiffness_scale: float = 1.0
    damping_scale: float = 1.0
    damping_ratio: float | None = None
    stable: bool
    outcome: str
    failure: str | None
    e_max: float | None = quantity("mm", ".2g", "error")
    e_bound: float = quantity("mm", ".2g", "bound")
    wall_time: float = quantity("s", ".2g", "time")
    duration: float
    stability_limit: float | None = None
    reference: str | None = None
    uncertainty: float | None = None

    @classmethod
    def of(cls, plan: Plan, trace: Trace, verdict: Verdict, **others: Any) -> Self:
        """The row of a run that was planned and ended so; `others` are further fields."""
        steps = {"timestep": plan.timestep, "integrator": plan.integrator}
        spent = {"wall_time": trace.wall_time, "duration": plan.timestep * plan.steps}
        return cls(stable=verdict.outcome == STABLE, **vars(verdict), **steps, **spent, **others)
