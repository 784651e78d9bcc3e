"""What `softrobot evaluate` makes of its episodes: rows, records and plots."""

from dataclasses import asdict, dataclass
from pathlib import Path

from softrobot_env.commands.setups.case import Case, Setup
from softrobot_env.evaluation import report
from softrobot_env.evaluation.labels import rig_label, robot_label, task_label
from softrobot_env.evaluation.metrics import ApproachedMetrics, approached_metrics
from softrobot_env.evaluation.rollout import Rollout


@dataclass(frozen=True)
class Outcome:
    """An episode, its record and its row of the report."""

    case: Case
    rollout: Rollout
    row: report.Row

    @property
    def group(self) -> str:
        """Task, and rig, of the episodes that one plot compares."""
        return ", ".join(filter(None, (task_label(self.row), rig_label(self.row))))


def make_outcome(case: Case, rollout: Rollout, setup: Setup) -> Outcome:
    """An outcome with its row."""
    row = report.make_row(rollout, case.task, case.policy, setup.plant, case.variation)
    approached = ApproachedMetrics(None, None)
    if rollout.failure is None:
        approached = approached_metrics(rollout, case.task.trajectory)
    row |= case.columns | asdict(approached)
    row |= {"feedback": setup.feedback, "learnt": setup.learnt_of(case)}
    return Outcome(case, rollout, row)


def save_rollouts(outcomes: list[Outcome], out: Path) -> None:
    """Write a record of every episode."""
    for outcome in outcomes:
        outcome.rollout.save(out / f"{_file_stem(outcome)}.npz")


def plot(outcomes: list[Outcome], out: Path) -> None:
    """Compare policies on each task, and variations of each policy where there are several."""
    for group in dict.fromkeys(outcome.group for outcome in outcomes):
        same = [outcome for outcome in outcomes if outcome.group == group]
        nominal = {o.case.policy: o.rollout for o in same if not o.case.variation}
        if nominal:
            _plot_group(nominal, same[0], out, _in_file_name(group))
        for policy in dict.fromkeys(o.case.policy for o in same):
            varied = {
                robot_label(o.row) or "nominal": o.rollout for o in same if o.case.policy == policy
            }
            if len(varied) > 1:
                _plot_group(varied, same[0], out, f"{_in_file_name(group)}_{policy}_varied")


def _plot_group(rollouts: dict[str, Rollout], one: Outcome, out: Path, stem: str) -> None:
    """Write the pictures that the robot of these episodes has."""
    from softrobot_env.rendering.plots import plot_task
    from softrobot_env.rendering.rig_plots import plot_rig_task

    if one.case.task.axes == "xy":
        plot_rig_task(rollouts, one.case.task, one.group, out, stem)
    else:
        plot_task(rollouts, one.case.task, out, stem)


def _file_stem(outcome: Outcome) -> str:
    parts = [outcome.group, outcome.case.policy]
    parts += [f"{name}_{scale:g}" for name, scale in outcome.case.variation.items()]
    return _in_file_name("_".join(parts))


def _in_file_name(label: str) -> str:
    return label.replace(",", "").replace(" ", "_").replace("/", "_")
