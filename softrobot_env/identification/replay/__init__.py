"""Replays: a recording's commands given to a simulated robot, and how far its markers are off."""

from softrobot_env.identification.replay.errors import ErrorRow, error_rows
from softrobot_env.identification.replay.simulation import Replay, replay

__all__ = ["ErrorRow", "Replay", "error_rows", "replay"]
