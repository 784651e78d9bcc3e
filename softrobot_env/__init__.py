"""MuJoCo environments for tendon-driven soft robots (see README.md)."""

from softrobot_env.core import __version__ as __version__
from softrobot_env.core.files import give_caches_a_place
from softrobot_env.core.processes import prepare_the_command_line

prepare_the_command_line()
give_caches_a_place()

from typing import Any  # noqa: E402

from softrobot_env.core.registry import load  # noqa: E402
from softrobot_env.registration import register_envs  # noqa: E402  (loads NumPy)

register_envs()

#: What adds robots, tasks, policies and so on of one's own, loaded when it is asked for.
_REGISTER = {
    "register_robot": "softrobot_env.robots.registry:register_robot",
    "register_task": "softrobot_env.tasks.registry:register_task",
    "register_policy": "softrobot_env.control.registry:register_policy",
    "register_observable": "softrobot_env.envs.observations.table:register_observable",
    "register_reward": "softrobot_env.envs.rewards:register_reward",
    "register_study": "softrobot_env.core.studies:register_study",
    "register_variation": "softrobot_env.robots.variations:register_variation",
}


def __getattr__(name: str) -> Any:
    if name not in _REGISTER:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return load(_REGISTER[name])
