"""Pictures and videos: what is drawn, which OpenGL is used, and what is said when none works."""

import builtins
import copy
import os
import pickle
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from support.processes import finished

from softrobot_env.control.registry import make_policy
from softrobot_env.envs import rendering as opengl
from softrobot_env.envs.gripper import GripperEnv
from softrobot_env.envs.rendering import RenderError, candidate_backends
from softrobot_env.rendering import video
from softrobot_env.rendering.video import caption, record, write_video

ROOT = Path(__file__).resolve().parents[2]
SWING, STEP, LSHAPE = "SoftRobot/ArmSwing-v0", "SoftRobot/ArmStep-v0", "SoftRobot/ArmLShape-v0"
SIZE = {"width": 320, "height": 240}

# In a process of its own: the choice of a backend cannot be taken back.
_PROBE = """
import softrobot_env, gymnasium
from softrobot_env.core import under_way
under_way.SPEAKS = False
env = gymnasium.make("SoftRobot/ArmStep-v0", render_mode="rgb_array", width=64, height=48).unwrapped
env.reset()
env.render()
print(type(env._renderer._context._gl).__module__.removeprefix("mujoco."))
"""


def probe(**environment):
    """Backend a fresh process draws with, and what it wrote to stderr."""
    keep = {"PATH": "/usr/bin:/bin", "PYTHONPATH": str(ROOT), **environment}
    done = finished("-c", _PROBE, env=keep)
    return done.stdout.strip(), done.stderr


@pytest.fixture(scope="module")
def backend():
    """Name of the backend this machine draws with."""
    name, error = probe()
    last = "".join(error.strip().splitlines()[-1:])
    if "RenderError" in last:
        pytest.skip(f"no OpenGL on this machine: {last}")
    assert name and not error  # at exit too, where a renderer was forgotten
    return name


@pytest.fixture
def make_drawn(make_env, backend):
    """Factory of small environments that draw arrays."""

    def make(env_id=SWING, **kwargs):
        env = make_env(env_id, **{"render_mode": "rgb_array", **SIZE, **kwargs})
        env.reset(seed=0)
        return env

    return make


def count_like(frame, rgb, tolerance=60):
    """Number of pixels whose colour is near (r, g, b)."""
    return int(np.sum(np.abs(frame.astype(int) - rgb).max(axis=2) < tolerance))


def advance(env, seconds, action=None):
    action = np.zeros(3, np.float32) if action is None else action
    for _ in range(round(seconds / env.control_period)):
        env.step(action)


GREEN, BLUE, RED = (25, 195, 90), (25, 100, 250), (140, 25, 50)


# ---------------------------------------------------------------------------- frames


@pytest.mark.parametrize(("width", "height"), [(320, 240), (241, 133), (1300, 700)])
def test_frame_has_the_asked_size_and_is_not_blank(make_drawn, width, height):
    frame = make_drawn(width=width, height=height).render()
    assert frame.shape == (height, width, 3) and frame.dtype == np.uint8
    assert frame.std() > 10


def test_frames_follow_the_simulation_and_do_not_touch_it(make_drawn):
    env, blind = make_drawn(), make_drawn()
    first = env.render()
    assert np.array_equal(first, env.render())
    for each in (env, blind):
        advance(each, 0.3)
    np.testing.assert_array_equal(env.data.qpos, blind.data.qpos)
    assert np.mean(np.any(first != env.render(), axis=2)) > 0.02
    env.reset(seed=0)
    assert np.array_equal(first, env.render())


def test_target_is_drawn_where_the_reference_is(make_drawn):
    """The camera is orthographic: the green ring's centre maps linearly to x and z."""
    centers, references = [], []
    env = make_drawn(SWING, width=640, height=480)
    for time in (0.0, 2.0, 4.0):
        advance(env, 2.0 * (time > 0))
        green = np.abs(env.render().astype(int) - GREEN).max(axis=2) < 60
        rows, columns = np.nonzero(green)
        assert len(rows) > 50
        centers.append([(columns.min() + columns.max()) / 2, (rows.min() + rows.max()) / 2])
        references.append(env.task.trajectory.position(np.array([time]))[0, [0, 2]])
    moved, asked = np.diff(centers, axis=0), np.diff(references, axis=0)
    pixels_per_meter = moved[0, 0] / asked[0, 0]
    np.testing.assert_allclose(moved, asked * [1, -1] * pixels_per_meter, atol=2)


