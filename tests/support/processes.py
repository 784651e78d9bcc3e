"""Processes that tests start."""

import subprocess
import sys
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
