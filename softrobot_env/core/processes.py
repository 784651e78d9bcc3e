"""Where work is done: with how many threads, in how many processes, or on a Ray cluster.

The matrices of this package are small: more threads gain nothing, and where other programs run they
wait for each other, which makes such work up to fifty times slower.
"""

import os
import signal as signals
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from signal import SIG_DFL, SIGINT, SIGTERM, default_int_handler, getsignal, signal
from threading import Lock, Thread, current_thread, main_thread
from types import FrameType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from concurrent.futures import Executor, Future

    from threadpoolctl import ThreadpoolController

#: Exit status of what Ctrl-C ended.
STOPPED = 130

#: Libraries read these once, when they are loaded.
THREADS = (
    "OPENBLAS_NUM_THREADS",
    "OMP_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMEXPR_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


def one_thread() -> None:
    """Take one thread where the user's environment says nothing; call it before NumPy is loaded."""
    for name in THREADS:
        os.environ.setdefault(name, "1")


def prepare_the_command_line() -> None:
    """`one_thread` and `stop_at_once` if this is `softrobot` or `python -m softrobot_env`.

    A program that imports the package keeps its own settings, see `one_blas_thread`.
    """
    program = sys.argv[0] if sys.argv else ""  # "-m" while Python still looks for the module
    started = getattr(sys, "orig_argv", [])
    if "softrobot_env" in started if program == "-m" else Path(program).name == "softrobot":
        one_thread()
        if "--multiprocessing-fork" not in started and current_thread() is main_thread():
            stop_at_once()


def stop_at_once() -> None:
    """Let Ctrl-C end this process in a line: for as long as it loads, when nothing can be lost.

    What is interrupted while it is imported would tell a traceback, and perhaps go on.
    """
    if getsignal(SIGINT) is default_int_handler:
        signal(SIGINT, ended_by_ctrl_c)


def ended_by_ctrl_c(number: int, frame: FrameType | None) -> None:
    """Handler of Ctrl-C."""
    os.write(2, b"softrobot: stopped by Ctrl-C\n")
    os._exit(STOPPED)


#: Held by who has set one thread.
_LIMITED = Lock()


@cache
def _libraries(_with_scipy: bool) -> "ThreadpoolController":
    """Loaded libraries of linear algebra; SciPy comes with another one than NumPy.

    Looking for them takes a millisecond, setting their threads 10 µs.
    """
    from threadpoolctl import ThreadpoolController  # every import of the package comes here

    return ThreadpoolController().select(user_api="blas")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Within it linear algebra takes one thread; afterwards as many as before. Also a decorator.

    For functions with matrices of some hundred rows in programs that set nothing themselves. Who
    enters while another one is inside leaves the number to that one.
    """
    if not _LIMITED.acquire(blocking=False):
        yield
        return
    try:
        with _libraries("scipy.linalg" in sys.modules).limit(limits=1):
            yield
    finally:
        _LIMITED.release()


def usable_cores() -> int:
    """Number of cores that this process may run on; systems that do not tell give all."""
    allowed = getattr(os, "sched_getaffinity", None)
    return len(allowed(0)) if allowed else os.cpu_count() or 1


@dataclass(frozen=True)
class Workers:
    """Where independent jobs run.

    Attributes:
        count: Processes of this machine; None for as many as who starts them wants.
        ray: Address of a Ray cluster, "local" for one that is started here; None for no Ray.
    """

    count: int | None = None
    ray: str | None = None


_AS_WANTED = Workers()
_CHOSEN: ContextVar[Workers] = ContextVar("workers", default=_AS_WANTED)


def parsed_workers(text: str) -> Workers:
    """Workers from `N`, `ray` or `ray:ADDRESS`.

    Raises:
        ValueError: It is none of them.
    """
    kind, _, address = text.partition(":")
    if kind == "ray" and text != "ray:":
        return Workers(ray=address or "local")
    if text.isascii() and text.isdigit() and int(text) > 0:
        return Workers(int(text))
    raise ValueError(f"{text!r} is not a number of processes, ray or ray:ADDRESS")


@contextmanager
def using(workers: Workers | None) -> Iterator[None]:
    """Within it, `worker_processes` are these; None changes nothing."""
    token = _CHOSEN.set(workers or _CHOSEN.get())
    try:
        yield
    finally:
        _CHOSEN.reset(token)


@contextmanager
def chosen_processes() -> "Iterator[Executor | None]":
    """`worker_processes` if they were chosen by `using`, else None: the work is done here."""
    if _CHOSEN.get() is _AS_WANTED:
        yield None
        return
    with worker_processes() as pool:
        yield pool


def _begin_worker() -> None:
    """End with the process that began this one, and in silence on Ctrl-C: that one tells of it."""
    from multiprocessing import parent_process

    def end() -> None:
        parent_process().join()
        os._exit(1)

    signal(SIGINT, SIG_DFL)
    signal(SIGTERM, SIG_DFL)
    if hasattr(signals, "pthread_sigmask"):
        signals.pthread_sigmask(signals.SIG_UNBLOCK, {SIGINT})
    Thread(target=end, daemon=True).start()


@contextmanager
def _ctrl_c_waits() -> Iterator[None]:
    """Processes started within it hear of Ctrl-C in `_begin_worker`: before, they would tell it."""
    if not hasattr(signals, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # would end what is begun here
    before = signals.pthread_sigmask(signals.SIG_BLOCK, {SIGINT})
    try:
        yield
    finally:
        signals.pthread_sigmask(signals.SIG_SETMASK, before)


@contextmanager
def worker_processes(count: int | None = None) -> "Iterator[Executor]":
    """Processes to submit jobs to, each with one thread for linear algebra.

    Fresh processes of this machine, as many as given, or as there are cores that they may run on;
    or what was chosen by `using`. What waits when the context is left is not begun any more.

    Raises:
        ImportError: Ray was chosen and is not installed.
        ConnectionError: There is no Ray cluster at the address.
    """
    chosen = _CHOSEN.get()
    if chosen.ray is not None:
        from .cluster import ray_executor

        with ray_executor(chosen.ray, dict.fromkeys(THREADS, "1")) as cluster:
            yield cluster
        return
    from concurrent.futures import ProcessPoolExecutor  # every import of the package comes here
    from multiprocessing import get_context

    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))  # what is started meanwhile inherits it

    class Pool(ProcessPoolExecutor):
        def submit(self, *job: Any, **options: Any) -> "Future":
            with _ctrl_c_waits():  # it may start a process
                return super().submit(*job, **options)

    pool = Pool(chosen.count or count or usable_cores(), get_context("spawn"), _begin_worker)
    try:
        yield pool
    except KeyboardInterrupt:  # perhaps of this process alone: do not wait for the others
        for process in list((pool._processes or {}).values()):
            process.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
