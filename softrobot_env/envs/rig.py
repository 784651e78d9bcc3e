"""Public name of the thesis' environments of its rig, where that plug-in is installed."""

from softrobot_env.core.registry import served

__getattr__ = served(__name__)
