"""Environment ids. Importing this module is cheap: MuJoCo loads with the first `make`."""

from gymnasium.envs.registration import register, registry

ENTRY_POINT = "softrobot_env.envs.tracking:TrackingEnv"
VECTOR_ENTRY_POINT = "softrobot_env.envs.vector:VectorTrackingEnv"

#: Environment id -> name of its task in `softrobot_env.tasks`.
ENVIRONMENTS = {
    "SoftRobot/ArmStep-v0": "step",
    "SoftRobot/ArmSwing-v0": "swing",
    "SoftRobot/ArmLShape-v0": "lshape",
    "SoftRobot/ArmCircle-v0": "circle",
    "SoftRobot/ArmFigureEight-v0": "figure_eight",
    "SoftRobot/ArmRandom-v0": "random",
}


def register_envs() -> None:
    """Register every environment with Gymnasium; calling it again changes nothing."""
    for env_id, task in ENVIRONMENTS.items():
        if env_id not in registry:
            # The environments refuse to step or render out of order themselves, and their
            # contract is tested, so a step is spared Gymnasium's two wrappers.
            register(
                id=env_id,
                entry_point=ENTRY_POINT,
                vector_entry_point=VECTOR_ENTRY_POINT,
                kwargs={"task": task},
                order_enforce=False,
                disable_env_checker=True,
            )
