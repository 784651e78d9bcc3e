"""See `studies.beams`."""

from studies.beams import *  # noqa: F403 (until all studies have moved)
