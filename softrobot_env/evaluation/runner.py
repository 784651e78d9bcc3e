"""Runs a case as an episode, with its record and row."""

from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, TypeVar

import gymnasium
import numpy as np

from softrobot_env.beams.registry import MUJOCO, BeamPlant
from softrobot_env.control.registry import (
    FEEDBACKS,
    SENSORS,
    find_policy,
    make_policy,
    policy_environment,
    policy_name,
    sensors_delay,
)
from softrobot_env.core.interfaces import Policy
from softrobot_env.core.registry import load
from softrobot_env.robots import RobotParams, entry_of
from softrobot_env.robots.twin import COEFFICIENT, Twin, twin_of, with_real_drive
from softrobot_env.tasks import Task

from .metrics import StepMetrics, TrackingMetrics, step_metrics, tracking_metrics
from .report import own_robot, rig_label, variation_label
from .rollout import Rollout
from .run import run_episode, warm_up


@dataclass(frozen=True, kw_only=True)
class EpisodeRow:
    """Row of an episode in every report; after a failure all metrics of the motion are None.

    Attributes:
        task, policy, robot, plant, source: Names.
        step_width: [m] of a step, None for other tasks.
        variation: Differences from the nominal robot.
        e_mean, e_max, e_rms, e_final: [m], see `TrackingMetrics`.
        rise_time, settling_time, overshoot, steady_state_error: See `StepMetrics`; None if the task
            is not a step.
        policy_time_median, policy_time_p99: [s] per decision.
        realtime_factor: Duration of the motion over that of the whole simulation [1].
        remarks: Share of the decisions with each status other than success.
        failure: What went wrong, or None.
    """

    task: str
    step_width: float | None
    policy: str
    robot: str
    plant: str
    source: str
    variation: dict[str, float]
    e_mean: float | None
    e_max: float | None
    e_rms: float | None
    e_final: float | None
    rise_time: float | None
    settling_time: float | None
    overshoot: float | None
    steady_state_error: float | None
    policy_time_median: float
    policy_time_p99: float
    realtime_factor: float
    remarks: dict[str, float]
    failure: str | None


@dataclass(frozen=True, kw_only=True)
class EvaluatedRow(EpisodeRow):
    """A row of `softrobot evaluate`.

    Attributes:
        options: Columns of the task's options, see `report.option_columns`.
        twin: Seed of the rig's twin; None for other rigs and robots.
        e_mean_tracking, e_max_tracking: [m], see `ApproachedMetrics`.
        feedback: What the policy measured; None if it measures nothing.
        identified: Label of the rig whose identified parameters the policy used, or None.
        known_delay: [s] of actions, for which the policy compensates.
        real_drive: Whether the robot had a typical real drive.
    """

    options: dict[str, float | None]
    twin: int | None
    e_mean_tracking: float | None
    e_max_tracking: float | None
    feedback: str | None
    identified: str | None
    known_delay: float
    real_drive: bool = False

    def columns(self) -> dict[str, Any]:
        """The columns in report.json, including one for each option."""
        flat = {}
        for name, value in vars(self).items():
            flat |= value if name == "options" else {name: value}
        return flat


Row = TypeVar("Row", bound=EpisodeRow)

_SEED = 0  # of every episode


@dataclass(frozen=True)
class Case:
    """One episode to run.

    Attributes:
        task: The task.
        policy: The policy, see `control.registry.find_policy`.
        variation: Differences from the nominal robot, see the reset option `vary`.
        twin: Seed of the rig's twin; None for an ideal rig, and for other robots.
        plant: Name of the plant in reports: one of `beams.registry.PLANTS`, or hardware over a
            serial line.
        feedback: What the policy measures, one of `control.registry.FEEDBACKS`; None if it measures
            all that it requires.
        sensors: File of the sensors' calibration, for feedback from them; by default searched for.
        delay: [s], known delay of actions, for which the policy compensates.
        duration: [s] of the episode, by default the task's own.
        scene: Keyword arguments of the environment in addition to those that the policy needs.
        identified: Identified parameters of a robot, for policies that use them; by default those
            shipped with the package.
        given: Keyword arguments of the policy in addition to those of its name, such as a file.
        real_drive: Whether the simulated robot has a typical real drive, unknown to policies, see
            `robots.twin.with_real_drive`.
    """

    task: Task
    policy: str
    variation: Mapping[str, float] = field(default_factory=dict)
    twin: int | None = None
    plant: str = MUJOCO
    feedback: str | None = None
    sensors: Path | None = None
    delay: float = 0.0
    duration: float | None = None
    scene: Mapping[str, Any] = field(default_factory=dict)
    identified: Any = None
    given: Mapping[str, Any] = field(default_factory=dict)
    real_drive: bool = False

    @property
    def label(self) -> str:
        """Label with task, robot or rig, policy and variation."""
        row = {"variation": self.variation, "known_delay": self.delay}
        varied = variation_label(row | {"real_drive": self.real_drive})
        return ", ".join(filter(None, (self.robot_label, policy_name(self.policy), varied)))

    @property
    def robot_label(self) -> str:
        """Label with task, robot unless it is one of the thesis, and rig."""
        row = {"task": self.task.name, "robot": self.task.robot.name}
        row |= {"plant": self.plant, "twin": self.twin}
        return ", ".join(filter(None, (self.task.label, own_robot(row), rig_label(row))))

    @property
    def reset_options(self) -> dict[str, Any]:
        """Options of the environment's `reset`."""
        vary, robot = dict(self.variation), self.task.robot
        if self.real_drive and robot.drive.kind == "tension" and not robot.has_capstan_friction:
            vary["friction_coefficient"] = vary.get("friction_coefficient", 0.0) + COEFFICIENT
        options = {"vary": vary} if vary else {}
        return options if self.duration is None else options | {"duration": self.duration}

    def environment(self, **drawing: Any) -> gymnasium.Env:
        """The simulation of this case with all observables; `drawing` holds rendering options."""
        options = policy_environment(self.policy, self.task.robot, self.delay)
        options |= dict(self.scene) | drawing
        if self.plant != MUJOCO:
            options = {"plant": BeamPlant(self.plant), "pieces": None} | options
        options = {"observe": "all" if self.feedback != SENSORS else ("all", SENSORS)} | options
        return simulated(self.task, **options | {"twin": self._built})

    @property
    def _built(self) -> Twin | None:
        """The robot as built; None for the nominal one."""
        robot = self.task.robot
        built = as_built(robot, self.scene.get("twin", self.twin))
        if not self.real_drive or robot.drive.kind == "tension":
            return built
        built = twin_of(robot, built)
        return replace(built, robot=with_real_drive(built.robot))

    def make_policy(self, control_period: float) -> Policy:
        """The policy, which decides every `control_period` [s]."""
        known = self.identified if acts_on_identified(self.policy, self.task.robot) else None
        built = self._built
        delay = None if built is None else built.camera_delay
        if self.feedback == SENSORS:
            delay = sensors_delay(self.task.robot if built is None else built.robot)
        spec = find_policy(self.policy, self.task.robot)
        options = spec.delay_options(delay, self.delay) | dict(self.given)
        options |= {} if known is None else {"identified": known}
        how = control_period, self.feedback or FEEDBACKS[0], self.sensors, self.delay
        return make_policy(self.policy, self.task.robot, *how, **options)


