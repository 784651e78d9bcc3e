"""Scenes by name, as they are exported to assets/."""

from softrobot_env.robots import ARM, CANTILEVER_STIFF, CANTILEVER_WEAK
from softrobot_env.scene.config import SceneConfig, TipSensors
from softrobot_env.scene.view import visible

_ARM = SceneConfig(ARM, sensors=(TipSensors(),))

#: "arm" is what all arm environments simulate, "arm_view" what they draw.
SCENES: dict[str, SceneConfig] = {
    "arm": _ARM,
    "arm_view": visible(_ARM),
    "cantilever_weak": SceneConfig(CANTILEVER_WEAK, sensors=(TipSensors(),)),
    "cantilever_stiff": SceneConfig(CANTILEVER_STIFF, sensors=(TipSensors(),)),
}
