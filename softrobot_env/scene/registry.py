"""Scenes by name, as they are exported to assets/, and the scene of any robot."""

from dataclasses import replace

from softrobot_env.core.registry import Registry
from softrobot_env.robots import ENTRIES, RobotParams, entry_of
from softrobot_env.robots.registry import RIG_PIECES

from .config import SceneConfig, TipSensors, visible

__all__ = ["RIG_PIECES", "SCENES", "model_scene", "scene_of"]


class _Scenes(Registry[SceneConfig]):
    """What environments of robots simulate, by the robot's name, and what they draw."""

    def registered(self) -> dict[str, SceneConfig]:
        """See `Registry`."""
        known = {}
        for name, entry in ENTRIES.registered().items():
            if entry.scene:
                given = {"pieces": entry.pieces, "control_period": entry.control_period}
                own = {option: value for option, value in given.items() if value is not None}
                known[name] = replace(model_scene(entry.robot), **own)
                if entry.robot.tendons:
                    known[f"{name}_view"] = visible(known[name])
        return known


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
    """The scene by which tasks and laws know a robot, and environments simulate it: its chain's."""
    return scene_of(entry_of(robot).chain or robot)


#: The scenes by name.
SCENES: Registry[SceneConfig] = _Scenes("scene", {})
