"""The thesis' arm and test rig, with what exists for them alone, as a plug-in of the package.

It registers by the entry points of pyproject.toml as any other package would; nothing else imports
it, and without this folder the rest works.
"""

from softrobot_env.core.registry import serve_names


def register() -> None:
    """Register robots, tasks, policies and trainings."""
    serve()
    from softrobot_env.robots import register_entry
    from softrobot_env.tasks import register_task

    from . import policies, robots, tasks

    for entry in robots.ENTRIES:
        register_entry(entry)
    for robot, own in ((robots.ARM, tasks.ALL_TASKS), (robots.RIG, tasks.RIG_TASKS)):
        for name, maker in own.items():
            register_task(name, maker, robot)
    policies.register()


def serve() -> None:
    """Let modules of the package give the names that they had before."""
    thesis = "softrobot_env.thesis"
    robots = "ARM CANTILEVER_STIFF CANTILEVER_WEAK EQUIVALENT EQUIVALENT_RIG RIG WORKSPACE"
    serve_names("softrobot_env.robots", f"{thesis}.robots", robots)
    serve_names("softrobot_env.robots.registry", f"{thesis}.robots", robots)
    tasks = "ALL_TASKS RIG_TASKS STEP_WIDTHS TASKS UNSEEN_TASKS WITH_OPTION equal_input"
    serve_names("softrobot_env.tasks", f"{thesis}.tasks", tasks)
    serve_names("softrobot_env.robots.twin", f"{thesis}.robots", "rig3d_twin twin_or_ideal")
    serve_names("softrobot_env.envs.rig", f"{thesis}.envs", "RigEnv VectorRigEnv")
    serve_names("softrobot_env.control.registry", f"{thesis}.policies", "RIG_POLICIES")
    ids = "ENVIRONMENTS RIG_ENVIRONMENTS REAL_ENVIRONMENTS"
    serve_names("softrobot_env.registration", f"{thesis}.environments", ids)
