"""Trainings in processes of their own, each with one thread."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future, as_completed
from typing import Any

from softrobot_env.benchmarks.jobs import Progress
from softrobot_env.processes import worker_processes

#: What is done, for the progress, and how, by something that can be pickled.
Task = tuple[str, Callable[[], Any]]


def run_tasks(tasks: Sequence[Task], progress: Progress, processes: int | None = None) -> list[Any]:
    """What tasks return, in their order; the first error of one is raised.

    Args:
        tasks: Begun in this order.
        progress: Called with (description, done, total).
        processes: Tasks at a time; one per core unless given.
    """
    with worker_processes(processes) as pool:
        running = {pool.submit(work): label for label, work in tasks}
        _watch(running, progress)
        return [future.result() for future in running]


def _watch(running: dict[Future, str], progress: Progress) -> None:
    """Tell what is done, and raise the first error."""
    for done, future in enumerate(as_completed(running), start=1):
        future.result()
        progress(running[future], done, len(running))
