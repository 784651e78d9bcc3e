"""Environment ids. Importing this module is cheap: MuJoCo loads with the first `make`."""

from typing import Any

from gymnasium.envs.registration import register, registry

#: Environment id -> name of its task: of the planar arm,
ENVIRONMENTS = {
    "SoftRobot/ArmStep-v0": "step",
    "SoftRobot/ArmSwing-v0": "swing",
    "SoftRobot/ArmLShape-v0": "lshape",
    "SoftRobot/ArmCircle-v0": "circle",
    "SoftRobot/ArmFigureEight-v0": "figure_eight",
    "SoftRobot/ArmRandom-v0": "random",
}

#: of any robot, told by the arguments `robot` and `task`,
ANY_ROBOT = {"SoftRobot/Track-v0": "circle"}

#: of the spatial test rig,
RIG_ENVIRONMENTS = {
    "SoftRobot/RigTriangle-v0": "triangle",
    "SoftRobot/RigCircle-v0": "rig_circle",
    "SoftRobot/RigReach-v0": "reach",
}

#: of a gripper,
GRIPPER_ENVIRONMENTS = {
    "SoftRobot/GripperEnclose-v0": "enclose",
    "SoftRobot/GripperHold-v0": "hold",
}

#: and of the rig over a serial line, with the task it has unless told otherwise.
REAL_ENVIRONMENTS = {"SoftRobot/RealRig-v0": "triangle"}


def register_envs() -> None:
    """Register every environment with Gymnasium; calling it again changes nothing."""
    _register(
        ENVIRONMENTS | ANY_ROBOT,
        entry_point="softrobot_env.envs.tracking:TrackingEnv",
        vector_entry_point="softrobot_env.envs.vector:VectorTrackingEnv",
    )
    _register(
        RIG_ENVIRONMENTS,
        entry_point="softrobot_env.envs.rig:RigEnv",
        vector_entry_point="softrobot_env.envs.rig:VectorRigEnv",
    )
    _register(
        GRIPPER_ENVIRONMENTS,
        entry_point="softrobot_env.envs.gripper:GripperEnv",
        vector_entry_point="softrobot_env.envs.gripper:VectorGripperEnv",
    )
    _register(
        REAL_ENVIRONMENTS, entry_point="softrobot_env.envs.real:RealRigEnv", nondeterministic=True
    )


def _register(environments: dict[str, str], **how: Any) -> None:
    for env_id, task in environments.items():
        if env_id not in registry:
            # The environments refuse to step or render out of order themselves, and their
            # contract is tested, so a step is spared Gymnasium's two wrappers.
            register(
                id=env_id,
                kwargs={"task": task},
                order_enforce=False,
                disable_env_checker=True,
                **how,
            )
