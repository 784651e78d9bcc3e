"""Episodes of the controller benchmark, and their rows."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np

from softrobot_env.beams.registry import MUJOCO, BeamPlant
from softrobot_env.control.registry import POLICIES, make_policy, policy_environment
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.labels import task_label, variation_label
from softrobot_env.evaluation.report import make_row
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.evaluation.run import run_episode
from softrobot_env.evaluation.thesis import CONTROLLERS
from softrobot_env.robots.actuation import TendonMap

Row = dict[str, Any]
#: Arrays of an episode by name, for the figures.
Trace = dict[str, np.ndarray]

#: The thesis' plant by its name in `beams.registry`.
PCC = "pcc"

#: Task and step width [m] of everything that is run.
TASKS = (("step", 0.05), ("step", 0.1), ("step", 0.2), ("swing", None), ("lshape", None))

#: Episodes of these policies on a step last [s] longer than the 5 s of the others: they damp
#: nothing and settle late.
_SLOW, _LONG = ("qs_nn", "feedforward", "feedforward_pi"), 25.0

#: Times [s] between which the error during a motion is taken: without the decay after a kink.
MOTION = {"swing": ((0.5, 10.0),), "lshape": ((1.0, 5.0), (6.0, 10.0))}

_WARM_UP = 0.3  # s
_SAMPLE = 0.005  # s, of a trace


@dataclass(frozen=True)
class Case:
    """One episode to run.

    Attributes:
        setting: What it belongs to, one of `controllers.SETTINGS`.
        plant: PCC or MUJOCO.
        policy: One of `POLICIES`.
        task: Name of the task.
        step_width: [m] of a step.
        variation: Factors [1] on parameters of the plant.
        feedback: What the policy measures, one of `control.registry.FEEDBACKS`.
    """

    setting: str
    plant: str
    policy: str
    task: str
    step_width: float | None = None
    variation: dict[str, float] = field(default_factory=dict)
    feedback: str = "state"

    @property
    def label(self) -> str:
        """For the progress bar."""
        fields = {"task": self.task, "step_width": self.step_width, "variation": self.variation}
        parts = (self.setting, self.plant, self.policy, task_label(fields), variation_label(fields))
        return ", ".join(filter(None, parts))


def policies() -> list[str]:
    """The thesis' controllers, then all others but the one that does nothing."""
    known = [*(p for p in CONTROLLERS if p in POLICIES), *POLICIES]
    return [policy for policy in dict.fromkeys(known) if policy != "hold"]


def measures_rates(policy: str) -> bool:
    """Whether a policy measures curvature rates, so that output feedback changes it."""
    env = _environment(MUJOCO, policy, "swing")
    return "curvature_rate" in make_policy(policy, env.task.robot, env.control_period).requires


def run_case(case: Case) -> Row:
    """Run an episode; see `controllers.run` for the row."""
    _warm_up(case.plant, case.policy, case.feedback)
    env = _environment(case.plant, case.policy, case.task)
    policy = make_policy(case.policy, env.task.robot, env.control_period, case.feedback)
    options: dict[str, object] = {"vary": case.variation}
    if case.step_width is not None:
        options["step_width"] = case.step_width
        if case.policy in _SLOW:
            options["duration"] = _LONG
    rollout = run_episode(env, policy, seed=0, options=options)
    row = make_row(rollout, env.task, case.policy, case.plant, case.variation)
    row |= {"step_width": case.step_width, "setting": case.setting, "feedback": case.feedback}
    row["decision_period"] = policy.hold * env.control_period
    row |= extra_metrics(rollout, case.task)
    return row | {"trace": _trace(rollout, env)} if case.plant == PCC else row


def _environment(plant: str, policy: str, task: str) -> TrackingEnv:
    model = None if plant == MUJOCO else BeamPlant(plant)
    return TrackingEnv(task, observe="all", plant=model, **policy_environment(policy))


@cache
def _warm_up(plant: str, policy: str, feedback: str) -> None:
    """Load what is compiled, once, so that no policy time contains it."""
    env = _environment(plant, policy, "swing")
    made = make_policy(policy, env.task.robot, env.control_period, feedback)
    run_episode(env, made, seed=0, options={"duration": _WARM_UP})


def extra_metrics(rollout: Rollout, task: str) -> Row:
    """Error during the motion and largest tendon tension; None after a failure.

    Returns:
        e_motion, e_motion_least: [m], largest and smallest error of the tip between the kinks of
            the reference; None for steps.
        tension_max: [N].
    """
    row: Row = dict.fromkeys(("e_motion", "e_motion_least", "tension_max"))
    if rollout.failure is not None:
        return row
    row["tension_max"] = float(rollout.tendon_tension.max())
    if task in MOTION:
        error = rollout.error[_between(rollout.time, MOTION[task])]
        row |= {"e_motion": float(error.max()), "e_motion_least": float(error.min())}
    return row


def _between(time: np.ndarray, spans: Iterable[tuple[float, float]]) -> np.ndarray:
    return np.any([(time > begin) & (time < end) for begin, end in spans], axis=0)


def _trace(rollout: Rollout, env: TrackingEnv) -> Trace:
    """Time [s], reference and tip (T, 3) [m], inputs (T, pairs) [N], last curvatures [1/m]."""
    every = max(1, round(_SAMPLE / env.control_period))
    inputs = TendonMap(env.task.robot).reduced(rollout.tendon_tension)
    series = {"time": rollout.time, "reference": rollout.reference, "tip": rollout.tip}
    series |= {"inputs": inputs, "error": rollout.error}
    trace = {name: values[::every] for name, values in series.items()}
    return trace | {"curvature": rollout.curvature[-1]}