def as_built(robot: RobotParams, twin: Twin | int | None) -> Twin | None:
    """The twin of a seed, or the ideal robot without a seed; None for robots without twins."""
    return None if entry_of(robot).twin is None and twin is None else twin_of(robot, twin)


def simulated(task: Task, twin: Twin | int | None = None, **options: Any) -> gymnasium.Env:
    """The environment of a task's robot, as built; `options` are those of its class."""
    built = as_built(task.robot, twin)
    given = {} if built is None else {"twin": built}
    return load(entry_of(task.robot).environment)(task, **given | options)


def acts_on_identified(policy: str, robot: RobotParams) -> bool:
    """Whether a robot's policy uses its identified parameters."""
    return entry_of(robot).identified is not None and find_policy(policy, robot).takes("identified")


@dataclass(frozen=True)
class Outcome:
    """A finished episode.

    Attributes:
        case: The case.
        rollout: The record.
        decision_period: [s] between decisions of the policy.
    """

    case: Case
    rollout: Rollout
    decision_period: float

    def row(self, kind: type[Row] = EpisodeRow, **own: Any) -> Row:
        """The episode as a row of a given kind; `own` holds the fields that this kind adds."""
        case, rollout, tracking, step = self.case, self.rollout, None, None
        width = case.task.step_width
        if rollout.failure is None:
            tracking = tracking_metrics(rollout)
            if width is not None:
                step = step_metrics(rollout.time, rollout.tip, rollout.reference[-1])
        return kind(
            task=case.task.name,
            step_width=width,
            policy=policy_name(case.policy),
            robot=case.task.robot.name,
            plant=case.plant,
            source=rollout.source,
            variation=dict(case.variation),
            **_metrics(TrackingMetrics, tracking),
            **_metrics(StepMetrics, step),
            policy_time_median=float(np.median(rollout.policy_time)),
            policy_time_p99=float(np.percentile(rollout.policy_time, 99)),
            realtime_factor=float(rollout.time[-1] / rollout.wall_time),
            remarks=_shares(rollout.policy_status),
            failure=rollout.failure,
            **own,
        )


def _metrics(kind: type, values: TrackingMetrics | StepMetrics | None) -> dict[str, Any]:
    return {field.name: getattr(values, field.name, None) for field in fields(kind)}


def _shares(status: np.ndarray) -> dict[str, float]:
    """Share of the decisions with each status other than none."""
    reasons, counts = np.unique(status, return_counts=True)
    return {str(r): float(c / len(status)) for r, c in zip(reasons, counts, strict=True) if r}


def run(
    case: Case,
    env: gymnasium.Env | None = None,
    policy: Policy | None = None,
    progress: Callable[[float], None] | None = None,
) -> Outcome:
    """Run an episode, after a step that loads and compiles everything.

    Args:
        case: The episode.
        env: Environment to run it in, which stays open; by default the simulation of the case.
        policy: The policy; by default that of the case.
        progress: Shows the time [s] in the episode occasionally.
    """
    if env is None:
        with closing(case.environment()) as made:
            return run(case, made, policy, progress)
    if policy is None:
        policy = case.make_policy(env.control_period)
    warm_up(env, policy, case.reset_options)
    rollout = run_episode(env, policy, _SEED, case.reset_options, progress)
    return Outcome(case, rollout, getattr(policy, "hold", 1) * env.control_period)
