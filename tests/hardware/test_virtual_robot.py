"""`softrobot robot virtual`: its link, its robot file, and its end with whoever started it."""

import os
import subprocess
import time
from pathlib import Path

import pytest
from support.processes import python

from softrobot_env.hardware.virtual_robot import linked

pytest.importorskip("serial", reason="needs the robot extra")
pytest.importorskip("cobs", reason="needs the robot extra")


@pytest.fixture
def ports(tmp_path):
    made = tmp_path / "one", tmp_path / "other"
    for port in made:
        port.touch()
    return made


def test_a_link_lasts_as_long_as_its_context_and_is_not_anothers(tmp_path, ports):
    link, (one, other) = tmp_path / "folder" / "robot", ports
    with linked(str(one), link) as name:
        assert name == str(link)
        refused = pytest.raises(FileExistsError, match="another virtual robot")
        with refused, linked(str(other), link):
            pass
        assert link.readlink() == one
    assert not link.is_symlink()


def test_the_link_of_a_robot_that_was_killed_is_replaced(tmp_path, ports):
    link = tmp_path / "robot"
    link.symlink_to(tmp_path / "gone")
    with linked(str(ports[0]), link):
        assert link.readlink() == ports[0]


def test_a_link_that_now_leads_elsewhere_stays(tmp_path, ports):
    link, (one, other) = tmp_path / "robot", ports
    with linked(str(one), link):
        link.unlink()
        link.symlink_to(other)
    assert link.readlink() == other


def test_a_file_is_not_replaced(ports):
    with pytest.raises(FileExistsError), linked("port", ports[0]):
        pass


PARENT = """
from time import sleep
from softrobot_env.commands.robot.virtual import virtual_process

with virtual_process(0) as robot:
    print(robot.file.port, robot.process.pid, flush=True)
    sleep(60)
"""


def test_it_ends_with_a_parent_that_is_killed(tmp_path):
    where = os.environ | {"TMPDIR": str(tmp_path)}
    with python(PARENT, stdout=subprocess.PIPE, text=True, env=where) as parent:
        link, process = parent.stdout.readline().split()
        assert Path(link).exists()
        # Ctrl-C in a terminal goes to all processes of a group.
        assert os.getpgid(int(process)) != os.getpgid(parent.pid)
    end = time.monotonic() + 30
    while Path(link).is_symlink():
        assert time.monotonic() < end
        time.sleep(0.02)
