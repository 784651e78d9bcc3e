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


#: The thesis' name of a controller by that of our policy.
CONTROLLERS = {"qs_nn": "quasi-static", "lqi": "LQI", "mpc": "MPC"}

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

#: What sec. 6.6.3 says of the swing with a factor [1] on Young's modulus of the plant.
ROBUSTNESS = {
    "quasi-static": {0.5: "lost", 0.75: "lost", 1.25: "as nominal", 1.5: "as nominal"},
    "LQI": {0.5: "robust", 0.75: "robust", 1.25: "robust", 1.5: "robust"},
    "MPC": {0.5: "fails", 0.75: "z too small", 1.25: "z too large", 1.5: "z too large"},
}

#: Step width [m] and controller -> ranges of rise and settling time [s] and of the overshoot, and
#: of the steady-state error where it was told, by an independent recomputation with corrected
#: equations (audit).
_AUDIT_STEPS = {
    (0.05, "quasi-static"): ((0.24, 0.24), (5.6, 12.0), (0.61, 0.69), (0.001, 0.016)),
    (0.05, "LQI"): ((0.080, 0.096), (0.69, 0.76), (0.31, 0.35), (1e-4, 1e-4)),
    (0.05, "MPC"): ((0.09, 0.09), (0.85, 0.85), (0.28, 0.28), (1e-4, 1e-4)),
    (0.1, "quasi-static"): ((0.24, 0.24), (5.2, 14.0), (0.59, 0.67)),
    (0.1, "LQI"): ((0.081, 0.081), (0.68, 0.68), (0.30, 0.30)),
    (0.1, "MPC"): ((0.09, 0.09), (1.02, 1.02), (0.29, 0.29)),
    (0.2, "quasi-static"): ((0.24, 0.24), (5.0, 20.0), (0.52, 0.63)),
    (0.2, "LQI"): ((0.082, 0.082), (0.65, 0.65), (0.27, 0.27)),
    (0.2, "MPC"): ((0.09, 0.09), (1.01, 1.01), (0.29, 0.29)),
}
_STEP_METRICS = ("rise_time", "settling_time", "overshoot", "steady_state_error")

#: Smallest and largest figure of the audit, by task, step width [m] and controller; names and units
#: are those of `ThesisFigure`. A steady-state error of 1e-4 is an upper bound.
AUDIT: dict[tuple[str, float | None, str], dict[str, tuple[float, float]]] = {
    **{
        ("step", *case): dict(zip(_STEP_METRICS, ranges, strict=False))
        for case, ranges in _AUDIT_STEPS.items()
    },
    ("swing", None, "quasi-static"): {"e_max": (14e-3, 18e-3), "e_motion": (5e-3, 5e-3)},
    ("swing", None, "LQI"): {"e_max": (5.9e-3, 6.7e-3), "e_motion": (0.3e-3, 0.4e-3)},
    ("swing", None, "MPC"): {"e_max": (12.8e-3, 12.8e-3), "e_motion": (8.9e-3, 8.9e-3)},
    ("lshape", None, "quasi-static"): {"e_max": (22e-3, 28e-3)},
    ("lshape", None, "LQI"): {"e_max": (1.9e-3, 2.1e-3)},
    ("lshape", None, "MPC"): {"e_max": (2.6e-3, 2.6e-3)},
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
