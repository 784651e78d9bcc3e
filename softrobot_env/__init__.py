"""MuJoCo environments for tendon-driven soft robots (see README.md)."""

from softrobot_env.processes import one_thread_on_the_command_line

one_thread_on_the_command_line()

from softrobot_env.registration import register_envs  # noqa: E402  (loads NumPy)

__version__ = "0.1.0"

register_envs()
