"""The command line in tests."""

import json

import pytest

from softrobot_env.cli import main
from softrobot_env.core import runs

#: A file with a task and policies of one's own.
MINE = """
import numpy as np
from softrobot_env.tasks import SetPoints, Task

def stay(robot, seconds=0.2):
    points = SetPoints(((0.0, 0.0, robot.reach),), float(seconds))
    return Task("stay", robot, points, float(seconds), (0.0, 0.0))

class P:
    def __init__(self, robot, control_period): pass
    def act(self, observation): return np.full_like(observation["previous_action"], 0.2)

class Q(P):
    environment = {"control_period": 0.05}

def hold(robot, control_period): pass

def needs_head(robot, control_period):
    if robot.head is None:
        raise ValueError("needs_head needs a robot with a head")
"""


def called(*words):
    """Exit status of `softrobot` with words, which may be several in a text."""
    return main(" ".join(map(str, words)).split())


def stopped_after(count, *words):
    """Stop a command by Ctrl-C after so many results, of which nothing is lost."""
    found, arriving = [], runs._arriving

    def stopping(*args):
        for one in arriving(*args):
            found.append(one)
            yield one
            if len(found) == count:
                raise KeyboardInterrupt

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runs, "_arriving", stopping)
        assert called(*words) == 130


#: What of a row depends on the machine.
TIMES = ("policy_time_median", "policy_time_p99", "realtime_factor", "minutes")


def rows_in(folder, without=()):
    """Rows of the report in a folder, but for some of their fields."""
    rows = json.loads((folder / "report.json").read_text())["rows"]
    return [{name: row[name] for name in row if name not in without} for row in rows]


def evaluated(out, *words):
    """Rows of `softrobot evaluate` with words, which goes well and writes to a folder."""
    assert called("evaluate", *words, "--out", out, "--overwrite") == 0
    return rows_in(out)
