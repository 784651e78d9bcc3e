"""One thread for linear algebra, here and in processes of our own.

The matrices of this package are small: more threads gain nothing, and where other programs run they
wait for each other, which makes such work up to fifty times slower.
"""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from concurrent.futures import ProcessPoolExecutor

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

    A program that imports the package keeps its own settings.
    """
    program = sys.argv[0] if sys.argv else ""  # "-m" while Python still looks for the module
    if program == "-m" or Path(program).name == "softrobot":
        one_thread()


@contextmanager
def worker_processes(count: int | None = None) -> "Iterator[ProcessPoolExecutor]":
    """Fresh processes, one per core unless given, each with one thread for linear algebra.

    What waits when the context is left is not begun any more.
    """
    from concurrent.futures import ProcessPoolExecutor  # every import of the package comes here
    from multiprocessing import get_context

    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))  # what is started meanwhile inherits it
    pool = ProcessPoolExecutor(count or os.cpu_count(), mp_context=get_context("spawn"))
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
