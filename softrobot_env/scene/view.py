"""The visible version of a scene."""

from dataclasses import replace

from softrobot_env.scene.config import Appearance, Camera, SceneConfig

#: Name of the camera that a visible scene has.
FRONT_CAMERA = "front"

_WIDTH_SHOWN, _HEIGHT_SHOWN = 1.9, 1.36  # of the robot's reach
_ELEVATION = 0.6  # rad, from which a robot that bends in space is seen


def visible(config: SceneConfig, aspect: float = 4 / 3) -> SceneConfig:
    """The same scene with a body to look at and a camera that frames the robot's reach.

    Args:
        config: The scene.
        aspect: Width over height of the pictures to take.
    """
    reach = config.robot.reach
    height = reach * max(_HEIGHT_SHOWN, _WIDTH_SHOWN / aspect)
    elevation = _ELEVATION if config.bending == "spatial" else 0.0
    camera = Camera(FRONT_CAMERA, (0.0, 0.48 * reach), height, elevation)
    return replace(config, appearance=Appearance(), cameras=(camera,))