def test_trail_grows_and_is_cleared_by_reset(make_drawn):
    env = make_drawn()
    first = count_like(env.render(), BLUE)
    for _ in range(10):
        advance(env, 0.05)
        last = count_like(env.render(), BLUE)
    assert last > first + 30
    env.reset(seed=0)
    assert count_like(env.render(), BLUE) == first


def test_tight_tendons_turn_red(make_drawn):
    env = make_drawn()
    env.reset(options={"start_input": np.zeros(3)})
    assert count_like(env.render(), RED, 40) == 0
    env.reset(options={"start_input": np.full(3, 8.0)})
    slightly = count_like(env.render(), RED, 40)
    env.reset(options={"start_input": np.array([-40.0, 20.0, 30.0])})
    assert count_like(env.render(), RED, 40) > slightly


def body_of(frame):
    """(height, width) bool, pixels of a robot's yellow or orange, which nothing else is of."""
    picture = frame.astype(int)
    return picture[..., 0] - picture[..., 2] > 60


def test_a_pulled_rig_is_seen_to_lean_to_the_right(make_drawn):
    env = make_drawn("SoftRobot/RigTriangle-v0")
    reached = []
    for seconds in (0.0, 0.8):
        advance(env, seconds, np.array([0.5, 0.0, 0.0], np.float32))
        columns = np.nonzero(body_of(env.render()))[1]
        assert len(columns) > 100
        reached.append(columns.max())
    assert reached[1] > reached[0] + 10


def test_the_mount_of_a_hanging_robot_hides_nothing_of_it(make_drawn):
    """The body shows as long as it is, but for what is lost by looking at it from below."""
    env = make_drawn("SoftRobot/Track-v0", robot="hanging_trunk", task="circle")
    rows = np.flatnonzero(body_of(env.render()).sum(axis=1) > 3)
    length = (rows[-1] - rows[0]) * env.metres_per_pixel
    assert length > np.cos(0.6) * env.task.robot.length, rows


def test_tendons_of_a_gripper_turn_red(backend):
    env = GripperEnv("enclose", render_mode="rgb_array", **SIZE)
    env.reset(seed=0)
    slack = count_like(env.render(), (190, 0, 25), 60)
    env.simulation.ctrl[:] = env.gripper.tension_limits
    assert count_like(env.render(), (190, 0, 25), 60) > slack
    seen = 1.6 * max(finger.robot.reach for finger in env.gripper.fingers)
    assert env.metres_per_pixel * SIZE["height"] == pytest.approx(seen)


def test_a_step_shows_no_line_between_its_ends(make_drawn):
    env = make_drawn(STEP, width=640, height=480)
    env.reset(options={"step_width": 0.2})
    assert env._frame().path.shape == (2, 3)
    grey = count_like(env.render(), (125, 128, 140), 20)  # thin lines blend with what is behind
    lshape = make_drawn(LSHAPE, width=640, height=480)
    assert count_like(lshape.render(), (125, 128, 140), 20) > grey + 100


def test_a_diverged_posture_still_draws(make_drawn):
    env = make_drawn()
    frame = env.render()
    env.data.qpos[0] = np.nan
    assert np.mean(np.any(env.render() != frame, axis=2)) < 0.01


# ---------------------------------------------------------------------------- life cycle


def test_copies_draw_for_themselves_and_all_draw_again_after_closing(make_drawn):
    env, other = make_drawn(), make_drawn(STEP, width=200, height=200)
    first, seen = env.render(), other.render()
    for each in (copy.deepcopy(env), pickle.loads(pickle.dumps(env)), env):
        for _ in range(2):
            np.testing.assert_array_equal(each.render(), first)
            each.close()
            each.close()
        np.testing.assert_array_equal(other.render(), seen)


# ---------------------------------------------------------------------------- backends


def test_candidates_follow_the_environment(monkeypatch):
    monkeypatch.setattr(opengl.platform, "system", lambda: "Linux")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setenv("MUJOCO_GL", "")
    assert candidate_backends() == ("egl", "osmesa")
    monkeypatch.setenv("DISPLAY", ":0")
    assert candidate_backends() == ("egl", "osmesa", "glfw")
    monkeypatch.setenv("MUJOCO_GL", "OSMesa")
    assert candidate_backends() == ("osmesa",)
    for useless in ("off", "vulkan"):
        monkeypatch.setenv("MUJOCO_GL", useless)
        with pytest.raises(RenderError, match=useless):
            candidate_backends()


