"""Episodes of the controller benchmark, and their rows."""

from collections.abc import Iterable

import numpy as np

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.benchmarks.controllers.rows import ControllerRow
from softrobot_env.benchmarks.episodes import record_of
from softrobot_env.evaluation import runner
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.tasks import make_task

#: The thesis' plant by its name in `beams.registry`.
PCC = "pcc"

#: Task and step width [m] of everything that is run.
TASKS = (("step", 0.05), ("step", 0.1), ("step", 0.2), ("swing", None), ("lshape", None))

#: Episodes of these policies on a step last [s] longer than the 5 s of the others: they damp
#: nothing and settle late.
_SLOW, _LONG = ("qs_nn", "feedforward", "feedforward_pi"), 25.0

#: Times [s] between which the error during a motion is taken: without the decay after a kink.
MOTION = {"swing": ((0.5, 10.0),), "lshape": ((1.0, 5.0), (6.0, 10.0))}

_SAMPLE = 0.005  # s, of a trace


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
        trace=outcome.rollout.thinned(_SAMPLE) if case.plant == PCC else None,
    )


def motion_errors(rollout: Rollout, task: str) -> tuple[float | None, float | None]:
    """Smallest and largest error [m] of the tip between the kinks of the reference.

    None for steps, and after a failure.
    """
    if rollout.failure is not None or task not in MOTION:
        return None, None
    error = rollout.error[_between(rollout.time, MOTION[task])]
    return float(error.min()), float(error.max())


def _between(time: np.ndarray, spans: Iterable[tuple[float, float]]) -> np.ndarray:
    return np.any([(time > begin) & (time < end) for begin, end in spans], axis=0)
