"""Wrong calls of every command, made from its own parser: one line that says what, status 2."""

import argparse
import re
import subprocess
import sys
import time
import warnings
from itertools import takewhile
from pathlib import Path
from signal import SIG_DFL, SIGINT, signal

import pytest

from softrobot_env.cli import build_parser, main

#: Takes any text, or refuses only when it runs.
_ANY = (None, str, Path)

_BAD = "?!"


def parsers(parser, words=()):
    """All commands: words that call them, and their parsers."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield (*words, name), below
                yield from parsers(below, (*words, name))


def wrong_calls():
    """Calls with an unknown option, without a value, and with a bad one, of each option."""
    for words, parser in parsers(build_parser()):
        positional = [a for a in parser._actions if not a.option_strings]
        if any(isinstance(a, argparse._SubParsersAction) for a in positional):
            yield (*words, _BAD)
            continue
        yield (*words, "--no-such-option")
        for action in positional:
            if action.choices or action.type not in _ANY:
                yield (*words, _BAD)
        for action in parser._actions:
            if not action.option_strings or action.nargs == 0:
                continue
            option = action.option_strings[-1]
            yield (*words, option)
            if action.choices or action.type not in _ANY:
                yield (*words, option, _BAD)


CALLS = list(wrong_calls())


def test_there_are_many():
    assert len(CALLS) > 200


def test_each_is_refused_in_one_line(capsys):
    wrong = {}
    for words in CALLS:
        with pytest.raises(SystemExit) as stop:
            main(list(words))
        told = capsys.readouterr()
        lines = told.err.splitlines()
        own = takewhile(lambda word: word[0] not in "-?", words)
        command = " ".join(["softrobot", *own])
        fine = stop.value.code == 2 and not told.out and len(lines) == 1
        if not (fine and lines[0].startswith(f"{command}:") and f"{command} --help" in lines[0]):
            wrong[words] = told
    assert not wrong


@pytest.mark.parametrize("words", [[], ["robot"], ["robot-file"]])
def test_no_command_shows_those_there_are(words, capsys):
    assert main(words) == 0
    assert re.search(r"usage: softrobot.*COMMAND", told := capsys.readouterr().out), told


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--timestep 1e-300", "timestep must be at least"),
        ("--randomize density=0.5,2 --draws 1000000000", "--draws: at most"),
    ],
)
def test_numbers_that_would_take_for_ever_are_refused(options, said, tmp_path, capsys):
    call = "evaluate --tasks swing --policies hold --out"
    assert main([*call.split(), str(tmp_path), *options.split()]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line


def test_a_video_of_no_known_kind_is_refused_before_it_is_made(tmp_path, capsys):
    assert main(["grip", "--out", str(tmp_path / "grip.avi")]) == 2
    told = capsys.readouterr()
    assert not told.out and "grip.avi" in told.err


@pytest.mark.parametrize("command", ["grip", "robot virtual"])
def test_seeds_are_not_negative(command, capsys):
    with pytest.raises(SystemExit):
        main([*command.split(), "--seed", "-1"])
    (line,) = capsys.readouterr().err.splitlines()
    assert "--seed" in line


@pytest.mark.parametrize("error", [MemoryError(), OverflowError("out of range")])
def test_what_numbers_or_memory_do_not_allow_is_told_in_one_line(error, capsys, monkeypatch):
    def fails(_):
        raise error

    monkeypatch.setattr("softrobot_env.commands.listing.run", fails)
    assert main(["list"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "out of" in line


def test_warnings_are_told_in_one_line(capsys, monkeypatch):
    def warns(_):
        told = warnings.formatwarning("so and\nso", UserWarning, "build.py", 307)
        print(told, end="")
        return 0

    monkeypatch.setattr("softrobot_env.commands.listing.run", warns)
    assert main(["list"]) == 0
    assert capsys.readouterr().out == "softrobot list: warning: so and so\n"


def test_ctrl_c_ends_in_one_line(capsys, monkeypatch):
    def stopped(_):
        raise KeyboardInterrupt

    monkeypatch.setattr("softrobot_env.commands.listing.run", stopped)
    assert main(["list"]) == 130
    assert capsys.readouterr().err == "softrobot list: stopped by Ctrl-C\n"


def test_ctrl_c_while_the_package_is_loaded_ends_in_one_line():
    program = (
        "import os, sys; sys.argv = ['softrobot']; import softrobot_env; os.kill(os.getpid(), 2)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, preexec_fn=_heeding
    )
    assert done.returncode == 130
    assert done.stderr == "softrobot: stopped by Ctrl-C\n"


_STOPS = """
import sys, time
from signal import SIGINT, SIGTERM, raise_signal
from softrobot_env.cli import main
from softrobot_env.commands import listing

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
    done = subprocess.run(
        [sys.executable, "-c", _STOPS], capture_output=True, text=True, preexec_fn=_heeding
    )
    assert done.stdout.split() == ["130", "130", "cleaned", "up", "143"], done.stderr
    by = ("Ctrl-C", "Ctrl-C", "SIGTERM")
    assert done.stderr.splitlines() == [f"softrobot list: stopped by {name}" for name in by]


def _heeding():
    """Background jobs of a shell ignore Ctrl-C, and so do their children."""
    signal(SIGINT, SIG_DFL)


@pytest.mark.slow
def test_ctrl_c_ends_workers_too(tmp_path):
    command = [sys.executable, "-m", "softrobot_env", "benchmark", "generalization"]
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
        _, told = running.communicate(timeout=30)
    assert running.returncode == 130
    assert told.splitlines() == ["softrobot benchmark: stopped by Ctrl-C"], told


def test_options_of_other_trainings_are_refused_each_with_those_that_take_it(capsys, tmp_path):
    call = ["train", "lqi", "--out", str(tmp_path), "--recording", "a.csv", "--steps", "9"]
    assert main(call) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--recording: only with ssm; --steps: only with ppo," in line
