"""Environment ids. Importing this module is cheap: nothing heavy loads before `make`."""

ENTRY_POINT = "softrobot_env.envs.tracking:TrackingEnv"

#: Environment id -> name of its task in `softrobot_env.tasks`.
ENVIRONMENTS = {
    "SoftRobot/ArmStep-v0": "step",
    "SoftRobot/ArmSwing-v0": "swing",
    "SoftRobot/ArmLShape-v0": "lshape",
}


def register_envs() -> None:
    """Register every environment with Gymnasium; calling it again changes nothing."""
    # Gymnasium may itself be importing this module (it is a `gymnasium.envs` plugin),
    # so its registry is looked up only here.
    from gymnasium.envs.registration import register, registry

    for env_id, task in ENVIRONMENTS.items():
        if env_id not in registry:
            # The environments refuse to step or render out of order themselves, and their
            # contract is tested, so a step is spared Gymnasium's two wrappers.
            register(
                id=env_id,
                entry_point=ENTRY_POINT,
                kwargs={"task": task},
                order_enforce=False,
                disable_env_checker=True,
            )
