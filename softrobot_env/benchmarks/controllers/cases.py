"""Episodes of the controller benchmark, and their rows."""

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.benchmarks.episodes import EpisodeRecord, record_of
from softrobot_env.benchmarks.records import for_pictures, one
from softrobot_env.evaluation import runner
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.tasks import make_task
from softrobot_env.thesis.figures import CONTROLLERS

#: Parameter that sec. 6.6.3 varies.
E = "youngs_modulus"

#: The thesis' plant by its name in `beams.registry`.
PCC = "pcc"

#: Task and step width [m] of everything that is run.
TASKS = (("step", 0.05), ("step", 0.1), ("step", 0.2), ("swing", None), ("lshape", None))

#: Episodes of these policies on a step last [s] longer than the 5 s of the others: they damp
#: nothing and settle late.
_SLOW, _LONG = ("qs_nn", "feedforward", "feedforward_pi"), 25.0

#: Times [s] between which the error during a motion is taken: without the decay after a kink.
MOTION = {"swing": ((0.5, 10.0),), "lshape": ((1.0, 5.0), (6.0, 10.0))}

_SAMPLE = 0.01  # s, of a trace

#: Policies in Figs. 6.14 to 6.19: the thesis' controllers, and ours to compare.
COMPARED = (*CONTROLLERS, "lq_adaptive")

#: Tasks of these figures.
_DRAWN = (("step", 0.05), ("swing", None), ("lshape", None))

#: Policies whose behaviour with another Young's modulus is shown, and names of their figures.
VARIED = {
    "qs_nn": "fig_6_20",
    "lqi": "fig_6_21",
    "mpc": "fig_6_22",
    "lq_adaptive": "robustness_lq_adaptive",
    "mpc_preview": "robustness_mpc_preview",
}


@dataclass(frozen=True, kw_only=True)
class ControllerRow(EpisodeRecord):
    """An episode.

    Attributes:
        setting: What it belongs to, one of `controllers.run.SETTINGS`.
        feedback: What the policy measured.
        e_motion, e_motion_least: [m], largest and smallest error between the kinks of the
            reference; None for steps, and after a failure.
        trace: Every few milliseconds of an episode that a figure shows, and its last curvature.
    """

    setting: str
    feedback: str
    e_motion: float | None
    e_motion_least: float | None
    trace: Rollout | None = for_pictures()  # noqa: RUF009

    @property
    def modulus(self) -> float | None:
        """Factor on Young's modulus; None where something else varies."""
        return 1.0 if not self.variation else self.variation.get(E)


@dataclass(frozen=True, kw_only=True)
class VariedRow(ControllerRow):
    """An episode with another robot than the policy knows.

    Attributes:
        e_max_ratio, e_rms_ratio: Errors over those with the nominal robot [1]; None if there are
            none.
    """

    e_max_ratio: float | None
    e_rms_ratio: float | None


def make_case(
    plant: str,
    policy: str,
    task: str,
    width: float | None = None,
    variation: dict[str, float] | None = None,
    feedback: str = "state",
) -> runner.Case:
    """An episode on one of the plants PCC and MUJOCO; a step has a width [m]."""
    return runner.Case(
        make_task(task, width),
        policy,
        variation=variation or {},
        plant=plant,
        feedback=feedback,
        duration=_LONG if width is not None and policy in _SLOW else None,
    )


def measures_rates(policy: str) -> bool:
    """Whether a policy measures curvature rates, so that output feedback changes it."""
    case = make_case(MUJOCO, policy, "swing")
    return "curvature_rate" in case.make_policy(case.environment().control_period).requires


def run_case(setting: str, case: runner.Case) -> ControllerRow:
    """Run an episode of a setting."""
    outcome = runner.run(case)
    least, most = motion_errors(outcome.rollout, case.task.name)
    return record_of(
        outcome,
        ControllerRow,
        setting=setting,
        feedback=case.feedback,
        e_motion=most,
        e_motion_least=least,
        trace=_trace(outcome.rollout) if _is_drawn(case) else None,
    )


def _is_drawn(case: runner.Case) -> bool:
    """Whether a figure shows an episode."""
    task = case.task.name, case.task.step_width
    compared = case.policy in COMPARED and task in _DRAWN and not case.variation
    varied = case.policy in VARIED and task == ("swing", None) and set(case.variation) <= {E}
    return case.plant == PCC and (compared or varied)


def _trace(rollout: Rollout) -> Rollout:
    """What the figures need of it."""
    shown = rollout.thinned(_SAMPLE).slim("tendon_tension")
    return replace(shown, curvature=rollout.curvature[-1:])


def motion_errors(rollout: Rollout, task: str) -> tuple[float | None, float | None]:
    """Smallest and largest error [m] of the tip between the kinks of the reference.

    None for steps, and after a failure.
    """
    if rollout.failure is not None or task not in MOTION:
        return None, None
    inside = [(rollout.time > begin) & (rollout.time < end) for begin, end in MOTION[task]]
    error = rollout.error[np.any(inside, axis=0)]
    return float(error.min()), float(error.max())


def moduli(rows: Iterable[ControllerRow]) -> list[float]:
    """Factors on Young's modulus that occur, 1 among them, in ascending order."""
    return sorted({1.0} | {row.modulus for row in rows if row.modulus is not None})


def with_ratios(rows: list[ControllerRow]) -> list[ControllerRow]:
    """The rows, those of varied robots with ratios to the nominal one."""
    return [_varied(rows, row) if row.variation else row for row in rows]


def _varied(rows: list[ControllerRow], row: ControllerRow) -> VariedRow:
    kept = ("plant", "policy", "task", "step_width", "feedback")
    nominal = one(rows, **{name: getattr(row, name) for name in kept}, variation={})
    ratios: dict[str, Any] = {}
    for name in ("e_max", "e_rms"):
        value, base = getattr(row, name), getattr(nominal, name, None)
        ratios[f"{name}_ratio"] = None if value is None or not base else value / base
    return VariedRow(**{f.name: getattr(row, f.name) for f in fields(ControllerRow)}, **ratios)
