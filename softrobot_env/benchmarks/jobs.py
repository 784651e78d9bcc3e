"""A benchmark as named jobs, run one after the other or in processes of their own."""

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from typing import Any

from softrobot_env.benchmarks.records import Record
from softrobot_env.processes import worker_processes

#: Description for the progress bar, and how it is done: what makes records. In processes it has to
#: be something that can be pickled, and may make anything.
Job = tuple[str, Callable[[], Any]]
#: Called with description, jobs done and number of jobs.
Progress = Callable[[str, int, int], None]


def quiet(description: str, done: int, total: int) -> None:
    """Progress that nobody wants to see."""


def run_jobs(
    jobs: Sequence[Job], progress: Progress | None, rows: list[Record] | None = None
) -> list[Record]:
    """Run jobs and collect their records.

    Args:
        jobs: The jobs.
        progress: Told before each job and at the end, or None.
        rows: List to add to, for jobs that read what earlier ones found; a new one unless given.
    """
    rows, show = [] if rows is None else rows, progress or quiet
    for done, (description, job) in enumerate(jobs):
        show(description, done, len(jobs))
        rows += job()
    show("done", len(jobs), len(jobs))
    return rows


def run_in_processes(
    tasks: Sequence[Job], progress: Progress | None = None, processes: int | None = None
) -> list[Any]:
    """What tasks return, in their order; the first error of one is raised.

    Args:
        tasks: Begun in this order, each in a process with one thread.
        progress: Called with (description, done, total) at first and after each, or None.
        processes: Tasks at a time; one per core unless given.
    """
    with worker_processes(processes) as pool:
        running = {pool.submit(work): label for label, work in tasks}
        (progress or quiet)("running", 0, len(running))
        for done, future in enumerate(as_completed(running), start=1):
            future.result()
            (progress or quiet)(running[future], done, len(running))
        return [future.result() for future in running]
