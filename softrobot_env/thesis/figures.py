"""Figures the thesis reports for its controllers, to print beside ours.

M. Grube, Modeling, Sensing, and Control for Agile Trajectory Tracking of Soft Robots, 2026:
Tabs. 6.2 to 6.5 and the text of secs. 6.6.2 and 6.6.3. The plant there is the PCC model with six
pieces. "<0.01 %" is kept as its bound. Tabs. 5.2 and 5.3 are of the real test rig.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from softrobot_env.evaluation.report import REAL


@dataclass(frozen=True)
class ThesisFigure:
    """One controller on one task; None where the thesis gives no figure. SI units.

    Attributes:
        e_motion: Upper bound of the error [m] away from the kinks of the reference.
    """

    task: str
    controller: str
    step_width: float | None = None
    e_max: float | None = None
    rise_time: float | None = None
    settling_time: float | None = None
    overshoot: float | None = None
    steady_state_error: float | None = None
    e_motion: float | None = None


#: Policy time per step [s], Tab. 6.5.
POLICY_TIME = {"quasi-static": 5.4e-6, "LQI": 11.2e-6, "MPC": 49.7e-3}


#: Step width [m] and controller -> rise and settling time [s], overshoot and steady-state error.
_STEPS = {
    (0.05, "quasi-static"): (0.2373, 7.65, 0.4746, 0.0485),
    (0.05, "LQI"): (0.0902, 0.88, 0.4636, 1e-4),
    (0.05, "MPC"): (0.0862, 0.49, 0.3149, 1e-4),
    (0.1, "quasi-static"): (0.2192, 9.81, 0.5021, 0.0512),
    (0.1, "LQI"): (0.0860, 1.83, 0.4541, 1e-4),
    (0.1, "MPC"): (0.0859, 1.49, 0.2724, 1e-4),
    (0.2, "quasi-static"): (0.2489, 14.10, 0.5371, 0.0210),
    (0.2, "LQI"): (0.0786, 1.61, 0.5484, 1e-4),
    (0.2, "MPC"): (0.0666, 1.37, 0.2051, 1e-4),
}

FIGURES = (
    *(ThesisFigure("step", name, width, None, *found) for (width, name), found in _STEPS.items()),
    ThesisFigure("swing", "quasi-static", e_max=27.3e-3),
    ThesisFigure("swing", "LQI", e_max=6.13e-3, e_motion=1e-3),
    ThesisFigure("swing", "MPC", e_max=11.77e-3),
    ThesisFigure("lshape", "quasi-static", e_max=21.57e-3),
    ThesisFigure("lshape", "LQI", e_max=1.71e-3, e_motion=0.2e-3),
    ThesisFigure("lshape", "MPC", e_max=3.11e-3),
)

#: Policy and period [s] of a lap of the triangle -> mean and largest error [m] after the approach,
#: Tabs. 5.2 and 5.3.
TRIANGLE = {
    ("rig_nn", 5.0): (4.5e-3, 13.0e-3),
    ("inverse_dynamics", 5.0): (12.5e-3, 42.3e-3),
    ("hybrid", 5.0): (2.9e-3, 8.9e-3),
    ("rig_nn", 1.0): (35.9e-3, 90.3e-3),
    ("inverse_dynamics", 1.0): (19.7e-3, 49.5e-3),
    ("hybrid", 1.0): (8.6e-3, 18.4e-3),
}


def thesis_rows(row: Mapping[str, Any]) -> list[dict[str, Any]]:
    """What the thesis reports of the task that a row is about."""
    same = [f for f in FIGURES if (f.task, f.step_width) == (row["task"], row["step_width"])]
    return [*map(_arm_row, same), *_rig_rows(row)]


def _arm_row(figure: ThesisFigure) -> dict[str, Any]:
    return {
        **asdict(figure),
        "robot": "arm",
        "policy": f"{figure.controller} (thesis, PCC plant)",
        "policy_time_median": POLICY_TIME[figure.controller],
        "variation": {},
        "failure": None,
    }


def _rig_rows(row: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [
        {
            "task": row["task"],
            "robot": "rig",
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
