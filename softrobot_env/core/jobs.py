"""A study as named jobs, run one after the other or in processes of their own."""

import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, as_completed
from contextlib import suppress
from typing import Any

import cloudpickle

from softrobot_env.core import journal
from softrobot_env.core.processes import worker_processes
from softrobot_env.core.runs import Record

#: Description for the progress bar, and how it is done: what makes records. In processes it may
#: make anything, and hold anything that cloudpickle takes, such as what a user's file defines.
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


#: How often jobs whose process has ended are begun.
_TRIES = 3


def run_in_processes(
    tasks: Sequence[Job], progress: Progress | None = None, processes: int | None = None
) -> list[Any]:
    """What tasks return, in their order; the first error of one is raised.

    Where a journal is open (`journal.kept_in`), results are kept in it as they arrive, and what it
    has is not run. Tasks whose process is killed are begun anew.

    Args:
        tasks: Begun in this order, each in a process with one thread.
        progress: Called with (description, done, total) at first and after each, or None.
        processes: Tasks at a time, unless the user chose (`processes.using`); one per core unless
            given.

    Raises:
        RuntimeError: Processes end again and again.
    """
    kept, show = journal.current(), progress or quiet
    names = _names(tasks, kept)
    found: dict[int, Any] = {}
    for number, name in enumerate(names):
        result = None if kept is None else kept.read(name)
        if result is not None:
            with suppress(Exception):  # of another version of what it is made of
                found[number] = pickle.loads(result)
                kept.taken += 1
    show("running", len(found), len(tasks))
    for _ in range(_TRIES):
        try:
            for number, result in _arriving(tasks, found, processes):
                found[number] = pickle.loads(result)
                if kept is not None:
                    kept.write(names[number], result)
                show(tasks[number][0], len(found), len(tasks))
        except BrokenExecutor:
            continue
        return [found[number] for number in range(len(tasks))]
    waiting = [label for number, (label, _) in enumerate(tasks) if number not in found]
    raise RuntimeError(
        f"worker processes ended {_TRIES} times, as they do without memory; left of {len(tasks)} "
        f"jobs: {', '.join(waiting[:3])}{' ...' if len(waiting) > 3 else ''}"
    )


def _names(tasks: Sequence[Job], kept: journal.Journal | None) -> list[str]:
    """Names of jobs in a journal: which set of jobs, place in it, and description."""
    set_ = 0 if kept is None else kept.begin()
    return [f"{set_} {number} {label}" for number, (label, _) in enumerate(tasks)]


def _arriving(
    tasks: Sequence[Job], found: dict[int, Any], processes: int | None
) -> Iterator[tuple[int, bytes]]:
    """Numbers and packed results of those tasks that are not found yet, as they arrive."""
    left = [number for number in range(len(tasks)) if number not in found]
    if not left:
        return
    with worker_processes(processes) as pool:
        running = {pool.submit(_done, cloudpickle.dumps(tasks[n][1])): n for n in left}
        failed: BaseException | None = None
        for future in as_completed(running):
            if future.cancelled():
                continue
            error = future.exception()
            if error is None:
                yield running[future], future.result()
            elif failed is None:  # what is under way ends, and counts
                failed = error
                for other in running:
                    other.cancel()
    if failed is not None:
        raise failed


def _done(work: bytes) -> bytes:
    """The packed result of a packed task."""
    return cloudpickle.dumps(pickle.loads(work)())
