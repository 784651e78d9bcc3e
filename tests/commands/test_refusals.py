"""Calls that commands refuse: one line that says what, status 2, and nothing is written."""

import argparse
import os
import shutil
import sys
from itertools import takewhile
from pathlib import Path

import numpy as np
import pytest
from support import writes
from support.commands import MINE
from support.rig_identified_file import constant_identified, identified_file

from fuzz import within
from softrobot_env.cli import build_parser, main
from softrobot_env.commands import arguments
from softrobot_env.core.files import assets_dir, models_dir
from softrobot_env.robots import RIG
from softrobot_env.thesis.rig.parameters import describe_rig

# ---------------------------------------------------------------- made from the parsers

#: Takes any text, or refuses only when it runs.
_ANY = (None, str, Path)

_BAD = "?/!"


def parsers(parser, words=()):
    """All commands: words that call them, and their parsers."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield (*words, name), below
                yield from parsers(below, (*words, name))


#: What takes numbers of one sign, and texts that are none of them.
_NUMBERS = (arguments.positive, arguments.not_negative, arguments.whole, arguments.size)
_NUMBERS += (arguments.port, arguments.seed, arguments.fps)
_NO_NUMBERS = ("nan", "inf", "-inf", "1e999", "-1", "", "1,5", "\x1b[2J")


def wrong_calls():
    """Calls with an unknown option, without a value, and with bad ones, of each option."""
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
            if action.type in _NUMBERS:
                more = ["1"] * (action.nargs - 1) if isinstance(action.nargs, int) else []
                for text in _NO_NUMBERS:
                    yield (*words, option, *more, text)


def test_each_is_refused_in_one_line(capsys):
    wrong, calls, parser = {}, list(wrong_calls()), build_parser()
    assert len(calls) > 600
    for words in calls:
        with pytest.raises(SystemExit) as stop:
            parser.parse_args(words)
        reported = capsys.readouterr()
        lines = reported.err.splitlines()
        own = takewhile(lambda word: word[0] not in "-?", words)
        command = " ".join(["softrobot", *own])
        fine = stop.value.code == 2 and not reported.out and len(lines) == 1
        fine = fine and lines[0].isprintable()
        if not (fine and lines[0].startswith(f"{command}:") and f"{command} --help" in lines[0]):
            wrong[words] = reported
    assert not wrong


# ---------------------------------------------------------------- by what they ask for

FINGER, REACH = "--robot planar_finger", "evaluate --tasks reach"

#: Words of a call, and what its line says; the folder has the files of `files`.
CALLS = [
    ("evaluate --policies pid", "feedforward_pi"),
    ("evaluate --tasks jump", "lshape"),
    ("evaluate --vary mass=2", "youngs_modulus"),
    ("evaluate --vary youngs_modulus=0", "a factor on youngs_modulus"),
    ("evaluate --step-widths 0.9 --tasks step", "step width"),
    ("evaluate --step-widths 0.1 --tasks swing", "step_width is an option of"),
    ("evaluate --speeds 0.1 --tasks swing", "circle, figure_eight, random"),
    ("evaluate --path-seeds 1 --tasks circle", "random, reach"),
    ("evaluate --tasks circle --option colour=1", "speed"),
    ("evaluate --tasks swing --policies hold --timestep 1e-300", "timestep must be at least"),
    ("evaluate --randomize density=0.5,2 --draws 1000000000", "--draws: at most"),
    ("evaluate --tasks triangle --env virtual --workers 2", "--workers: only with --env sim"),
    ("inspect --task jump", "swing"),
    ("inspect --rule simpson", "balanced2"),
    ("inspect --pieces 4", "inside a piece"),
    ("inspect --control-period 3", "control_period"),
    ("inspect --twin 1", "--twin: only with tasks of the rig"),
    ("inspect --workspace", "--workspace goes with --robot only"),
    (f"inspect {FINGER} --option radius=1", "with a --task only"),
    (f"inspect {FINGER} --task step", "unknown task 'step'; choose from reach"),
    ("export --robot nobody", "hanging_trunk"),
    ("render --policy pid", "feedforward"),
    ("render --size 0 10", "pixels"),
    ("render --size 640 1000000", "8192 at most"),
    ("render --fps 1e9", "frames per second from 0.1 to 1000"),
    ("robot-file check /dev/zero", "/dev/zero: give a file, not a device or a pipe"),
    ("robot-file check pipe", "pipe: give a file"),
    ("robot-file check endless.toml", "endless.toml: at most 1048576 bytes, it has 1000000000000"),
    ("render --robot pipe --task circle", "unknown robot"),
    ("evaluate --tasks reach --identified pipe", "no network at pipe"),
    ("evaluate --policies pipe:P", "pipe"),
    ("recording check pipe.csv", "pipe.csv: give a file"),
    ("render --task swing --begin 15", "the episode is over after 15 s"),
    ("view --web --policy hold", "--policy"),
    ("view --web --port 99999", "65535"),
    ("grip --out grip.avi", "grip.avi"),
    ("grip --seed -1", "--seed"),
    ("grip --diameter 10", "--diameter: its fingers span 0.2"),
    ("grip --gripper hand", "softrobot grip: unknown gripper 'hand'; choose from gripper"),
    ("warm-up nothing_like_it", "lq_adaptive"),
    ("benchmark weight", "speed"),
    ("benchmark speed --workers 2", "runs one job after the other"),
    (f"benchmark speed {FINGER}", "measures its own robots"),
    ("benchmark accuracy --robot gripper", "give one of its fingers, such as gripper_finger"),
    ("benchmark laws --robot arm", "--robot goes with accuracy and stability"),
    ("benchmark accuracy --robot arm --redraw", "leave out --robot"),
    ("benchmark stability --robot nobody", "choose from "),
    # The rig's tasks and policies, and what others lack.
    ("evaluate --tasks swing --policies hybrid", "for the tasks triangle, rig_circle, reach"),
    ("evaluate --tasks triangle --policies lqi", "for the tasks step, swing"),
    ("evaluate --tasks swing reach --policies hybrid", "no policy for task 'swing'"),
    ("evaluate --tasks swing --twin 1", "--twin: only with tasks of the rig"),
    ("evaluate --tasks reach --option period=1", "period is an option of triangle only"),
    ("evaluate --tasks reach --option seed=0.5", "whole number"),
    ("evaluate --tasks triangle --option period=0", "positive"),
    ("evaluate --tasks triangle --option period=5,0.08", "below 2.02 m/s"),
    ("evaluate --tasks triangle --option period", "NAME=V1,V2"),
    ("evaluate --tasks triangle --option period=fast", "not a number"),
    ("evaluate --tasks triangle --vary tension_gain=2", "driven by length"),
    ("evaluate --tasks triangle --plant pcc", "no tendon friction"),
    (
        "evaluate --plant pcc --rule midpoint --timestep 1e-3",
        "--rule, --timestep: only with --plant",
    ),
    ("evaluate --tasks triangle --feedback output", "--feedback output: only with"),
    ("evaluate --tasks triangle --twin some", "none"),
    ("render --task triangle --option period=5,1", "one value"),
    ("render --task triangle --policy lqi", "hybrid"),
    # Files of identified parameters.
    ("evaluate --tasks swing --identified a.npz", "--identified: only with tasks of the rig, tri"),
    (
        "evaluate --tasks reach --identified a.npz --policies inverse_dynamics "
        "inverse_dynamics_ahead",
        "--identified: only with the policies rig_nn, rig_nn_p, rig_nn_pi, hybrid, hybrid_ahead",
    ),
    ("render --task reach --policy inverse_dynamics --identified a.npz", "--identified: only with"),
    ("evaluate --tasks reach --identified no.npz", "no.npz"),
    ("evaluate --tasks reach --identified no.npz", "make it with `softrobot train rig_nn --robot"),
    ("evaluate --tasks reach --identified mine.py", "mine.py is no npz file of arrays, or damaged"),
    (f"{REACH} --identified gains.npz", "gains.npz lacks the array 'weight_0'; it has gains; make"),
    ("evaluate --tasks reach --identified undamped.npz", "undamped.npz lacks the array 'damping'"),
    ("evaluate --tasks reach --identified arm.npz", "was trained for 'arm' with other parameters"),
    # Known delays.
    ("evaluate --tasks swing --policies hold --predict 0,0.02", "Hold follows no reference"),
    ("evaluate --tasks swing --policies lqi --predict 0.0205", "multiple of the control period"),
    ("evaluate --tasks swing --policies lqi --predict -0.02", "is not a number of zero or more"),
    ("render --task swing --policy lqi --predict 0,0.02", "--predict: only one delay"),
    ("evaluate --tasks triangle --env virtual --pieces 4", "--pieces: only with simulated robots"),
    # Robots, tasks and policies of one's own.
    (f"evaluate {FINGER} --tasks swing", "unknown task 'swing'; choose from reach"),
    (f"evaluate {FINGER} --tasks reach --policies lqi", "lqi has not been trained"),
    (f"evaluate {FINGER} --tasks reach --policies mine.py:needs_head", "a robot with a head"),
    (f"evaluate {FINGER} --tasks reach --policies mine.py:missing", "missing"),
    (f"evaluate {FINGER} --tasks mine.py:P", "must take the robot"),
    (f"evaluate {FINGER} --tasks reach --policies hold mine.py:hold", "two policies called 'hold'"),
    (f"evaluate {FINGER} --tasks circle --option hold=1", "hold is an option of reach only"),
    (f"evaluate {FINGER} --tasks circle --option radius=0.1", "smaller radius"),
    (f"evaluate {FINGER} --tasks reach --env virtual", "add a table"),
    (f"evaluate {FINGER} --tasks reach --twin 1", "--twin: only with tasks of the rig"),
    (f"evaluate {FINGER} --tasks reach --draws 2", "only with --randomize"),
    (f"evaluate {FINGER} --tasks reach --randomize density=2,0.5", "low <= high"),
    ("evaluate --robot rig --tasks circle --policies hybrid", "follows x and y alone, as triang"),
    ("evaluate --robot nobody", "unknown robot 'nobody'; choose from gripper_finger"),
    ("evaluate --tasks mine.py:stay", "is for any robot"),
    ("evaluate --tasks step --policies other.npz", "no policy at other.npz"),
    ("evaluate --robot cantilever_weak", "no tendons"),
    # Sensors.
    (
        "evaluate --tasks triangle --policies rig_nn_pi --twin 3 --feedback sensors",
        "--twin 3 --out DIR` and give it by",
    ),
    ("evaluate --tasks swing --policies lqi --feedback sensors", "robot 'arm' carries none; give"),
    (
        "evaluate --tasks triangle --policies rig_nn_pi --sensors no.npz --feedback sensors",
        "No such file",
    ),
    ("evaluate --tasks triangle --policies rig_nn_pi --sensors a.npz", "--sensors: only with --fe"),
    # Recordings.
    ("recording check none.csv", "none.csv: no such file"),
    ("recording replay none.csv --robot nobody", "nobody"),
    (f"robot record {FINGER} --amplitude 2", "amplitude must be in (0, 1]"),
    (f"identify mine.csv {FINGER} --stages statics,magic", "stages must be out of frame, tendons"),
    (f"identify mine.csv {FINGER} --stages residual", "one of the first four at least, got resid"),
    ("robot record --robot arm --env virtual", "only simulated: add a table [hardware]"),
    ("robot record --env virtual --vary density=1", "--vary: only with --env sim"),
    ("robot record --env virtual --twin none", "--twin none: only with --env sim"),
    ("robot record --robot arm --twin 1", "a twin has servos; robot 'arm' is driven by tension"),
    ("robot record --out a.xls", "a.xls: recordings are written as .csv or .parquet"),
    ("robot record --out mine.csv", "mine.csv is there already"),
    # Robots over a line.
    ("evaluate --tasks swing --env virtual", "only with tasks of the rig"),
    ("evaluate --tasks reach --env real --twin 1", "--twin"),
    ("evaluate --tasks reach --env virtual --twin none", "--twin none"),
    ("evaluate --tasks reach --env real --identified none.npz", "no network at none.npz"),
    ("evaluate --tasks reach --env virtual --port /dev/ttyUSB0", "--port"),
    ("evaluate --tasks reach --port /dev/ttyUSB0", "--port"),
    ("robot info --port /dev/no-robot", "cannot open /dev/no-robot"),
    ("robot calibrate --port /dev/no-robot --out mine.csv", "mine.csv is there already"),
    # Trainings.
    ("train", "give an artifact"),
    ("train --algo ppo --set speed=1", "cannot set 'speed'"),
    ("train --algo ppo --set steps=1.5", "whole number"),
    ("train --algo ppo --set discount=2", "discount must be from 0 to below 1"),
    ("train --algo ppo --start nowhere.npz", "no network at nowhere.npz"),
    ("train lqi --resume --steps 3", "--resume: only with ppo, sac"),
    (
        "train lqi --recording a.csv --steps 9",
        "--recording: only with ssm; --steps: only with shac, ppo",
    ),
    ("train rig_nn --robot arm", "'rig' alone, not for 'arm'"),
    ("train imitation --robot rig --twin 1", "--twin: only with ssm, sensors, rig_nn"),
    ("train imitation --robot rig", "`softrobot train lq_preview --robot rig`"),
    ("train ppo --robot rig", "`softrobot train imitation --robot rig`"),
    ("train ppo --robot rig --task swing", "is trained on random, circle"),
    # Several, and searches.
    ("train lqi --seeds 0..2", "nothing in lqi is random; only with qs_nn"),
    ("train ppo --seeds 0..2 --ship", "--ship: of a single run"),
    ("train ppo --workers 2 --checkpoint x --resume", "--checkpoint, --resume: of a single run"),
    ("train ppo --start none --set rate=1,2 --set speed=1", "cannot set 'speed'"),
    ("train ppo --start none --set discount=0.9,2", "discount must be from 0 to below 1"),
    ("train ppo --seeds 0,1 --start nowhere.npz", "no network at nowhere.npz"),
    ("train qs_nn --set rate=1,2", "--set: only with shac, ppo"),
    ("train qs_nn --seeds 3..1", "--seeds"),
    ("train qs_nn --seeds 0,1 --seed 0", "--seeds"),
    ("tune ppo --start none", "nothing to search"),
    ("tune ppo --start none --search speed=1..2", "cannot set 'speed'; choose from drawn_tasks"),
    ("tune ppo --start none --search rate=0.1..1000", "rate must be from 1e-12 to 100"),
    ("tune ppo --start none --search batch=1.5,2", "batch must be a whole number"),
    ("tune ppo --start none --search rate=0.1..1 --set rate=0.1", "--search rate: it is"),
    ("tune ppo --start none --search steps=1..2", "--search steps: it is the budget"),
    ("tune ppo --start none --search rate=0.1..1 --set batch=1,2", "--set batch: one value"),
    ("tune ppo --start none --space nowhere.toml", "nowhere.toml"),
    ("tune ppo --start none --search rate=1e-4..1e-3", "Ray is missing: pip install"),
    *((f"train --algo ppo --start none --name {n}", "--name") for n in ("../x", "a/b", "..", "/x")),
]

#: Arguments of a scene that no scene has, and where else nothing can be read or written.
SCENES = {
    "--accuracy": ("0", "-1", "nan", "inf", "1e-300", "1e-12", "x", "5%%"),
    "--timestep": ("1e-300", "1", "1e300"),
    "--control-period": ("1e-9", "0.5", "1e300"),
    "--pieces": ("0", "-1", "5", "1001", "99999999999999999999"),
    "--rule": ("x", "/", "\x1b[2J"),
    "--integrator": ("x", "RK9"),
}
RUNS = ("evaluate --tasks swing --policies hold", "inspect", "render --task swing --policy hold")
CALLS += [
    (f"{run} {option} {value}", "")
    for run in RUNS
    for option, values in SCENES.items()
    for value in values
]
NO_PLACES = ("mine.csv/x", "/dev/null/x", "a\0b", "n" * 300)
CALLS += [
    (f"{run} {place}{name}", "")
    for run, name in (
        ("evaluate --tasks swing --policies hold --duration 0.02 --no-plots --out", ""),
        ("export --out", ""),
        ("render --task swing --policy hold --duration 0.02 --size 16 16 --out", "/x.gif"),
        ("robot record --amplitude 0.1 --out", "/x.csv"),
        ("robot-file check", ""),
        ("recording check", ""),
    )
    for place in NO_PLACES
]

#: Policies and tasks that are none, or that end the program.
WRONG = """
import sys

