"""All of chapter 4: the planar sensor, three of them in a finger, the spatial one in the rig."""

from softrobot_env.benchmarks.sensing import finger, planar, spatial
from softrobot_env.benchmarks.sensing.rows import Row
from softrobot_env.core.jobs import Progress


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Judge the sensors.

    Args:
        quick: Shorter series and fewer specimens.
        progress: Called with (description, done, total), or None.
    """
    if progress is not None:
        progress("planar sensors", 0, 1)
    return [*planar.rows(quick), *finger.rows(quick), *spatial.rows(quick, progress)]
