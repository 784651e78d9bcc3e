"""The thesis' figures as rows, to stand below ours."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from softrobot_env.evaluation.labels import REAL
from softrobot_env.evaluation.thesis import FIGURES, POLICY_TIME, TRIANGLE, ThesisFigure


def thesis_rows(row: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What the thesis reports of the task that a row is about."""
    same = [f for f in FIGURES if (f.task, f.step_width) == (row["task"], row["step_width"])]
    return [*map(_arm_row, same), *_rig_rows(row)]


def _arm_row(figure: ThesisFigure) -> dict[str, Any]:
    return {
        **asdict(figure),
        "policy": f"{figure.controller} (thesis, PCC plant)",
        "policy_time_median": POLICY_TIME[figure.controller],
        "variation": {},
        "failure": None,
    }


def _rig_rows(row: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [
        {
            "task": row["task"],
            "policy": f"{policy} (thesis)",
            "plant": REAL,
            "variation": {},
            "failure": None,
            "e_mean_tracking": mean,
            "e_max_tracking": largest,
        }
        for (policy, period), (mean, largest) in TRIANGLE.items()
        if (row["task"], row.get("period")) == ("triangle", period)
    ]
