"""A robot alive: in a window under a virtual display, in a browser of this machine, or refused."""

import os
import re
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from dataclasses import replace

import pytest
from support.processes import finished, python

from softrobot_env.cli import main
from softrobot_env.robots import find_robot
from softrobot_env.robots.file import write_robot


def test_without_display_there_is_one_line(monkeypatch, capsys):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    if sys.platform != "linux":
        pytest.skip("other systems always have a display")
    assert main(["view", "--task", "swing"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "display" in line and "--web" in line


def test_the_port_of_the_browser_can_be_chosen(monkeypatch):
    served = []
    monkeypatch.setattr("softrobot_env.commands.view._browse", lambda _, port: served.append(port))
    assert main(["view", "--web", "--port", "8123"]) == 0
    assert served == [8123]


def own_address():
    """An address of this machine that is not the loopback's, None without one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
        except OSError:
            return None
        found = probe.getsockname()[0]
    return None if found.startswith("127.") else found


_WEB = "from softrobot_env.cli import main; main(['view', '--robot', 'planar_finger', '--web'])"


def status_of(address, seconds=20.0):
    """Of a page, whose address is printed a moment before it is served."""
    end = time.monotonic() + seconds
    while True:
        try:
            with urllib.request.urlopen(address, timeout=seconds) as page:
                return page.status
        except urllib.error.URLError:
            if time.monotonic() > end:
                raise
            time.sleep(0.1)


@pytest.mark.slow
def test_the_browser_is_served_on_this_machine_alone(tmp_path):
    pytest.importorskip("mujoco.studio.launch_web")
    both = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with python(_WEB, cwd=tmp_path, **both) as running:
        reported = ""
        while (found := re.search(r"http://127\.0\.0\.1:(\d+)/", reported)) is None:
            line = running.stdout.readline()
            assert line, reported
            reported += line
        assert "no authentication" in reported
        port = int(found[1])
        assert status_of(f"http://127.0.0.1:{port}/") == 200
        if (address := own_address()) is not None:
            with socket.socket() as other:
                assert other.connect_ex((address, port)) != 0


@pytest.fixture
def display(monkeypatch):
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    read, write = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write), "-screen", "0", "800x600x24"],
        pass_fds=[write],
        stderr=subprocess.DEVNULL,
    )
    os.close(write)
    with os.fdopen(read) as reported:
        number = reported.readline().strip()
    monkeypatch.setenv("DISPLAY", f":{number}")
    yield
    server.terminate()
    server.wait()


_BY_HAND = """
import sys
import numpy as np
from softrobot_env.cli import main
from softrobot_env.envs import rendering as renderer

frames, tips = 0, []
draw = renderer.WindowRenderer.draw

def counted(window, frame):
    global frames
    draw(window, frame)
    frames += 1
    tips.append(window._view._tip.copy())
    if frames == 10:  # the window is fully open
        window.controls[:] = 0.5 * window._view.model.actuator_ctrlrange[:, 1] * np.arange(
            window.controls.size)
    if frames == 60:
        window._on_key(32)
        assert window.paused
        window._on_key(32)
        window._window.close()

renderer.WindowRenderer.draw = counted
status = main(["view", *sys.argv[1:]])
print("moved", float(np.linalg.norm(tips[-1] - tips[0])), "frames", frames)
sys.exit(status)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["--task", "swing"],
        ["--robot", "planar_finger"],
        ["--task", "triangle"],
        ["--task", "swing", "--policy", "feedforward_pi"],
    ],
    ids=" ".join,
)
def test_the_window_shows_the_robot_move(words, display, tmp_path):
    done = finished("-c", _BY_HAND, *words, timeout=180)
    assert done.returncode == 0, done.stderr
    assert float(re.search(r"moved (\S+)", done.stdout)[1]) > 1e-3, done.stdout


_RUBBING = """
from softrobot_env.cli import main
from softrobot_env.commands import view
from softrobot_env.envs.rendering import WindowRenderer

frames, seen = 0, []
draw, change = WindowRenderer.draw, view.set_coefficient

def changed(model, coefficient):
    change(model, coefficient)
    seen.append((coefficient, float(model.tendon_user[0, 0])))

def counted(window, frame):
    global frames
    draw(window, frame)
    frames += 1
    if frames == 5:
        window._view.data.ctrl[-1] = 0.4
    if frames == 20:
        window._window.close()

view.set_coefficient, WindowRenderer.draw = changed, counted
assert main(["view", "--robot", "rubbing.toml"]) == 0
print(seen[0], seen[-1])
"""


@pytest.mark.slow
def test_there_is_a_slider_for_the_friction_of_tendons(display, tmp_path):
    finger = find_robot("planar_finger")
    tendons = tuple(replace(t, friction_coefficient=0.1) for t in finger.tendons)
    write_robot(replace(finger, tendons=tendons, name="rubbing"), tmp_path / "rubbing.toml")
    found = finished("-c", _RUBBING, cwd=tmp_path, timeout=180)
    assert found.returncode == 0, found.stderr
    assert found.stdout.splitlines()[-1] == "(0.1, 0.1) (0.4, 0.4)"
