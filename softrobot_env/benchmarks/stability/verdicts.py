"""How runs ended, judged against refined ones, and the rows that say so."""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from softrobot_env.benchmarks.records import Record
from softrobot_env.benchmarks.stability.runs import DIVERGED, NOT_CONVERGED, Plan, Reference, Trace

#: How a run can end, besides `DIVERGED` and `NOT_CONVERGED`. A wrong run stays finite, but its tip
#: leaves the error bound. One without truth ended, but refined runs differ too much to judge it by
#: them.
STABLE, WRONG, NO_TRUTH = "stable", "wrong", "no_truth"
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


def judge(trace: Trace, truth: Reference, bound: float, name: str = "the refined run") -> Verdict:
    """Classify a run; instants that the truth does not cover count for failures only.

    A run with very few instants, which could be right by chance, is compared between them too.
    """
    if trace.outcome is not None:
        return Verdict(trace.outcome, trace.failure, None)
    covered = trace.time <= truth.time[-1] * (1 + 1e-9)
    time, tip = np.minimum(trace.time[covered], truth.time[-1]), trace.tip[covered]
    if len(time) < _LEAST_INSTANTS:
        time = truth.time[truth.time <= trace.time[-1]]
        tip = np.stack([np.interp(time, trace.time, x) for x in trace.tip.T], axis=1)
    return judge_errors(time, np.linalg.norm(tip - truth.at(time), axis=1), bound, name)


def judge_errors(time: np.ndarray, error: np.ndarray, bound: float, name: str) -> Verdict:
    """Classify a finite run by its errors (k,) [m] at instants (k,) [s]."""
    worst = int(np.argmax(error))
    e_max = float(error[worst])
    if e_max <= bound:
        return Verdict(STABLE, None, e_max)
    text = f"finite but wrong: tip {1e3 * e_max:.3g} mm from {name} at t = {time[worst]:.4g} s"
    return Verdict(WRONG, text, e_max)


@dataclass(frozen=True, kw_only=True)
class Row(Record):
    """A run.

    Attributes:
        case: What was run: see `benchmarks.stability.run`.
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
    timestep: float
    integrator: str
    stiffness_scale: float = 1.0
    damping_scale: float = 1.0
    damping_ratio: float | None = None
    stable: bool
    outcome: str
    failure: str | None
    e_max: float | None
    e_bound: float
    wall_time: float
    duration: float
    stability_limit: float | None = None
    reference: str | None = None
    uncertainty: float | None = None

    @classmethod
    def of(
        cls,
        case: str,
        model: str,
        n: int,
        plan: Plan,
        verdict: Verdict,
        bound: float,
        wall_time: float,
        **others: Any,
    ) -> Self:
        """The row of a run that was planned and ended so; `others` are further fields."""
        return cls(
            case=case,
            model=model,
            n=n,
            timestep=plan.timestep,
            integrator=plan.integrator,
            stable=verdict.outcome == STABLE,
            **vars(verdict),
            e_bound=bound,
            wall_time=wall_time,
            duration=plan.timestep * plan.steps,
            **others,
        )
