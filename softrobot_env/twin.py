"""`softrobot_env.robots.twin` under its public name."""

from softrobot_env.robots.twin import *  # noqa: F403
