"""`softrobot_env.robots.loads` under its public name."""

from softrobot_env.robots.loads import Load

__all__ = ["Load"]
