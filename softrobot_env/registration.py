"""Environment ids. Importing this module is cheap: MuJoCo loads with the first `make`."""

from typing import Any

from gymnasium.envs.registration import register, registry

from softrobot_env.core.registry import ENVIRONMENT_GROUP, load_plugins, served

#: Environment id -> name of its task: of any robot, by the arguments `robot` and `task`,
ANY_ROBOT = {"SoftRobot/Track-v0": "circle"}

#: of any robot whose file says what drives the real one,
REAL = {"SoftRobot/Real-v0": "reach"}

#: and of a gripper.
GRIPPER_ENVIRONMENTS = {
    "SoftRobot/GripperEnclose-v0": "enclose",
    "SoftRobot/GripperHold-v0": "hold",
}

__getattr__ = served(__name__)


def register_envs() -> None:
    """Register every environment with Gymnasium; calling it again changes nothing."""
    register_tracking(ANY_ROBOT)
    register_environments(
        REAL, entry_point="softrobot_env.envs.real:RealEnv", nondeterministic=True
    )
    register_environments(
        GRIPPER_ENVIRONMENTS,
        entry_point="softrobot_env.envs.gripper:GripperEnv",
        vector_entry_point="softrobot_env.envs.gripper:VectorGripperEnv",
    )
    load_plugins(ENVIRONMENT_GROUP)


def register_tracking(environments: dict[str, str]) -> None:
    """Register ids of tip tracking, each with the name of its task, whose robot it has."""
    register_environments(
        environments,
        entry_point="softrobot_env.envs.tracking:TrackingEnv",
        vector_entry_point="softrobot_env.envs.vector:VectorTrackingEnv",
    )


def register_environments(environments: dict[str, str], **how: Any) -> None:
    """Register ids with Gymnasium, each with its task; `how` as of Gymnasium's `register`.

    A package calls it from a function that it names in the entry-point group
    `softrobot_env.environments`: then its ids are known as soon as `softrobot_env` is imported.
    """
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
