"""Checks of what users pass to the test rig's `reset`."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from softrobot_env.envs.options import known_options, positive, vector

#: Option -> what it does; also the list in error messages.
OPTIONS = {
    "duration": "duration [s] of the episode instead of the task's",
    "start_length": "pulled-in tendon lengths [m] in whose equilibrium the episode starts",
    "task": "dict of options of the task, as those of the environment",
}


@dataclass(frozen=True)
class RigResetOptions:
    """Options of one reset; see `OPTIONS`."""

    duration: float | None = None
    start_length: np.ndarray | None = None
    task: dict[str, float] = field(default_factory=dict)


def parse_rig_options(
    options: dict[str, Any] | None, n_tendons: int, length_scale: float
) -> RigResetOptions:
    """Check the options of `reset`.

    Raises:
        ValueError: Unknown option, wrong shape, or a value out of range.
    """
    given = known_options(options, OPTIONS)
    if "duration" in given:
        given["duration"] = positive("duration", given["duration"])
    if "start_length" in given:
        given["start_length"] = length = vector("start_length", given["start_length"], n_tendons)
        if np.any(np.abs(length) > length_scale):
            raise ValueError(
                f"option 'start_length' must lie within +-{length_scale:g} m, got {length.tolist()}"
            )
    if not isinstance(given.get("task", {}), dict):
        raise ValueError(f"option 'task' must be a dict, got {given['task']!r}")
    return RigResetOptions(**given)