def test_without_opengl_the_message_says_what_to_install(monkeypatch, make_env):
    def refuse(backend, *_):
        raise ImportError(f"no library for {backend}")

    monkeypatch.setattr(opengl, "_open", refuse)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    before = dict(os.environ)
    env = make_env(render_mode="rgb_array")
    env.reset(seed=0)
    with pytest.raises(RenderError, match="egl: no library for egl") as raised:
        env.render()
    assert dict(os.environ) == before
    for hint in ("apt-get install libegl1 libgl1-mesa-dri", "libosmesa6", "MUJOCO_GL"):
        assert hint in str(raised.value)
    assert isinstance(raised.value, RuntimeError)


def test_a_broken_egl_does_not_spoil_the_next_attempt():
    """Mesa's drivers are hidden from EGL; OSMesa does not ask for them."""
    hidden = {"__EGL_VENDOR_LIBRARY_DIRS": "/nonexistent"}
    if probe(MUJOCO_GL="osmesa") != ("osmesa", ""):
        pytest.skip("OSMesa is not installed")
    assert probe(**hidden) == ("osmesa", "")


def test_human_mode_needs_a_display(monkeypatch, make_env):
    monkeypatch.setattr(opengl.platform, "system", lambda: "Linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    env = make_env(render_mode="human")
    with pytest.raises(RenderError, match=r"display.*rgb_array"):
        env.reset(seed=0)


# Two views of a robot with its target beside it, and where the target should be seen.
_WINDOW = """
import sys, time
import numpy as np
from PIL import ImageGrab
from softrobot_env.envs.rendering import Frame, make_renderer
from softrobot_env.robots import find_robot
from softrobot_env.scene.registry import scene_of

config = scene_of(find_robot(sys.argv[1]))
window = make_renderer("human", config, (1, 1))
robot, shown = config.robot, window._window
target = robot.reach * np.array([0.4, float(sys.argv[2]), 0.7])
model = window._view.model
for azimuth, elevation in ((90.0, -20.0), (150.0, -35.0)):
    shown.cam.azimuth, shown.cam.elevation = azimuth, elevation
    tension = np.zeros(len(robot.tendons))
    for k in range(3):
        window.draw(Frame(1, 0.0, np.zeros(model.nq), tension, target, target[None]))
        time.sleep(0.3)
    picture = np.array(ImageGrab.grab().convert("RGB")).astype(int)
    view = shown.viewport
    picture = picture[: view.height, : view.width]
    rows, columns = np.nonzero(picture[..., 1] > 1.6 * picture[..., [0, 2]].max(axis=2))
    a, e = np.radians((azimuth, elevation))
    forward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([np.sin(a), -np.cos(a), 0.0])
    away = target - (shown.cam.lookat - shown.cam.distance * forward)
    scale = view.height / 2 / np.tan(np.radians(model.vis.global_.fovy) / 2) / (away @ forward)
    x = view.width / 2 + scale * (away @ right)
    y = view.height / 2 - scale * (away @ np.cross(right, forward))
    print(len(rows), columns.mean() - x, rows.mean() - y)
window.close()
"""


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "aside"), [("arm", 0.0), ("rig", 0.3)])
def test_a_window_shows_the_target_where_it_is_from_every_side(robot, aside):
    if shutil.which("Xvfb") is None:
        pytest.skip("Xvfb is not installed")
    pytest.importorskip("PIL")
    with subprocess.Popen(
        ["Xvfb", "-displayfd", "1", "-screen", "0", "1280x960x24"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as display:
        number = display.stdout.readline().strip()
        keep = {"PATH": "/usr/bin:/bin", "PYTHONPATH": str(ROOT), "DISPLAY": f":{number}"}
        done = finished("-c", _WINDOW, robot, str(aside), env=keep)
        display.terminate()
    assert done.returncode == 0, done.stderr
    for line in done.stdout.splitlines():
        pixels, right, down = map(float, line.split())
        assert pixels > 20 and abs(right) < 3 and abs(down) < 3, done.stdout
    assert len(done.stdout.splitlines()) == 2


# ---------------------------------------------------------------------------- videos


def moving_square(count, height=64, width=80):
    frames = np.full((count, height, width, 3), 255, np.uint8)
    for i in range(count):
        frames[i, 20:40, i : i + 20] = (255, 0, 0)
    return frames


def read_video(path):
    """Frames (n, height, width, 3) and frames per second of a video file."""
    imageio = pytest.importorskip("imageio.v3")
    if path.suffix == ".gif":
        frames = imageio.imread(path, plugin="pillow", mode="RGB")
        return frames, 1000 / imageio.immeta(path, plugin="pillow")["duration"]
    # imageio's own reader of mp4 files leaves its pipes to the garbage collector.
    ffmpeg = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    command = [ffmpeg, "-i", str(path), "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    done = subprocess.run(command, capture_output=True, check=True)
    about = re.search(rb"Video: h264.* yuv420p.*, (\d+)x(\d+).*, ([\d.]+) fps", done.stderr)
    width, height, fps = (float(x) for x in about.groups())
    frames = np.frombuffer(done.stdout, np.uint8).reshape(-1, int(height), int(width), 3)
    return frames, fps


@pytest.mark.parametrize(
    ("name", "size"),
    [*((name, (64, 80)) for name in ("a.mp4", "folder/b.gif", "c.MP4")), ("odd.mp4", (65, 81))],
)
def test_video_has_every_frame_in_even_sizes(tmp_path, name, size):
    drawn = moving_square(12, *size)
    assert write_video(tmp_path / name, drawn, fps=25) == 12
    frames, fps = read_video(tmp_path / name)
    assert fps == 25
    assert frames.shape == (12, 64, 80, 3)
    assert np.abs(frames[-1].astype(int) - drawn[-1, :64, :80]).mean() < 5


@pytest.mark.parametrize(
    ("name", "count", "fps", "allowed"),
    [
        *((name, 1, 30, r"\.mp4 or \.gif") for name in ("video.avi", "video")),
        ("a.mp4", 0, 30, "no frames"),
        ("a.mp4", 1, 0, "fps"),
    ],
)
def test_videos_that_cannot_be_are_refused(tmp_path, name, count, fps, allowed):
    with pytest.raises(ValueError, match=allowed):
        write_video(tmp_path / name, moving_square(count), fps=fps)
    assert not list(tmp_path.iterdir())


def test_missing_packages_are_named(monkeypatch, tmp_path):
    load = builtins.__import__

    def refuse(name, *args, **kwargs):
        if name.split(".")[0] in ("imageio", "PIL"):
            raise ImportError(name)
        return load(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(ImportError, match=r"pip install .*imageio"):
        write_video(tmp_path / "a.mp4", moving_square(1), fps=30)
    with pytest.raises(ImportError, match=r"pip install .*pillow"):
        write_video(tmp_path / "a.gif", moving_square(1), fps=30)
    assert not list(tmp_path.iterdir())
    with pytest.raises(ImportError, match=r"pip install .*pillow"):
        caption(moving_square(1)[0], ["text"])


def test_caption_writes_into_the_upper_left_corner():
    blank = np.full((240, 320, 3), 128, np.uint8)
    written = caption(blank, ["swing, hold", "t = 0.10 s"])
    assert written.shape == blank.shape
    assert written.dtype == np.uint8
    rows, columns = np.nonzero(np.any(written != blank, axis=2))
    assert len(rows) > 100
    assert rows.max() < 80
    assert columns.max() < 200
    assert np.all(blank == 128)


def hold(env):
    return make_policy("hold", env.task.robot, env.control_period)


@pytest.mark.parametrize(
    ("period", "fps", "begin", "end"),
    [
        *((period, fps, 0.0, 0.4) for period, fps in ((0.01, 30), (0.02, 50), (0.1, 25))),
        *((0.01, 20, begin, 1.0) for begin in (0.2, 0.55)),
    ],
)
def test_record_yields_frames_at_the_asked_rate(make_drawn, monkeypatch, period, fps, begin, end):
    env = make_drawn(STEP, control_period=period, observe="all", width=64, height=48)
    shares, drawn, texts, render = [], [], [], env.render
    monkeypatch.setattr(env, "render", lambda: drawn.append(1) or render())
    monkeypatch.setattr(video, "caption", lambda frame, lines: texts.append(lines) or frame)
    how = {"begin": begin, "options": {"duration": end}, "progress": shares.append}
    frames = list(record(env, hold(env), fps, **how))
    assert len(frames) == round((end - begin) * fps) + 1
    assert len(drawn) == min(len(frames), end / period + 1)  # none is drawn in vain
    assert all(f.shape == (48, 64, 3) for f in frames)
    assert texts[0][1].startswith(f"t = {begin:.2f} s")
    assert np.all(np.diff(shares) >= 0)
    assert shares[-1] == 1.0


def test_record_refuses_an_environment_that_does_not_draw(make_env):
    env = make_env()
    with pytest.raises(ValueError, match="rgb_array"):
        record(env, hold(env))
