"""Episodes on generic paths at shares of the first frequency, for studies of all robots."""

from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.benchmarks.episodes import EpisodeRecord, record_of
from softrobot_env.benchmarks.records import Record
from softrobot_env.core.jobs import Progress, run_in_processes
from softrobot_env.core.paths import models_dir
from softrobot_env.evaluation import runner
from softrobot_env.evaluation.labels import variation_label
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.evaluation.runner import Case
from softrobot_env.robots import ARM, EQUIVALENT_RIG, RIG
from softrobot_env.robots.registry import EXAMPLES
from softrobot_env.tasks import Task

#: Names of the robots of the studies. The rig is the twin whose parameters come with the package.
ROBOTS = (ARM.name, RIG.name, EQUIVALENT_RIG.name, *EXAMPLES)
RIG_TWIN = 0

#: The policy that does nothing: to be compared with.
HOLD = "hold"

#: What differs where curvature rates are observed, not measured.
OBSERVER = "observer"

Kind = TypeVar("Kind", bound="LapsRow")


@dataclass(frozen=True, kw_only=True)
class LapsRow(EpisodeRecord):
    """An episode; errors are None after a failure.

    Attributes:
        frequency: Laps per second over the frequency of the robot's first mode [1].
        radius: [m] of the path.
        feedback: What the policy measured.
        what: What differs from the nominal robot and its chain, for people; "" if nothing.
        lap_mean, lap_max: [m], error at full rate, after the ramp; all other errors include it.
        share_mean, share_max: The same over the length of the robot [1].
    """

    frequency: float
    radius: float
    feedback: str
    what: str
    lap_mean: float | None
    lap_max: float | None
    share_mean: float | None
    share_max: float | None

    @property
    def limited(self) -> float:
        """Share of the decisions that could not be the ones wanted [1]."""
        return sum(self.remarks.values())


@dataclass(frozen=True)
class RefusedRow(Record):
    """A policy, or a plant, that cannot serve a robot.

    Attributes:
        robot, policy: Names.
        what: As of `LapsRow`, or which task.
        reason: Why not.
    """

    robot: str
    policy: str
    what: str
    reason: str


def refusal(robot: str, policy: str, what: str, reason: str) -> RefusedRow:
    """A refusal, without the place of this checkout in its reason."""
    return RefusedRow(robot, policy, what, reason.replace(f"{models_dir().parent}/", ""))


def run_laps(case: Case, kind: type[Kind] = LapsRow, **own: Any) -> Kind | RefusedRow:
    """Run an episode of a task at a frequency; `own` are the fields that another kind of row adds.

    Policies and plants that cannot serve the robot are rows too.
    """
    robot, told = case.task.robot, difference(case)
    try:
        outcome = runner.run(case)
    except ValueError as error:
        return refusal(robot.name, case.policy, told, str(error))
    mean, most = _lap_errors(outcome.rollout, case)
    return record_of(
        outcome,
        kind,
        frequency=case.task.option("frequency"),
        radius=case.task.option("radius"),
        feedback=case.feedback or "state",
        what=told,
        lap_mean=mean,
        lap_max=most,
        share_mean=None if mean is None else mean / robot.length,
        share_max=None if most is None else most / robot.length,
        **own,
    )


def run_all(cases: list[Case], progress: Progress | None) -> list[LapsRow | RefusedRow]:
    """Rows of episodes, run in processes."""
    return run_in_processes([(case.label, partial(run_laps, case)) for case in cases], progress)


def laps_case(task: Task, policy: str, **more: Any) -> Case:
    """An episode of a robot as its policies know it, up to the end of the laps at full rate."""
    run = task.trajectory
    own = {"twin": RIG_TWIN} if task.robot == RIG else {}
    return Case(task, policy, **({"duration": run.end_time - run.ramp} | own | more))


def difference(case: Case) -> str:
    """What differs from the nominal robot, its chain and its full state, for people."""
    twin = case.scene.get("twin")
    seed = case.twin if twin is None else twin.seed
    own = twin is None and seed in (None, RIG_TWIN)
    plant = "" if case.plant == MUJOCO else case.plant
    varied = variation_label({"variation": case.variation})
    feedback = OBSERVER if case.feedback == "output" else ""
    return ", ".join(filter(None, (plant, "" if own else f"twin {seed}", varied, feedback)))


def _lap_errors(rollout: Rollout, case: Case) -> tuple[float | None, float | None]:
    """Mean and largest error [m] at full rate."""
    run, time = case.task.trajectory, rollout.time
    error = rollout.error[time >= run.ramp]
    if rollout.failure is not None or not len(error):
        return None, None
    return float(error.mean()), float(error.max())
