"""Ids of the environments of the thesis' arm and rig; importing this is cheap."""

from softrobot_env.registration import register_environments, register_tracking

#: Environment id -> name of its task: of the planar arm,
ENVIRONMENTS = {
    "SoftRobot/ArmStep-v0": "step",
    "SoftRobot/ArmSwing-v0": "swing",
    "SoftRobot/ArmLShape-v0": "lshape",
    "SoftRobot/ArmCircle-v0": "circle",
    "SoftRobot/ArmFigureEight-v0": "figure_eight",
    "SoftRobot/ArmRandom-v0": "random",
}

#: of the spatial test rig,
RIG_ENVIRONMENTS = {
    "SoftRobot/RigTriangle-v0": "triangle",
    "SoftRobot/RigCircle-v0": "rig_circle",
    "SoftRobot/RigReach-v0": "reach",
}

#: and of the rig over a serial line, with the task it has unless another is given.
REAL_ENVIRONMENTS = {"SoftRobot/RealRig-v0": "triangle"}


def register() -> None:
    """Register the ids."""
    register_tracking(ENVIRONMENTS)
    register_environments(
        RIG_ENVIRONMENTS,
        entry_point="softrobot_env.thesis.envs:RigEnv",
        vector_entry_point="softrobot_env.thesis.envs:VectorRigEnv",
    )
    register_environments(
        REAL_ENVIRONMENTS, entry_point="softrobot_env.envs.real:RealRigEnv", nondeterministic=True
    )