class P:
    def __init__(self, robot, control_period): pass

class NoRobot:
    def __init__(self): pass

class NoObservation(P):
    def act(self): pass

class NoPair(P):
    def predict(self, observation, state, start, deterministic): return 1.0

class Asks(P):
    requires = ("nothing",)
    def act(self, observation): pass

class Exits(P):
    def act(self, observation): sys.exit(0)

class ExitsAtOnce(P):
    def __init__(self, robot, control_period): exit(3)

class NoEnvironment(P):
    environment = 3

number = 1.0

def ends(robot): sys.exit("bye")
"""

#: Code from outside, and what is said of it; with status 1.
OUTSIDE = [
    ("os.path:join", "policy 'os.path:join': TypeError: expected str"),
    ("wrong.py:NoRobot", "must take (robot, control_period): too many positional arguments"),
    ("wrong.py:NoObservation", "policy NoObservation: TypeError"),
    ("wrong.py:NoPair", "policy NoPair: TypeError: cannot unpack"),
    ("wrong.py:Asks", "policy Asks: `requires` must be a tuple of what is observed, curvature"),
    ("wrong.py:Exits", "policy Exits: SystemExit: 0 (wrong.py, line"),
    ("wrong.py:ExitsAtOnce", "policy 'wrong.py:ExitsAtOnce': SystemExit: 3"),
    ("wrong.py:NoEnvironment", "its environment: TypeError"),
    ("wrong.py:P", "'P' has neither"),
    ("wrong.py:number", "'float' has neither"),
    ("exits.py:P", "the policy 'exits.py:P': SystemExit: None (<frozen _sitebuiltins>"),
    ("static --tasks wrong.py:ends", "task 'wrong.py:ends': SystemExit: bye (wrong.py"),
]

#: What a command needs, of the extras.
NEEDS = {"train": "stable_baselines3", "tune": "stable_baselines3", "robot": "serial"}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A folder with a file of tasks and policies, and files of identified parameters."""
    folder = tmp_path_factory.mktemp("files")
    (folder / "mine.py").write_text(MINE)
    (folder / "wrong.py").write_text(WRONG)
    (folder / "exits.py").write_text("exit()")
    (folder / "mine.csv").touch()
    for name in ("pipe", "pipe.csv"):
        os.mkfifo(folder / name)
    shutil.copy(assets_dir() / "recordings" / "ftdcr_v4.toml", folder / "pipe.toml")
    with (folder / "endless.toml").open("wb") as file:
        file.truncate(10**12)
    identified_file(folder / "a.npz", twin=3)
    np.savez(folder / "gains.npz", gains=1.0)
    lacking = describe_rig(RIG) | {"stiffness": 1, "turn": 0, "play": 0}
    constant_identified().network.save(folder / "undamped.npz", lacking)
    (folder / "arm.npz").write_bytes((models_dir() / "qs_nn.npz").read_bytes())
    return folder


