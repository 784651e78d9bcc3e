"""The test rig over a serial line."""

from softrobot_env.envs.real.env import RealRigEnv

__all__ = ["RealRigEnv"]
