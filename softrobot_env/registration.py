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

RIG_ENTRY_POINT = "softrobot_env.envs.rig:RigEnv"

#: Environment id -> name of its task in `softrobot_env.tasks.rig`.
RIG_ENVIRONMENTS = {
    "SoftRobot/RigTriangle-v0": "triangle",
    "SoftRobot/RigCircle-v0": "rig_circle",
    "SoftRobot/RigReach-v0": "reach",
}

REAL_ENTRY_POINT = "softrobot_env.envs.real:RealRigEnv"

#: The rig over a serial line, with the task it has unless told otherwise.
REAL_ENVIRONMENTS = {"SoftRobot/RealRig-v0": "triangle"}


def register_envs() -> None:
    """Register every environment with Gymnasium; calling it again changes nothing."""
    for env_id, task in ENVIRONMENTS.items():
        _register(env_id, ENTRY_POINT, VECTOR_ENTRY_POINT, task)
    for env_id, task in RIG_ENVIRONMENTS.items():
        _register(env_id, RIG_ENTRY_POINT, None, task)
    for env_id, task in REAL_ENVIRONMENTS.items():
        _register(env_id, REAL_ENTRY_POINT, None, task)


def _register(env_id: str, entry_point: str, vector_entry_point: str | None, task: str) -> None:
    if env_id not in registry:
        # The environments refuse to step or render out of order themselves, and their
        # contract is tested, so a step is spared Gymnasium's two wrappers.
        register(
            id=env_id,
            entry_point=entry_point,
            vector_entry_point=vector_entry_point,
            kwargs={"task": task},
            order_enforce=False,
            disable_env_checker=True,
        )
