"""The visible version of a scene."""

from dataclasses import replace

from softrobot_env.scene.config import Appearance, Camera, SceneConfig

#: Name of the camera that a visible scene has.
FRONT_CAMERA = "front"

_WIDTH_SHOWN, _HEIGHT_SHOWN = 1.9, 1.36  # of the robot's length


def visible(config: SceneConfig, aspect: float = 4 / 3) -> SceneConfig:
    """The same scene with a body to look at and a camera that frames the robot's reach.

    Args:
        config: The scene.
        aspect: Width over height of the pictures to take.
    """
    length = config.robot.length
    height = length * max(_HEIGHT_SHOWN, _WIDTH_SHOWN / aspect)
    camera = Camera(FRONT_CAMERA, (0.0, 0.48 * length), height)
    return replace(config, appearance=Appearance(), cameras=(camera,))
