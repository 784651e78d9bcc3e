"""The twelve tasks of docs/howto/twelve_tasks.md work as they stand there, in twenty lines each."""

import re
import shlex
from pathlib import Path

import pytest

from softrobot_env.cli import main
from softrobot_env.envs.observations.table import OBSERVABLES
from softrobot_env.robots import read_robot

PAGE = Path(__file__).resolve().parents[2] / "docs" / "howto" / "twelve_tasks.md"
TASKS = PAGE.read_text().split("\n## ")[1:]
#: Opens a window or a server, and does not end by itself.
ENDLESS = ("softrobot", "view")


def blocks(task):
    """Language and text of each block of code."""
    return re.findall(r"^```(\w+)\n(.*?)^```", task, re.M | re.S)


def lines(text):
    return [line for line in text.splitlines() if line.strip()]


def test_there_are_twelve_and_they_are_short():
    assert len(TASKS) == 12
    lengths = {task.splitlines()[0]: sum(len(lines(b)) for _, b in blocks(task)) for task in TASKS}
    assert {name: length for name, length in lengths.items() if not 0 < length <= 20} == {}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:robot 'taper'")
def test_they_work(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    known = {}
    for task in TASKS:
        named = re.search(r"Save this as `(\S+)`", task)
        for language, text in blocks(task):
            if named and language in ("toml", "python"):
                (tmp_path / named[1]).write_text(text)
            if language == "python":
                exec(compile(text, task.splitlines()[0], "exec"), known)
            commands = lines(text) if language == "bash" else []
            for words in (shlex.split(line, comments=True) for line in commands):
                if tuple(words[:2]) != ENDLESS:
                    assert main(words[1:]) == 0, words
    del OBSERVABLES.registered()["height"]
    for name in ("taper.gif", "finger.gif", "out/taper/workspace_taper.png", "out/taper/taper.xml"):
        assert (tmp_path / name).stat().st_size > 1000
    assert known["scene"].contacts(known["moved"].end, known["pull"])
    found = read_robot(tmp_path / "out" / "identified" / "robot.toml")
    assert found.backbone.sections[0].youngs_modulus == pytest.approx(0.8 * 5e5, rel=0.1)
