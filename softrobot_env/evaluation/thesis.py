"""Figures the thesis reports for its controllers, to print beside ours.

M. Grube, Modeling, Sensing, and Control for Agile Trajectory Tracking of Soft Robots, 2026:
Tabs. 6.2 to 6.5 and the text of sec. 6.6.2. The plant there is the PCC model with six pieces.
"<0.01 %" is kept as its bound.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class ThesisFigure:
    """One controller on one task; None where the thesis gives no figure. SI units."""

    task: str
    controller: str
    step_width: float | None = None
    e_max: float | None = None
    rise_time: float | None = None
    settling_time: float | None = None
    overshoot: float | None = None
    steady_state_error: float | None = None


#: Policy time per step [s], Tab. 6.5.
POLICY_TIME = {"quasi-static": 5.4e-6, "LQI": 11.2e-6, "MPC": 49.7e-3}


def _steps(
    width: float, rows: dict[str, tuple[float, float, float, float]]
) -> tuple[ThesisFigure, ...]:
    return tuple(
        ThesisFigure("step", name, width, None, rise, settling, overshoot, steady)
        for name, (rise, settling, overshoot, steady) in rows.items()
    )


FIGURES = (
    *_steps(
        0.05,
        {
            "quasi-static": (0.2373, 7.65, 0.4746, 0.0485),
            "LQI": (0.0902, 0.88, 0.4636, 1e-4),
            "MPC": (0.0862, 0.49, 0.3149, 1e-4),
        },
    ),
    *_steps(
        0.1,
        {
            "quasi-static": (0.2192, 9.81, 0.5021, 0.0512),
            "LQI": (0.0860, 1.83, 0.4541, 1e-4),
            "MPC": (0.0859, 1.49, 0.2724, 1e-4),
        },
    ),
    *_steps(
        0.2,
        {
            "quasi-static": (0.2489, 14.10, 0.5371, 0.0210),
            "LQI": (0.0786, 1.61, 0.5484, 1e-4),
            "MPC": (0.0666, 1.37, 0.2051, 1e-4),
        },
    ),
    ThesisFigure("swing", "quasi-static", e_max=27.3e-3),
    ThesisFigure("swing", "LQI", e_max=6.13e-3),
    ThesisFigure("swing", "MPC", e_max=11.77e-3),
    ThesisFigure("lshape", "quasi-static", e_max=21.57e-3),
    ThesisFigure("lshape", "LQI", e_max=1.71e-3),
    ThesisFigure("lshape", "MPC", e_max=3.11e-3),
)
