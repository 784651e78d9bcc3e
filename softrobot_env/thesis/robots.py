"""The thesis' robots: planar arm, spatial test rig and cantilevers.

"T" marks a value printed in the thesis, "I" one inferred from it by recomputation, "S" an
assumption of this package.
"""

from dataclasses import replace as with_fields
from math import cos, pi, sin

from softrobot_env.robots.parameters import Drive, Head, RobotParams, Tendon
from softrobot_env.robots.registry import LENGTH_SCALE, RIG_PIECES, SERVO_SPEED, RobotEntry
from softrobot_env.robots.sensors import Sensor
from softrobot_env.robots.twin import Twin, sampled_twin, twin_of

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
CANTILEVER_STIFF = with_fields(
    CANTILEVER_WEAK, name="cantilever_stiff", length=0.2, outer_radius=0.040
)


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

#: Spatial test rig of ch. 3 and 5, upright under gravity. EI, damping and the masses are printed
#: (Tab. 5.1; audit: damping in N s, inertia in 1e-6 kg m2): 40 g of silicone per 60 mm with the
#: inertia of a cylinder of 14 mm radius, and 55 g more at 198 mm, the cube with the markers (I: the
#: third subpiece is both together). Of tendon radius and stiffness only c r_t^2 follows from the
#: results (I: split by the 20 mm of travel). Pretension and limit (S). The spatial curvature sensor
#: is in the two lower thirds (T).
_RIG_RADIUS, _RIG_SHARE = 0.014, 0.04 / 0.06
_RIG_EI, _RIG_DAMPING = 18.3e-3, 3.77e-3
_RIG_TENDON_RADIUS = 5.5e-3
RIG = RobotParams(
    name="rig",
    length=0.180,
    outer_radius=_RIG_RADIUS,
    inner_radius=0.0,
    youngs_modulus=_RIG_EI / (pi / 4 * _RIG_RADIUS**4),
    density=_RIG_SHARE / (pi * _RIG_RADIUS**2),
    damping_time=_RIG_DAMPING * 0.180 / _RIG_EI,
    pieces=1,
    tendons=tuple(
        Tendon(
            f"tendon{k + 1}",
            (_RIG_TENDON_RADIUS * cos(2 * pi * k / 3), _RIG_TENDON_RADIUS * sin(2 * pi * k / 3)),
            end=0.180,
            group=0,
            tension_limit=40.0,
            stiffness=980.0,
            pretension=0.5,
        )
        for k in range(3)
    ),
    gravity=(0.0, 0.0, -9.81),
    head=Head(mass=0.055, centre=0.018, inertia=(6.2e-6, 6.2e-6, 6.2e-6), output=0.022),
    drive=Drive("length", SERVO_SPEED, LENGTH_SCALE),
    sensors=(Sensor("spatial", "spatial", 0.0, 0.120),),
)

#: Young's modulus of a beam over that of the one-piece model of the same rig [1], see
#: `robots.twin`.
EQUIVALENT = 1.2

#: A rig that, as a beam, stands and calms down as the one-piece model of `RIG` does.
EQUIVALENT_RIG = with_fields(
    RIG, name="rig_equivalent", youngs_modulus=EQUIVALENT * RIG.youngs_modulus
)

#: Radius [m] of the rig's usable workspace (audit).
WORKSPACE = 0.121

#: What the package knows of them.
ENTRIES = (
    RobotEntry(
        ARM,
        default=True,
        scene=True,
        plain_files=True,
        named_by_tasks=True,
        task="swing",
        tasks=("step", "swing", "lshape"),
        policies=(
            *("hold", "feedforward", "feedforward_pi", "static", "chain_dynamics"),
            *("chain_dynamics_pi", "qs_nn", "lqi", "lq_preview", "lq_adaptive", "mpc"),
            *("mpc_preview", "imitation", "ppo", "sac", "ppo_randomized", "sac_randomized"),
        ),
        policy="feedforward_pi",
        teacher="mpc_preview",
        training="softrobot_env.thesis.arm.training:ArmTraining",
        reported="softrobot_env.thesis.figures:thesis_rows",
    ),
    RobotEntry(CANTILEVER_WEAK, scene=True),
    RobotEntry(CANTILEVER_STIFF, scene=True),
    RobotEntry(
        RIG,
        on_a_line=True,
        scene=True,
        chain=EQUIVALENT_RIG,
        stiffer=EQUIVALENT,
        pieces=RIG_PIECES,
        control_period=0.02,
        axes="xy",
        environment="softrobot_env.thesis.envs:RigEnv",
        twin=0,
        plain_files=True,
        named_by_tasks=True,
        tasks=("triangle", "rig_circle", "reach"),
        policies=(
            *("rig_nn", "rig_nn_p", "rig_nn_pi", "inverse_dynamics", "inverse_dynamics_ahead"),
            *("hybrid", "hybrid_ahead", "hybrid_flexible", "hybrid_calibrated"),
            *("hybrid_feedback", "ssm_mpc", "ssm_lq"),
        ),
        policy="hybrid",
        identified="softrobot_env.thesis.rig.parameters:read_identified",
        reported="softrobot_env.thesis.figures:thesis_rows",
    ),
    RobotEntry(EQUIVALENT_RIG),
)


def rig3d_twin(seed: int) -> Twin:
    """A rig with errors of manufacturing, of its servos and its camera, sampled from a seed.

    Raises:
        ValueError: The seed is no whole number of zero or more.
    """
    return sampled_twin(RIG, seed)


def twin_or_ideal(seed: int | None) -> Twin:
    """The twin of a seed; without one the ideal rig, which the one-piece model describes."""
    return twin_of(RIG, seed)
