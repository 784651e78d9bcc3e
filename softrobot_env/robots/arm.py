"""The planar arm of ch. 6.

"T" marks a value printed in the thesis, "I" one inferred from it by recomputation, "S" an
assumption of this package.
"""

from softrobot_env.robots.parameters import RobotParams, Tendon


def _pair(group: int, end: float, radius: float, limit: float) -> tuple[Tendon, Tendon]:
    """Upper (+x) and lower (-x) tendon of a planar pair."""
    return (
        Tendon(f"pair{group + 1}_up", (radius, 0.0), end, group, limit),
        Tendon(f"pair{group + 1}_low", (-radius, 0.0), end, group, limit),
    )


#: Planar arm of ch. 6, Tab. 6.1. The printed radii are diameters (I: with 25 and 50 mm radii
#: 20 N could not move the tip by the 200 mm of the step task). Density of ch. 2 and no gravity
#: (I: buckling upright, rise time). 80 N covers the 55 N of the L-shape's corner (S: the thesis
#: gives no limit for LQI and MPC).
ARM = RobotParams(
    name="arm",
    length=0.5,
    outer_radius=0.025,
    inner_radius=0.0125,
    youngs_modulus=7.32e5,
    density=1070.0,
    damping_time=0.05,
    pieces=6,
    tendons=tuple(
        tendon
        for group, end in enumerate((0.5 / 3, 1.0 / 3, 0.5))
        for tendon in _pair(group, end, radius=0.025, limit=80.0)
    ),
)
