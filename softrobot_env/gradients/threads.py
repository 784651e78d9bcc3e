"""Many motions and their derivatives side by side, on threads."""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from queue import SimpleQueue
from typing import Any, TypeVar

from softrobot_env.core.processes import usable_cores

from .rollout import Rollout

Result = TypeVar("Result")


def on_threads(
    work: Callable[[Rollout, Any], Result],
    rollout: Rollout,
    items: Sequence[Any],
    threads: int | None = None,
) -> list[Result]:
    """What a function makes of each item with a rollout of its own, in the items' order.

    Derivatives are computed without Python's lock, motions with it, so a few threads are enough.
    All that is derived of a motion has to be so in `work`, as the next item's motion takes its
    place.

    Args:
        work: Function of a rollout, which no other thread has meanwhile, and an item.
        rollout: Rollout of which the others are copies.
        items: What the motions differ by, such as inputs (periods, n_inputs) or starts.
        threads: Number of threads; one for each usable core unless given.

    Raises:
        ValueError: No positive number of threads.
    """
    count = usable_cores() if threads is None else threads
    if count < 1:
        raise ValueError(f"threads must be a whole number, 1 or more, got {threads}")
    free: SimpleQueue[Rollout] = SimpleQueue()
    for k in range(min(count, len(items))):
        free.put(deepcopy(rollout) if k else rollout)

    def one(item: Any) -> Result:
        own = free.get()
        try:
            return work(own, item)
        finally:
            free.put(own)

    with ThreadPoolExecutor(count) as pool:
        return list(pool.map(one, items))
