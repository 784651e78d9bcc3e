"""What ends a command, errors, warnings or Ctrl-C, is reported in one line."""

import re
import subprocess
import sys
import time
import warnings
from signal import SIG_DFL, SIGINT, signal

import pytest
from support.processes import finished

from softrobot_env.cli import main


@pytest.mark.parametrize("words", [[], ["robot"], ["robot-file"]])
def test_no_command_shows_those_there_are(words, capsys):
    assert main(words) == 0
    assert re.search(r"usage: softrobot.*COMMAND", reported := capsys.readouterr().out), reported


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (MemoryError(), 2, "out of memory"),
        (OverflowError("out of range"), 2, "out of range"),
        (KeyboardInterrupt(), 130, "stopped by Ctrl-C"),
    ],
)
def test_what_ends_a_command_is_told_in_one_line(error, status, said, capsys, monkeypatch):
    def fails(_):
        raise error

    monkeypatch.setattr("softrobot_env.commands.listing.run", fails)
    assert main(["list"]) == status
    assert capsys.readouterr().err == f"softrobot list: {said}\n"


def test_warnings_are_told_in_one_line(capsys, monkeypatch):
    def warns(_):
        print(warnings.formatwarning("so and\nso", UserWarning, "build.py", 307), end="")
        return 0

    monkeypatch.setattr("softrobot_env.commands.listing.run", warns)
    assert main(["list"]) == 0
    assert capsys.readouterr().out == "softrobot list: warning: so and so\n"


def test_ctrl_c_while_the_package_is_loaded_ends_in_one_line():
    program = (
        "import os, sys; sys.argv = ['softrobot']; import softrobot_env; os.kill(os.getpid(), 2)"
    )
    done = finished("-c", program, preexec_fn=_heeding)
    assert done.returncode == 130
    assert done.stderr == "softrobot: stopped by Ctrl-C\n"


_STOPS = """
import sys, time
from signal import SIGINT, SIGTERM, raise_signal
from softrobot_env.cli import main
from softrobot_env.commands import listing
from softrobot_env.core import under_way

under_way.SPEAKS = False

class Forgotten:
    def __del__(self):
        raise_signal(SIGINT)  # Python tells what is raised here, and goes on

def forgotten(_):
    Forgotten()
    time.sleep(30)

def changed(_):
    try:
        raise_signal(SIGINT)
    except KeyboardInterrupt:
        raise TypeError("what was interrupted is of no type")

def terminated(_):
    try:
        raise_signal(SIGTERM)
    finally:
        print("cleaned up")

for listing.run in (forgotten, changed, terminated):
    print(main(["list"]), flush=True)
assert sys.unraisablehook is sys.__unraisablehook__
"""


def test_ctrl_c_and_sigterm_end_in_one_line_whatever_they_interrupt():
    done = finished("-c", _STOPS, preexec_fn=_heeding)
    assert done.stdout.split() == ["130", "130", "cleaned", "up", "143"], done.stderr
    by = ("Ctrl-C", "Ctrl-C", "SIGTERM")
    assert done.stderr.splitlines() == [f"softrobot list: stopped by {name}" for name in by]


def _heeding():
    """Background jobs of a shell ignore Ctrl-C, and so do their children."""
    signal(SIGINT, SIG_DFL)


@pytest.mark.slow
def test_ctrl_c_ends_workers_too(tmp_path):
    command = [sys.executable, "-m", "softrobot_env", "benchmark", "transfer"]
    with subprocess.Popen(
        [*command, "--out", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=_heeding,
    ) as running:
        time.sleep(15)
        assert running.poll() is None, running.stderr.read()
        subprocess.run(["kill", f"-{SIGINT.value}", "--", f"-{running.pid}"], check=True)
        _, reported = running.communicate(timeout=30)
    assert running.returncode == 130
    *meanwhile, last = reported.splitlines()
    assert last == "softrobot benchmark: stopped by Ctrl-C", reported
    assert all(re.fullmatch(r".*, \d+ s", line) for line in meanwhile), reported
