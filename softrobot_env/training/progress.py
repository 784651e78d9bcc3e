"""How trainings tell how far they are."""

from collections.abc import Callable

#: Told a description, how much is done and how much there is.
Show = Callable[[str, int, int], None]
