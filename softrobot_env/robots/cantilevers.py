"""The cantilevers of ch. 2.

"T" marks a value printed in the thesis, "I" one inferred from it by recomputation, "S" an
assumption of this package.
"""

from dataclasses import replace

from softrobot_env.robots.parameters import RobotParams

#: Cantilevers of Tab. 2.1 (T), horizontal under gravity; damping of the spiral runs (T). Poisson
#: ratio 0 as in every model comparison (I). The thesis varies the number of pieces (S: 6).
CANTILEVER_WEAK = RobotParams(
    name="cantilever_weak",
    length=0.5,
    outer_radius=0.030,
    inner_radius=0.0,
    youngs_modulus=4.12e5,
    density=1070.0,
    damping_time=2.5e-3,
    pieces=6,
    gravity=(-9.81, 0.0, 0.0),
)
CANTILEVER_STIFF = replace(CANTILEVER_WEAK, name="cantilever_stiff", length=0.2, outer_radius=0.040)