def written(folder):
    """All files but hidden ones and compiled modules."""
    return sorted(p for p in folder.rglob("[!.]*") if p.is_file() and p.suffix != ".pyc")


@pytest.mark.parametrize(("words", "reason"), CALLS)
def test_what_cannot_be_is_refused_in_one_line(words, reason, files, capsys, monkeypatch):
    pytest.importorskip(NEEDS.get(words.split()[0], "numpy"))
    monkeypatch.chdir(files)
    monkeypatch.setitem(sys.modules, "ray", None)  # as if it were not installed
    before = written(files)
    with writes.outside(files) as elsewhere, within(60.0):
        try:
            status = main(words.split(" "))
        except SystemExit as stop:
            status = stop.code
    (line,) = capsys.readouterr().err.splitlines()
    assert status == 2 and reason in line and line.isprintable()
    assert before == written(files) and not elsewhere


@pytest.mark.parametrize(("policy", "reason"), OUTSIDE)
def test_code_from_outside_that_fails_is_told_in_one_line(
    policy, reason, files, capsys, monkeypatch
):
    monkeypatch.chdir(files)
    before = written(files)
    tasks = "" if "--tasks" in policy else "--tasks reach"
    assert main(f"evaluate {FINGER} --policies {policy} {tasks}".split()) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("softrobot evaluate: ") and reason in line
    assert before == written(files)


def test_writes_elsewhere_are_found(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    with writes.outside(inner) as found:
        (inner / "a").write_text("")
        (inner / "a").rename(tmp_path / "b")
        (inner / ".." / "c").touch()
        (tmp_path / "b").read_text()
    assert {path.name for path in found} == {"b", "c"}


def test_a_library_without_pictures_is_told_in_one_line(capsys, monkeypatch):
    """PyOpenGL says no more where OSMesa is asked for and missing."""

    def lacking(_):
        raise AttributeError("'NoneType' object has no attribute 'glGetError'")

    monkeypatch.setattr("softrobot_env.cli.build_parser", lacking)
    assert main(["list"]) == 2
    assert "MUJOCO_GL can be egl, osmesa or glfw" in capsys.readouterr().err
