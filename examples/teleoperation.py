"""Manual control of any robot, real or not: policies by a gamepad, or sliders in MuJoCo's viewer:

    softrobot evaluate --robot trunk.toml --env real --tasks reach --record out/by_hand \\
        --policies examples/teleoperation.py:gamepad
"""

from dataclasses import replace
from threading import Thread

import numpy as np
from mujoco import MjData

from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import visible
from softrobot_env.scene.registry import scene_of

STICKS = ("ABS_X", "ABS_Y", "ABS_RX", "ABS_RY")  # of the package `inputs`
FULL, DEAD = 32768.0, 0.08  # counts of a stick, and its dead zone as a share


class Gamepad:
    """Sections bend in the direction of a stick, those nearest to the base by the left one."""

    def __init__(self, robot, read):
        self._read, self._sticks, self._failure = read, dict.fromkeys(STICKS, 0.0), None
        offsets, ends = np.array([t.offset for t in robot.tendons]), [t.end for t in robot.tendons]
        pulls = pulled(robot)
        self._towards = np.zeros((len(pulls), len(STICKS)))
        for row, pull in zip(self._towards, pulls, strict=True):
            stick = 0 if ends[np.abs(pull).argmax()] < min(ends) + 1e-9 else 2
            way = pull @ offsets
            row[stick : stick + 2] = way / np.linalg.norm(way)
        Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        try:
            while True:
                for event in self._read():
                    if event.code in self._sticks:
                        self._sticks[event.code] = event.state / FULL
        except Exception as error:  # raised in the main thread, which stops a real robot
            self._failure = error

    def act(self, observation):
        if self._failure is not None:
            raise RuntimeError(f"the gamepad has gone: {self._failure}")
        sticks = np.array([x if abs(x) > DEAD else 0.0 for x in self._sticks.values()])
        return np.clip(self._towards @ sticks, -1, 1).astype(np.float32)


class Sliders:
    """The robot at rest, and a slider for each tendon; closing the window ends the episode."""

    def __init__(self, robot, launch):
        inputs = robot_inputs(robot).per_action()
        self._rest, self._pulled = inputs.command(np.zeros(inputs.n_inputs)), pulled(robot)
        config = replace(visible(scene_of(robot)), timestep=None, integrator="discrete")
        model = build_scene(config).model
        self._data = MjData(model)
        self._data.ctrl[:] = self._rest
        model.actuator_ctrlrange[:, 1] = self._rest + 2 * np.abs(self._pulled).max(0)
        self._window = launch(model, self._data)

    def act(self, observation):
        self._window.sync()
        if not self._window.is_running():
            raise RuntimeError("the window was closed")
        moved = self._data.ctrl - self._rest
        action = np.linalg.lstsq(self._pulled.T, moved, rcond=None)[0]
        return np.clip(action, -1, 1).astype(np.float32)


def pulled(robot):
    """(inputs, tendons) [N or m], half the difference between the pulls at the actions 1 and -1."""
    inputs = robot_inputs(robot).per_action()
    each = np.eye(inputs.n_inputs)
    return (inputs.command(each) - inputs.command(-each)) / 2


def gamepad(robot, control_period):
    from inputs import get_gamepad  # pip install inputs

    return Gamepad(robot, get_gamepad)


def sliders(robot, control_period):
    from mujoco.viewer import launch_passive

    return Sliders(robot, launch_passive)
