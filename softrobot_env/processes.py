"""One thread for linear algebra: in commands, in processes of our own, and for a while in others.

The matrices of this package are small: more threads gain nothing, and where other programs run they
wait for each other, which makes such work up to fifty times slower.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from signal import SIG_DFL, SIGINT, signal
from threading import Lock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

    from threadpoolctl import ThreadpoolController

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


def one_thread_on_the_command_line() -> None:
    """`one_thread` if this process is `softrobot` or `python -m softrobot_env`.

    A program that imports the package keeps its own settings, see `one_blas_thread`.
    """
    program = sys.argv[0] if sys.argv else ""  # "-m" while Python still looks for the module
    if program == "-m" or Path(program).name == "softrobot":
        one_thread()


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


@contextmanager
def worker_processes(count: int | None = None) -> "Iterator[ProcessPoolExecutor]":
    """Fresh processes, each with one thread for linear algebra.

    As many as given, or as there are cores that they may run on. What waits when the context is
    left is not begun any more.
    """
    from concurrent.futures import ProcessPoolExecutor  # every import of the package comes here
    from multiprocessing import get_context

    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))  # what is started meanwhile inherits it
    pool = ProcessPoolExecutor(
        count or usable_cores(), get_context("spawn"), signal, (SIGINT, SIG_DFL)
    )  # Ctrl-C ends them in silence: this process tells of it
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
