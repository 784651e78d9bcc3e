"""`softrobot evaluate --env virtual|real` and `softrobot robot soak`."""

from argparse import Namespace
from contextlib import contextmanager
from dataclasses import replace

import pytest
from support.commands import called, evaluated, rows_in
from support.patience import patient_commands
from support.rig_identified_file import identified_file

from softrobot_env.commands.cases import RealSetup
from softrobot_env.commands.robot import virtual
from softrobot_env.commands.robot.soak import answer_times
from softrobot_env.envs.real import RealRigEnv
from softrobot_env.evaluation.report import VIRTUAL
from softrobot_env.evaluation.runner import Case
from softrobot_env.hardware.robot_file import rig_file
from softrobot_env.hardware.transport import read_link_log
from softrobot_env.tasks import make_task

pytest.importorskip("serial", reason="needs the robot extra")
pytest.importorskip("cobs", reason="needs the robot extra")


@pytest.fixture
def patient():
    """Virtual robots and their environments wait for a busy machine."""
    with patient_commands():
        yield


@pytest.mark.realtime(late=0.9)
@pytest.mark.usefixtures("patient")
def test_a_policy_runs_on_a_virtual_robot(tmp_path, capsys):
    out, record = tmp_path / "out", tmp_path / "links"
    identified = identified_file(tmp_path / "identified.npz", twin=0)
    words = "--tasks reach --option hold=0.1 --option radius=0.03 --policies hybrid --env virtual"
    (row,) = evaluated(out, words, "--record", record, "--identified", identified)
    assert (row["source"], row["plant"], row["twin"]) == ("real", "virtual", 0)
    assert row["failure"] is None and row["identified"] == "twin 0"
    said = capsys.readouterr().out
    assert "virtual twin 0" in said and "other rigs differ" not in said
    # The episode, and the short one before it that warms up.
    links = [read_link_log(path) for path in sorted(record.glob("*.link"))]
    assert links and all(link.complete for link in links)


@pytest.fixture
def ended(monkeypatch):
    """A virtual robot's process that does nothing; says whether it has ended."""
    ended = []

    @contextmanager
    def process(twin):
        try:
            yield Namespace(file=rig_file(), tip=None)
        finally:
            ended.append(twin)

    monkeypatch.setattr(virtual, "virtual_process", process)
    return ended


def virtual_env(task):
    setup = RealSetup(Namespace(env=VIRTUAL, record=None, twin=[3]))
    return setup.environment(Case(task, "hybrid", twin=3))


def test_a_virtual_robot_ends_even_if_it_cannot_be_ramped_down(ended, monkeypatch):
    def close(env):
        raise KeyboardInterrupt

    env = virtual_env(make_task("reach"))
    assert not ended
    monkeypatch.setattr(RealRigEnv, "close", close)
    with pytest.raises(KeyboardInterrupt):
        env.close()
    assert ended == [3]


def test_a_virtual_robot_ends_if_its_environment_is_refused(ended):
    with pytest.raises(ValueError, match="length zero"):
        virtual_env(replace(make_task("reach"), start_input=(0.001, 0.0, 0.0)))
    assert ended == [3]


def test_no_robot_at_the_port(tmp_path, capsys):
    words = "--tasks reach --policies hybrid --env real --port /dev/no_robot --no-plots --out"
    assert called("evaluate", words, tmp_path) == 1
    assert "/dev/no_robot" in capsys.readouterr().out.replace("\n", "")


@pytest.mark.slow
@pytest.mark.realtime(late=0.9)
@pytest.mark.usefixtures("patient")
def test_a_short_soak_says_what_it_measured(tmp_path):
    called("robot soak --seconds 3 --out", tmp_path)
    row, *promises = rows_in(tmp_path)
    assert row["failure"] is None and row["steps"] == 150
    assert row["ticks"] > 1000 and row["unsafe_outputs"] == 0
    # The others need a machine with nothing else to do.
    met = {promise["promise"]: promise["met"] for promise in promises}
    assert met["failures"] and met["unsafe outputs"]


def test_a_step_without_an_answer_waits_for_the_next_one():
    """And a robot that never answers is slower than a period."""
    found = answer_times([0.01, None, None, 0.015], 0.02)
    assert found == pytest.approx([0.01, 0.055, 0.035, 0.015])
    assert min(answer_times([None, None], 0.02)) > 0.02
