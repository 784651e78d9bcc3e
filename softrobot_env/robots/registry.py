"""The named robots: arm, rig and cantilevers of the thesis, and examples that are files.

"T" marks a value printed in the thesis, "I" one inferred from it by recomputation, "S" an
assumption of this package.
"""

from collections.abc import Callable
from dataclasses import replace as with_fields
from math import cos, pi, sin
from pathlib import Path
from typing import Any

from softrobot_env.core.paths import assets_dir
from softrobot_env.core.registry import Registry
from softrobot_env.robots.file import read_gripper, read_robot
from softrobot_env.robots.gripper import Gripper
from softrobot_env.robots.parameters import Drive, Head, RobotParams, Tendon
from softrobot_env.robots.sensors import Sensor

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

#: [m], pulled in by a full-scale action.
LENGTH_SCALE = 0.03

#: Speed [m/s] at which a servo winds: 0.16 s for 60 degrees (CHASERVO DS20) on a horn of 20 mm (S).
SERVO_SPEED = pi / 3 / 0.16 * 0.020

#: [s] between two pictures of the webcam of the rig (T).
CAMERA_PERIOD = 1 / 90

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
            (
                _RIG_TENDON_RADIUS * cos(2 * pi * k / 3),
                _RIG_TENDON_RADIUS * sin(2 * pi * k / 3),
            ),
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

#: Robots of assets/robots/, described by files as a user's own.
EXAMPLES = ("planar_finger", "silicone_rod", "hanging_trunk", "ftdcr_v4")

#: The finger of the gripper, a file as well.
FINGER = read_robot(assets_dir() / "robots" / "gripper_finger.toml")

#: The named robots.
ROBOTS = Registry(
    "robot",
    {r.name: r for r in (ARM, CANTILEVER_WEAK, CANTILEVER_STIFF, RIG, EQUIVALENT_RIG, FINGER)}
    | {name: read_robot(assets_dir() / "robots" / f"{name}.toml") for name in EXAMPLES},
)


def register_robot(
    robot: RobotParams | str | Path, name: str | None = None, *, replace: bool = False
) -> RobotParams:
    """Add a robot to the named ones; returns it, with its name.

    Args:
        robot: The robot, or a file that describes it.
        name: Its name; the robot's own unless given.
        replace: Whether it may take the place of another of this name.

    Raises:
        ValueError: The name is taken, or the file says what is not allowed.
        TypeError: Neither a robot nor a path.
        OSError: The file cannot be read.
    """
    if isinstance(robot, str | Path):
        robot = read_robot(robot)
    if not isinstance(robot, RobotParams):
        raise TypeError(f"a robot is a RobotParams or the path of a robot file, got {robot!r}")
    named = with_fields(robot, name=robot.name if name is None else name)
    ROBOTS.register(named.name, named, replace)
    return named


def find_robot(which: RobotParams | Path | str) -> RobotParams:
    """The robot of a name, or of a file: a path that ends in .toml; a robot is itself.

    Raises:
        ValueError: No such name, the message lists them; or the file says what is not allowed.
        OSError: The file cannot be read.
    """
    return which if isinstance(which, RobotParams) else _read_or_found(which, read_robot, ROBOTS)


def _read_or_found(which: Path | str, read: Callable[[str], Any], known: Registry) -> Any:
    if not isinstance(which, Path | str):
        raise ValueError(f"a {known.kind} is given by its name or its file, got {which!r}")
    is_file = isinstance(which, Path) or which.endswith(".toml")
    return read(str(which)) if is_file else known.find(which)


#: The named grippers, described by files as a user's own.
GRIPPERS = Registry("gripper", {"gripper": read_gripper(assets_dir() / "grippers/gripper.toml")})


def find_gripper(which: Gripper | Path | str) -> Gripper:
    """The gripper of a name, or of a file, or itself; errors as of `find_robot`."""
    return which if isinstance(which, Gripper) else _read_or_found(which, read_gripper, GRIPPERS)
