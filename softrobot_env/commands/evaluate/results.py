"""What `softrobot evaluate` makes of its episodes: rows, records and plots."""

from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from softrobot_env.evaluation.labels import (
    learnt_label,
    option_columns,
    rig_label,
    robot_label,
    task_label,
)
from softrobot_env.evaluation.metrics import approached_metrics
from softrobot_env.evaluation.rows import EvaluatedRow
from softrobot_env.evaluation.runner import Outcome


@dataclass(frozen=True)
class Result:
    """An episode and its row of the report."""

    outcome: Outcome

    @cached_property
    def row(self) -> EvaluatedRow:
        """What the report says of it."""
        case, rollout = self.outcome.case, self.outcome.rollout
        known = case.identified
        return self.outcome.row(
            EvaluatedRow,
            options=option_columns(dict(case.task.options)),
            twin=case.twin,
            feedback=case.feedback,
            learnt=None if known is None else learnt_label(known.twin),
            **asdict(approached_metrics(rollout, case.task.trajectory)),
        )

    @cached_property
    def columns(self) -> dict[str, Any]:
        """The row as report.json has it."""
        return self.row.columns()

    @property
    def group(self) -> str:
        """Task, and rig, of the episodes that one plot compares."""
        return ", ".join(filter(None, (task_label(self.columns), rig_label(self.columns))))


def save_rollouts(results: list[Result], out: Path) -> None:
    """Write a record of every episode."""
    for result in results:
        result.outcome.rollout.save(out / f"{_file_stem(result)}.npz")


def plot(results: list[Result], out: Path) -> None:
    """Compare policies on each task, and variations of each policy where there are several."""
    from softrobot_env.rendering.curves import policy_curves, varied_curves
    from softrobot_env.rendering.plots import plot_task

    for group in dict.fromkeys(result.group for result in results):
        same = [result for result in results if result.group == group]
        task, stem = same[0].outcome.case.task, _in_file_name(group)
        nominal = {r.row.policy: r.outcome.rollout for r in same if not r.row.variation}
        if nominal:
            plot_task(policy_curves(nominal), task, group, out, stem)
        for policy in dict.fromkeys(r.row.policy for r in same):
            mine = [r for r in same if r.row.policy == policy]
            varied = {robot_label(r.columns) or "nominal": r.outcome.rollout for r in mine}
            if len(varied) > 1:
                title = f"{group}, {policy}"
                plot_task(varied_curves(varied), task, title, out, f"{stem}_{policy}_varied")


def _file_stem(result: Result) -> str:
    parts = [result.group, result.row.policy]
    parts += [f"{name}_{scale:g}" for name, scale in result.row.variation.items()]
    return _in_file_name("_".join(parts))


def _in_file_name(label: str) -> str:
    return label.replace(",", "").replace(" ", "_").replace("/", "_")
