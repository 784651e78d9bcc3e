"""Trainings in processes of their own, each with one thread."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

from softrobot_env.benchmarks.jobs import Progress

#: What is done, for the progress, and how, by something that can be pickled.
Task = tuple[str, Callable[[], Any]]

#: Libraries that read them take one thread per process: small matrices gain nothing from more.
_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


def run_tasks(tasks: Sequence[Task], progress: Progress, processes: int | None = None) -> list[Any]:
    """What tasks return, in their order; the first error of one is raised.

    Args:
        tasks: Begun in this order.
        progress: Called with (description, done, total).
        processes: Tasks at a time; one per core unless given.
    """
    with _one_thread_each():
        pool = ProcessPoolExecutor(processes or os.cpu_count(), mp_context=get_context("spawn"))
        try:
            running = {pool.submit(work): label for label, work in tasks}
            _watch(running, progress)
            return [future.result() for future in running]
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes that are started meanwhile use one thread for linear algebra."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _watch(running: dict[Future, str], progress: Progress) -> None:
    """Tell what is done, and raise the first error."""
    for done, future in enumerate(as_completed(running), start=1):
        future.result()
        progress(running[future], done, len(running))
