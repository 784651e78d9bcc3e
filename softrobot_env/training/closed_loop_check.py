"""Closed-loop figures of a network on the three tasks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from softrobot_env.control.learned import neural
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.metrics import (
    StepMetrics,
    TrackingMetrics,
    step_metrics,
    tracking_metrics,
)
from softrobot_env.evaluation.runner import Case, Outcome, run
from softrobot_env.learned.network import Network
from softrobot_env.robots import RobotParams, default_robot
from softrobot_env.training.references import training_of, view_for


@dataclass(frozen=True)
class CheckRow(TrackingMetrics):
    """An episode of a check, with errors up to a failure.

    Attributes:
        reward: Mean over the steps.
        failure: What went wrong, or None.
        step: Of a step, None for other tasks.
    """

    reward: float
    failure: str | None
    step: StepMetrics | None


#: By the label of the episode, for instance "step 50 mm, youngs_modulus 0.5".
Rows = dict[str, CheckRow]


def check(
    network: Network,
    variations: Sequence[dict[str, float]] = ({},),
    duration: float | None = None,
    reward: TrackingReward | None = None,
    robot: RobotParams | None = None,
    view: neural.View | None = None,
) -> Rows:
    """Figures of a network, one episode for each task and variation.

    Args:
        network: To run.
        variations: Robots and disturbances, as in the option `vary` of `reset`.
        duration: [s] of the episodes, the tasks' own unless given.
        reward: Whose mean is told; the environments' default unless given.
        robot: The robot; the default one unless given.
        view: Of the network; the robot's unless given.
    """
    robot = robot or default_robot()
    view, rows = view_for(robot) if view is None else view, {}
    policy = neural.NeuralPolicy(robot, view.period, network, view=view)
    for task in training_of(robot).check_tasks():
        env = TrackingEnv(task, observe=policy.requires, reward=reward, **view.environment)
        for vary in variations:
            case = Case(task, "network", variation=vary, duration=duration)
            label = ", ".join([task.label, *(f"{n} {value:g}" for n, value in vary.items())])
            rows[label] = _row(run(case, env, policy))
    return rows


def _row(outcome: Outcome) -> CheckRow:
    rollout, step = outcome.rollout, None
    if outcome.case.task.step_width is not None:
        step = step_metrics(rollout.time, rollout.tip, rollout.reference[-1])
    errors, reward = tracking_metrics(rollout), float(np.mean(rollout.reward[1:]))
    return CheckRow(**vars(errors), reward=reward, failure=rollout.failure, step=step)
