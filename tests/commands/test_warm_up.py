"""Compilation ahead, and what is said of one that takes long."""

import os
import re
import subprocess
import sys
import time

import pytest

from softrobot_env.cli import main
from softrobot_env.machine_code.notice import Notice


def test_unknown_names_are_refused(capsys):
    assert main(["warm-up", "nothing_like_it"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "pcc" in line and "lq_adaptive" in line


def test_long_compilations_are_told_once_they_are_long(capsys, monkeypatch):
    from softrobot_env.machine_code import notice

    monkeypatch.setattr(notice, "_PATIENCE", 0.05)
    monkeypatch.setattr(notice, "_watched", lambda: True)
    listener = Notice()
    listener.on_start(None)
    listener.on_end(None)
    time.sleep(0.15)
    assert capsys.readouterr().err == ""
    listener.on_start(None)
    listener.on_start(None)
    listener.on_end(None)
    time.sleep(0.3)
    listener.on_end(None)
    assert re.fullmatch(r"compiling \(once, .*2 functions\n", capsys.readouterr().err)
    assert listener.count == 3


_COUNT = """
from softrobot_env.commands.warm_up import warm
from softrobot_env.machine_code.notice import NOTICE
warm("hold")
print(NOTICE.count)
"""


@pytest.mark.slow
def test_what_was_warmed_up_is_not_compiled_again(tmp_path):
    places = dict.fromkeys(("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"), str(tmp_path))
    environment = {**os.environ, **places}
    command = [sys.executable, "-m", "softrobot_env", "warm-up", "mujoco", "hold"]
    subprocess.run(command, env=environment, check=True, timeout=300)
    done = subprocess.run(
        [sys.executable, "-c", _COUNT], env=environment, capture_output=True, text=True, check=True
    )
    assert int(done.stdout) == 0
