"""Hands as policies: a gamepad and sliders that are made up, on robots that are simulated."""

import runpy
import sys
from contextlib import closing
from pathlib import Path
from queue import SimpleQueue
from threading import Event
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest

import softrobot_env  # noqa: F401  # registers the environments
from softrobot_env.control.registry import make_policy
from softrobot_env.envs.recording import RecordEpisodes
from softrobot_env.recordings import read_recording
from softrobot_env.robots import find_robot

FILE = Path(__file__).resolve().parents[1] / "examples" / "teleoperation.py"
HANDS = SimpleNamespace(**runpy.run_path(str(FILE)))


class Pad:
    """A gamepad whose sticks a test moves."""

    def __init__(self):
        self._queue = SimpleQueue()

    def push(self, **sticks):
        read = Event()
        self._queue.put([SimpleNamespace(code=k, state=v) for k, v in sticks.items()])
        self._queue.put(read)
        assert read.wait(5)

    def unplug(self):
        self._queue.put(OSError("No such device"))

    def __call__(self):
        found = self._queue.get()
        if isinstance(found, Event):
            found.set()
            return []
        if isinstance(found, Exception):
            raise found
        return found


@pytest.mark.parametrize("name", ["silicone_rod", "ftdcr_v4", "arm", "planar_finger"])
def test_a_stick_to_the_right_pulls_what_lies_there(name):
    robot, pad = find_robot(name), Pad()
    hand = HANDS.Gamepad(robot, pad)
    assert not hand.act({}).any()
    pad.push(ABS_X=1000, ABS_Y=-900)  # at rest a stick is not quite in the middle
    assert not hand.act({}).any()
    pad.push(ABS_X=32767, ABS_Y=0, ABS_BRAKE=200)
    pulled = hand.act({}) @ HANDS.pulled(robot)
    ends = np.array([tendon.end for tendon in robot.tendons])
    across = np.array([tendon.offset[0] for tendon in robot.tendons])
    first = ends < ends.min() + 1e-9
    assert pulled @ across > 0 and not np.abs(pulled[~first]).max(initial=0) > 1e-9
    pad.push(ABS_X=0, ABS_RX=-32768)
    if not first.all():
        assert (hand.act({}) @ HANDS.pulled(robot))[~first] @ across[~first] < 0


def test_a_gamepad_that_is_unplugged_ends_it():
    pad = Pad()
    hand = HANDS.Gamepad(find_robot("silicone_rod"), pad)
    pad.push(ABS_X=32767)
    pad.unplug()
    with pytest.raises(RuntimeError, match="the gamepad has gone: No such device"):
        while True:
            hand.act({})


@pytest.mark.parametrize("name", ["silicone_rod", "planar_finger"])
def test_sliders_are_actions(name):
    robot, shown = find_robot(name), SimpleNamespace(open=True)

    def launch(model, data):
        shown.model, shown.data = model, data
        return SimpleNamespace(sync=lambda: None, is_running=lambda: shown.open)

    hand = HANDS.Sliders(robot, launch)
    np.testing.assert_allclose(hand.act({}), 0.0, atol=1e-7)
    rest = shown.data.ctrl.copy()
    for k, pull in enumerate(HANDS.pulled(robot)):
        wanted = np.eye(len(HANDS.pulled(robot)))[k]
        shown.data.ctrl[:] = rest + 0.5 * pull
        np.testing.assert_allclose(hand.act({}), 0.5 * wanted, atol=1e-6)
    shown.open = False
    with pytest.raises(RuntimeError, match="closed"):
        hand.act({})


def test_a_hand_is_recorded(tmp_path, monkeypatch):
    """As by `softrobot evaluate --record`, which a real robot has too."""
    pad = Pad()
    monkeypatch.setitem(sys.modules, "inputs", SimpleNamespace(get_gamepad=pad))
    make = {"robot": "planar_finger", "task": "circle", "observe": "all"}
    env = RecordEpisodes(gymnasium.make("SoftRobot/Track-v0", **make), tmp_path / "hand.csv")
    with closing(env):
        hand = make_policy(f"{FILE}:gamepad", env)
        pad.push(ABS_X=16384)
        seen, _ = env.reset(seed=0)
        for _ in range(10):
            seen, *_ = env.step(hand.predict(seen)[0])
    recording = read_recording(tmp_path / "hand.csv")
    assert np.abs(recording.commands[-1]).max() > 0 and len(recording.times) >= 10
