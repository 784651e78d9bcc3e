"""MuJoCo environments for tendon-driven soft robots (see README.md)."""

from softrobot_env.registration import register_envs

__version__ = "0.1.0"

register_envs()
