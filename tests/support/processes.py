"""Processes that tests start."""

import os
import subprocess
import sys
import warnings
from contextlib import contextmanager


@contextmanager
def python(program, *arguments, **options):
    """A Python program in a process that is killed and waited for at the end of the context."""
    command = [sys.executable, "-c", program, *arguments]
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        finally:
            process.kill()


def finished(*arguments, **options):
    """A Python process with arguments that has ended, and what it printed."""
    command = [sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, **options)


def in_a_fork(act):
    """What `act` raises in a forked child, as text; empty if nothing."""
    reading, writing = os.pipe()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads; the point of the test
        child = os.fork()
    if child == 0:
        try:
            act()
            text = ""
        except BaseException as error:
            text = f"{type(error).__name__}: {error}"
        os.write(writing, text.encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        text = pipe.read().decode()
    os.waitpid(child, 0)
    return text
