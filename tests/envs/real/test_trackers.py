"""Whole episodes of a real robot: emulated motors, and a tracker that shows what they do.

The tip is where the motors' lengths put it by a linear map, which nobody but the sender knows.
"""

from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from threading import Event, Lock, Thread
from time import monotonic, sleep

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.hardware_boards import LiveBoard
from support.motor_bench import Motors
from support.real_episodes import PATIENT

from softrobot_env.commands.robot.virtual import motors_of
from softrobot_env.hardware.robot_file import Tip
from softrobot_env.robots import RIG
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.tasks import SetPoints, Task

pytest.importorskip("serial", reason="needs the robot extra")
pytest.importorskip("dynamixel_sdk", reason="needs the robot extra")

pytestmark = [pytest.mark.realtime(late=0.4), pytest.mark.usefixtures("patience")]

#: Of the tip [m] by the lengths [m] of the three motors.
MAP = np.array([[2.0, -1.0, -1.0], [0.0, 1.5, -1.5]])
#: Of all motors at once, so that the tip goes along a line.
PULL = np.array([0.3, -0.3, 0.3], np.float32)
PICTURES = 12
FARTHEST = 0.3 * float(robot_inputs(RIG).input_scale[0])  # m, of a length
STILL = Rotation.from_rotvec([0.4, -0.45, 0.3])
TASK = Task("stay", RIG, SetPoints(((0.0, 0.0, RIG.reach),), 0.5), 0.5, (0.0,) * 3, axes="xy")


class Shown:
    """Where the motors put the tip, at the time of a picture."""

    def __init__(self, motors):
        self._motors, self._past, self._lock = motors, [], Lock()

    def now(self, grain=None):
        """The tip now, or the nearest of so many points of its line, and the point's number."""
        lengths, number = self._motors.device.applied, 0
        if grain is not None:
            number = round(grain * min(1.0, max(0.0, lengths[0] / FARTHEST)))
            lengths = number / grain * FARTHEST * np.sign(PULL)
        tip = MAP @ lengths
        with self._lock:
            self._past.append((monotonic(), *tip))
        return tip, number

    def at(self, time):
        with self._lock:
            times, *places = np.array(self._past).T
        return np.array([np.interp(time, times, place) for place in places])


@contextmanager
def natnet(shown):
    """Motive with a rigid body at the tip, a hundred times a second."""
    from studies.truths.natnet_packets import Motive

    over, turn = Event(), tuple(STILL.as_quat().tolist())
    with closing(Motive((4, 1), {"tip": 12})) as server:

        def send():
            while not over.wait(0.01):
                if server._client is not None:
                    server.show([(12, (*shown.now()[0].tolist(), 0.2), turn, True)])

        thread = Thread(target=send, daemon=True)
        thread.start()
        options = {"server": "127.0.0.1", "host": "127.0.0.1", "port": server.port}
        try:
            yield Tip("natnet", options | {"multicast": "", "head": {"tip": [0, 0, 0]}}), over
        finally:
            over.set()
            thread.join()


@contextmanager
def tags(shown, folder):
    """A camera that sees a tag at the tip, half a metre away."""
    pytest.importorskip("cv2", reason="needs the camera extra")
    from softrobot_env.hardware.camera import Camera, tag_sheet, write_camera
    from studies.truths.tag_images import FACING, Lens, picture, pose

    lens, rng, over = (
        Lens((640, 480), (800.0, 800.0), (320.0, 240.0)),
        np.random.default_rng(0),
        Event(),
    )
    write_camera(Camera(lens.size, lens.focal, lens.center, lens.bend), folder / "camera.toml")
    cells = tag_sheet(7)[150:-90:60, 150:-90:60] > 127

    images = []
    for k in range(PICTURES + 1):
        tip = k / PICTURES * FARTHEST * MAP @ np.sign(PULL)
        where = pose((*tip, 0.5), FACING * STILL)
        images.append(picture(lens, {"head": (cells, 0.04 / 8, where)}, rng))

    def take():
        sleep(0.02)
        if over.is_set():
            raise TimeoutError
        time = monotonic()
        return time, images[shown.now(PICTURES)[1]]

    options = {"camera": str(folder / "camera.toml"), "size": 0.04, "device": take}
    yield Tip("tags", options | {"head": {7: [0, 0, 0]}, "world": [0, 0, -0.5]}), over
    over.set()


@pytest.fixture(params=["natnet", "tags"])
def running(request, tmp_path):
    """An environment of `SoftRobot/Real-v0`, where the tip is shown, and what ends the tracker."""
    file = motors_of("dynamixel", RIG, "/dev/motors")
    file = replace(file, slew=0.02, watchdog=1.0, patience=2.0, latency=0.03)
    with ExitStack() as stack:
        live = stack.enter_context(LiveBoard(Motors(file, look=0.02)))
        shown = Shown(live.board)
        sender = natnet(shown) if request.param == "natnet" else tags(shown, tmp_path)
        tip, over = stack.enter_context(sender)
        options = PATIENT | {"oldest": 0.4}
        env = gymnasium.make(
            "SoftRobot/Real-v0",
            task=TASK,
            robot_file=replace(file, tip=tip),
            line=lambda: live.transport,
            **options,
        )
        stack.enter_context(closing(env))
        yield env, shown, over, request.param


def test_an_episode_sees_what_the_tracker_shows(running):
    env, shown, over, kind = running
    within = {"natnet": 1e-4, "tags": 1e-3}[kind]
    env.reset()
    truncated, steps = False, 0
    while not truncated:
        seen, _, terminated, truncated, info = env.step(PULL)
        steps += 1
        assert not terminated and "failure" not in info, info.get("failure")
        taken = env.unwrapped._tip.time
        off = np.abs(seen["tip_position"] - shown.at(taken)).max()
        assert off < within
    assert steps + info["missed_steps"] == 25 and info["tip_refused"] == 0
    assert np.linalg.norm(seen["tip_position"]) > 5e-3
    env.reset()
    over.set()  # the tracker shows nothing more
    end = monotonic() + 3.0
    while not truncated or "failure" not in info:
        *_, truncated, info = env.step(PULL)
        assert monotonic() < end
    assert "the tip source is" in info["failure"]
