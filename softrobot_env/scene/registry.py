"""Scenes by name, as they are exported to assets/, and the scene of any robot."""

from softrobot_env.core.registry import Registry
from softrobot_env.robots import (
    ARM,
    CANTILEVER_STIFF,
    CANTILEVER_WEAK,
    EQUIVALENT_RIG,
    RIG,
    RobotParams,
)
from softrobot_env.scene.config import SceneConfig, TipSensors, visible

#: Pieces the rig is cut into: its first frequency is then within 1 % of the beam's.
RIG_PIECES = 4

_ARM = SceneConfig(ARM, sensors=(TipSensors(),))
_RIG = SceneConfig(
    EQUIVALENT_RIG,
    pieces=RIG_PIECES,
    actuation="length",
    control_period=0.02,
    sensors=(TipSensors(),),
    bending="spatial",
)

#: "arm" is what all arm environments simulate, "arm_view" what they draw; likewise "rig"
#: without a twin.
SCENES = Registry(
    "scene",
    {
        "arm": _ARM,
        "arm_view": visible(_ARM),
        "rig": _RIG,
        "rig_view": visible(_RIG),
        "cantilever_weak": SceneConfig(CANTILEVER_WEAK, sensors=(TipSensors(),)),
        "cantilever_stiff": SceneConfig(CANTILEVER_STIFF, sensors=(TipSensors(),)),
    },
)


def scene_of(robot: RobotParams) -> SceneConfig:
    """The scene of a robot with its own drives; planar where nothing leaves the x-z plane.

    It twists where a tendon winds round the fibre.
    """
    return SceneConfig(
        robot,
        actuation=robot.drive.kind,
        sensors=(TipSensors(),),
        bending="planar" if robot.is_planar else "spatial",
        torsion=robot.twists,
    )


def model_scene(robot: RobotParams) -> SceneConfig:
    """The scene by which tasks and laws know a robot: its own.

    The rig's parameters are those of one piece of constant curvature; in several pieces,
    `EQUIVALENT_RIG` stands as that does, and it is what rig environments simulate.
    """
    return scene_of(EQUIVALENT_RIG if robot == RIG else robot)
