"""Pictures of a running simulation, rendered from a separate scene, with or without a display.

The simulated scene contains nothing visible. A renderer builds a visible scene of the same robot,
copies the posture into it, and adds the reference, the target and the trail of the tip.
"""

import importlib
import os
import platform
import sys
import threading
import time
import warnings
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise, product
from math import degrees
from typing import Any, ClassVar

import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.robots import Drive, Gripper, RobotParams, centerline
from softrobot_env.scene.appearance import TENDON_LINE, tendon_width, tension_colours
from softrobot_env.scene.assembly import build_assembly, gripper_scene
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import TIP_SITE
from softrobot_env.scene.config import FRONT_CAMERA, Appearance, Camera, SceneConfig, visible
from softrobot_env.scene.spec import build_chain

from .simulation.grippers import GripperBatch, bar

__all__ = ["Frame", "GripperRenderer", "RenderError", "finger_shapes", "lifted", "make_renderer"]

_MAX_GEOMS = 2000
_PATH_POINTS = 50
_TRAIL_POINTS = 300
_TRAIL_STEP = 0.008  # m between two points of the trail
_FULL_SIZE = 0.4  # m of reach above which target and tip are drawn in full size

_SPACE = 32  # GLFW's number of the key that pauses
_MOST_FRICTION = 0.6  # largest friction coefficient [1] of the slider
_MOST_FRICTION = 0.6  # largest friction coefficient [1] of the slider
_PAUSE = 0.02  # s between two checks of a paused window

_PATH = np.array([0.40, 0.42, 0.48, 1.0])
_TARGET = np.array([0.05, 0.65, 0.30, 1.0])
_WHITE = np.array([1.0, 1.0, 1.0, 1.0])
_BAR = (0.55, 0.65, 0.6, 0.3)
_SENSED_LINE = 0.0007  # m
_WIDER = 2.5  # lines of tendons, which are thin on fingers, than of robots alone
_BEFORE = 0.0045  # m towards the camera, so that a line is drawn in front of its finger
_PIECE_POINTS = 6
_TRAIL = np.array([0.05, 0.30, 0.90, 1.0])


@dataclass(frozen=True)
class Frame:
    """Contents of a picture.

    Attributes:
        episode: Number of the episode; a new one clears the trail.
        time: [s] since the episode began.
        qpos: (nq,) [rad].
        tension: (n_tendons,) [N].
        target: (3,) [m], the reference now.
        path: (k, 3) [m], the whole reference; two points are shown as points.
        jumps: Whether the reference jumps between the points of its path, which are then drawn as
            points.
    """

    episode: int
    time: float
    qpos: ndarray
    tension: ndarray
    target: ndarray
    path: ndarray
    jumps: bool = False


def make_renderer(
    mode: str, config: SceneConfig, frame_size: tuple[int, int]
) -> "OffscreenRenderer | WindowRenderer":
    """Renderer of a render mode.

    Args:
        mode: "rgb_array" or "human".
        config: The simulated scene.
        frame_size: (width, height) of a picture in pixels.

    Raises:
        RenderError: There is no OpenGL, or in mode "human" no display.
    """
    if mode == "human":
        return WindowRenderer(config)
    return OffscreenRenderer(config, *frame_size)


class Pictured:
    """An environment that can be rendered.

    Attributes:
        render_mode: None, "rgb_array" or "human".
    """

    metadata: ClassVar[dict[str, Any]]
    control_period: float
    _renderer: Any = None

    def _take_pictures(self, config: Any) -> None:
        """Store the options, an `EnvConfig`; nothing is opened before the first picture."""
        self.render_mode, self._frame_size = config.render_mode, (config.width, config.height)
        self.metadata = {**self.metadata, "render_fps": max(1, round(1 / self.control_period))}

    @property
    def metres_per_pixel(self) -> float | None:
        """Scale [m per pixel] of the arrays that `render` returns; None before the first."""
        return None if self._renderer is None else self._renderer.metres / self._frame_size[1]

    def close(self) -> None:
        """Free the renderer; closing twice is harmless."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class _Pictures:
    """Renders a scene into arrays.

    Attributes:
        metres: [m] from the lower to the upper edge of a picture.
    """

    metres: float

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, size: tuple[int, int]) -> None:
        self._model, self._data = model, data
        self._context = OffscreenContext(model, *size)
        self._scene, self._option = mujoco.MjvScene(model, _MAX_GEOMS), mujoco.MjvOption()
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = model.camera(FRONT_CAMERA).id

    def _see(self) -> mujoco.MjvScene:
        """The scene to draw, to which more may be added."""
        seen = self._option, None, self._camera, mujoco.mjtCatBit.mjCAT_ALL.value, self._scene
        mujoco.mjv_updateScene(self._model, self._data, *seen)
        return self._scene

    def close(self) -> None:
        """Free the OpenGL context; closing twice is harmless."""
        self._context.close()


class OffscreenRenderer(_Pictures):
    """Renders frames into arrays."""

    def __init__(self, config: SceneConfig, width: int, height: int) -> None:
        self._view = view = _View(config, width / height)
        self.metres = view.camera.height
        super().__init__(view.model, view.data, (width, height))

    def draw(self, frame: Frame) -> ndarray:
        """Picture (height, width, 3) uint8."""
        self._view.update(frame)
        self._view.decorate(self._see(), frame, flat=True)
        return self._context.draw(self._scene)


class WindowRenderer:
    """Shows frames in MuJoCo's viewer, not faster than real time.

    Attributes:
        paused: Whether the display is paused, toggled by the space bar.
    """

    def __init__(self, config: SceneConfig, controls: bool = False) -> None:
        """Open the window, with sliders for the drives if requested. The space bar pauses.

        For tendons with friction there is also a slider for their friction coefficient.

        Raises:
            RenderError: There is no display.
        """
        try:
            check_display()  # after a failure the viewer's thread would wait forever
        except RenderError as error:
            raise RenderError(
                f'{error}; render_mode="human" needs one, render_mode="rgb_array" does not'
            ) from None
        from mujoco import viewer

        known = max((t.friction_coefficient for t in config.robot.tendons), default=0.0)
        self._view = _View(config, 4 / 3, known if controls else 0.0)
        self._drives = self._view.data.ctrl[: -1 if controls and known else None]
        others = set(threading.enumerate())
        self._window = viewer.launch_passive(
            self._view.model,
            self._view.data,
            key_callback=self._on_key,
            show_left_ui=False,
            show_right_ui=controls,
        )
        self.paused = False
        camera = self._window.cam
        reach = config.robot.reach
        x, z = self._view.camera.center
        camera.lookat[:] = (x, 0.0, z)
        camera.distance, camera.azimuth = 2.2 * reach, 90.0
        camera.elevation = -degrees(self._view.camera.elevation)
        self._threads = set(threading.enumerate()) - others
        self._last = (0.0, 0.0)  # simulated and wall-clock time [s] of the last frame

    def draw(self, frame: Frame) -> None:
        """Update the window when the frame is due; no picture is returned."""
        while self.paused and self.is_open:
            self._window.sync()
            time.sleep(_PAUSE)
        if not self.is_open:
            return
        simulated, wall = self._last
        if frame.time > simulated:
            time.sleep(max(0.0, frame.time - simulated - (time.perf_counter() - wall)))
        self._last = (frame.time, time.perf_counter())
        with self._window.lock():
            self._view.update(frame)
            self._window.user_scn.ngeom = 0
            self._view.decorate(self._window.user_scn, frame, flat=False)
        self._window.sync()

    @property
    def is_open(self) -> bool:
        """Whether the window is still open."""
        return self._window.is_running()

    @property
    def controls(self) -> ndarray:
        """(nu,) values of the drives' sliders [N or m], which may be written to."""
        return self._drives

    @property
    def coefficient(self) -> float | None:
        """Friction coefficient [1] of the slider; None without one."""
        own = self._view.data.ctrl[len(self._drives) :]
        return float(own[0]) if len(own) else None

    def push(self, data: mujoco.MjData) -> None:
        """Apply the force of the mouse to the bodies of the simulated scene."""
        seen = self._view.data
        for body in range(1, data.model.nbody):
            name = data.model.body(body).name
            data.xfrc_applied[body] = seen.body(name).xfrc_applied

    def _on_key(self, key: int) -> None:
        if key == _SPACE:
            self.paused = not self.paused

    def close(self) -> None:
        """Close the window."""
        self._window.close()
        for thread in self._threads:  # still in OpenGL; exiting Python would crash
            thread.join(timeout=5.0)


class _View:
    """The visible scene, its posture, and the trail of the tip."""

    def __init__(self, config: SceneConfig, aspect: float, coefficient: float = 0.0) -> None:
        """Build the view of a scene; with a slider for a friction coefficient unless it is zero."""
        drawn = replace(
            visible(replace(config, robot=_as_it_looks(config.robot)), aspect),
            timestep=None,
            integrator="discrete",  # stable for every robot; the view never integrates
            sensors=(),
        )
        self.camera = drawn.cameras[0]
        self.model = build_scene(drawn).model if not coefficient else _with_slider(drawn)
        self.data = mujoco.MjData(self.model)
        self.data.ctrl[self.model.nu - 1 :] = coefficient
        # Layers lie in front of the body, which in space may come nearer by its reach. Moving them
        # along the line of sight does not change the picture.
        room = config.robot.reach if config.bending == "spatial" else 0.0
        self._front = config.robot.backbone.widest + room
        self._disc_size = min(1.0, config.robot.reach / _FULL_SIZE)
        self._tendons = Lines(self.model, config.robot)
        self._tip = self.data.site(TIP_SITE).xpos
        self._trail: list[ndarray] = []
        self._episode = 0

    def update(self, frame: Frame) -> None:
        """Copy posture and tensions; after a divergence the last posture is kept."""
        if np.all(np.isfinite(frame.qpos)):
            self.data.qpos[:] = frame.qpos
        mujoco.mj_fwdPosition(self.model, self.data)
        self._tendons.show(frame.tension)
        if frame.episode != self._episode:
            self._trail.clear()
        self._episode = frame.episode
        tip = self._tip.copy()
        if not self._trail or np.linalg.norm(tip - self._trail[-1]) > _TRAIL_STEP * self._disc_size:
            self._trail.append(tip)
            del self._trail[:-_TRAIL_POINTS]

    def decorate(self, scene: mujoco.MjvScene, frame: Frame, flat: bool) -> None:
        """Add reference, target, trail and tip.

        Args:
            scene: Scene to add them to.
            frame: The frame shown.
            flat: Whether to draw them in layers in front of the body, for the fixed camera; else at
                their true positions, for moving cameras.
        """
        pen, size, layer = _Pen(scene), self._disc_size, np.zeros((6, 1))
        if flat:
            towards = np.array(self.camera.towards)
            pen = _Pen(scene, np.array(self.camera.up), towards)
            layer = (self._front + 0.008 + 0.004 * np.arange(6))[:, None] * towards
        if len(frame.path) > 2 and not frame.jumps:
            pen.line(_thinned(frame.path) + layer[0], 0.0020 * size, _PATH)
        else:
            for point in frame.path:
                pen.dot(point + layer[0], 0.005 * size, _PATH)
        if flat:
            pen.dot(frame.target + layer[1], 0.014 * size, _TARGET)
        pen.dot(frame.target + layer[2], 0.010 * size, _WHITE if flat else _TARGET)
        pen.line(np.array([*self._trail, self._tip]) + layer[3], 0.0022 * size, _TRAIL)
        pen.dot(self._tip + layer[5], 0.006 * size, _TRAIL)


def _as_it_looks(robot: RobotParams) -> RobotParams:
    """A robot without the friction of its tendons and the force of its servos."""
    tendons = (replace(t, friction_coefficient=0.0, feed_line=None) for t in robot.tendons)
    drive = Drive(robot.drive.kind, travel=robot.drive.travel)
    return replace(robot, tendons=tuple(tendons), drive=drive)


def _with_slider(config: SceneConfig) -> mujoco.MjModel:
    """A visible scene with one more drive without force: its slider is a friction coefficient."""
    spec, first = build_chain(config).spec, config.robot.tendons[0].name
    slider = spec.add_actuator(name="friction_coefficient", target=first)
    slider.trntype, slider.gainprm[0] = mujoco.mjtTrn.mjTRN_TENDON, 0.0
    slider.ctrllimited, slider.ctrlrange = True, (0.0, _MOST_FRICTION)
    return spec.compile()


class Lines:
    """The drawn lines of a robot's tendons, coloured by their tensions."""

    def __init__(
        self, model: mujoco.MjModel, robot: RobotParams, prefix: str = "", wider: float = 1.0
    ) -> None:
        """Find the lines of a robot whose names have a prefix, and widen them by a factor [1]."""
        self._model, self._width = model, wider * tendon_width(robot)
        self._limit = robot.of_tendons("tension_limit")
        self._lines = [_line_id(model, prefix + t.name) for t in robot.tendons]

    def show(self, tension: ndarray) -> None:
        """Colour them by tensions (n_tendons,) [N]."""
        share = np.clip(tension / self._limit, 0, 1)
        self._model.tendon_rgba[self._lines] = tension_colours(share)
        self._model.tendon_width[self._lines] = self._width * (0.8 + 0.7 * np.sqrt(share))


def _line_id(model: mujoco.MjModel, tendon: str) -> int:
    """The drawn line of a tendon: a separate one for a channel, the tendon itself for guides."""
    line = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON.value, TENDON_LINE.format(tendon))
    return line if line >= 0 else model.tendon(tendon).id


def _thinned(path: ndarray) -> ndarray:
    """At most about `_PATH_POINTS` of a path's points, ends included."""
    stride = max(1, len(path) // _PATH_POINTS)
    return np.concatenate((path[:-1:stride], path[-1:]))


class _Pen:
    """Adds lines and dots to a scene while it has room."""

    def __init__(
        self, scene: mujoco.MjvScene, up: ndarray | None = None, towards: ndarray | None = None
    ) -> None:
        """Dots are balls, or thin discs that face a camera in a direction `towards` (3,)."""
        self._scene = scene
        self._turn = None if up is None else np.stack([np.cross(up, towards), up, towards], axis=1)

    def line(
        self, points: ndarray, radius: float, rgba: ndarray, emission: float | None = None
    ) -> None:
        """A line through points (k, 3) [m]."""
        for ends in pairwise(points):
            geom = self._next(mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), rgba)
            if geom is not None:
                geom.emission = geom.emission if emission is None else emission
                mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE.value, radius, *ends)

    def dot(self, center: ndarray, radius: float, rgba: ndarray) -> None:
        """A ball or disc about a point (3,) [m]."""
        kind, size = mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, radius)
        if self._turn is not None:
            kind, size = mujoco.mjtGeom.mjGEOM_CYLINDER, np.array([radius, 0.0005, 0.0])
        geom = self._next(kind, size, rgba)
        if geom is not None:
            geom.pos[:] = center
            geom.mat[:] = np.eye(3) if self._turn is None else self._turn

    def _next(self, kind: mujoco.mjtGeom, size: ndarray, rgba: ndarray) -> mujoco.MjvGeom | None:
        """A fresh geom at the end of the scene's list, or None when that is full."""
        scene = self._scene
        if scene.ngeom >= scene.maxgeom:
            return None
        geom, colour = scene.geoms[scene.ngeom], rgba.astype(np.float32)
        mujoco.mjv_initGeom(geom, kind.value, size, np.zeros(3), np.eye(3).ravel(), colour)
        geom.emission = 0.3  # independent of the light
        geom.category = mujoco.mjtCatBit.mjCAT_DECOR.value
        scene.ngeom += 1
        return geom


#: Angles of circular arcs [rad]; the farthest tip of the rig is at about 2 rad.
_ANGLES = np.linspace(0.0, 2.2, 200)


def lifted(robot: RobotParams, points: ndarray) -> ndarray:
    """Points (k, 3) [m] above x and y (k, 2) [m], where the tip of a circular arc would be.

    Beyond the reach of an arc, the height of the farthest one is used.
    """
    head = robot.reach - robot.length
    half = np.sinc(_ANGLES / (2 * np.pi))  # sin(a / 2) / (a / 2)
    chord = robot.length * half
    distance = chord * np.sin(_ANGLES / 2) + head * np.sin(_ANGLES)
    height = chord * np.cos(_ANGLES / 2) + head * np.cos(_ANGLES)
    rising = slice(0, int(np.argmax(distance)) + 1)
    z = np.interp(np.hypot(*points.T), distance[rising], height[rising])
    return np.column_stack((points, z))


class GripperRenderer(_Pictures):
    """Renders grippers into arrays.

    Attributes:
        diameter: [m], of the bar.
    """

    def __init__(self, batch: GripperBatch, diameter: float, width: int, height: int) -> None:
        self.diameter = diameter
        self._gripper = gripper = batch.gripper
        reach = max(finger.robot.reach for finger in gripper.fingers)
        self.metres = 1.6 * reach
        own = batch.scene.config.members[0].config
        scene = build_assembly(
            gripper_scene(
                gripper,
                (bar(gripper, batch.task, diameter, rgba=_BAR),),
                control_period=own.control_period,
                pieces=own.pieces,
                appearance=Appearance(surroundings=False),
                cameras=(Camera(FRONT_CAMERA, (0.0, 0.45 * reach), self.metres, 0.25),),
            )
        )
        self._tendons = [
            (part.u, Lines(scene.model, part.scene.config.robot, part.member.prefix, _WIDER))
            for part in scene.parts.values()
        ]
        super().__init__(scene.model, mujoco.MjData(scene.model), (width, height))

    def draw(self, qpos: ndarray, tension: ndarray, curvature: ndarray) -> ndarray:
        """Picture (height, width, 3) uint8.

        Args:
            qpos: (nq,), posture of fingers and bar.
            tension: (n_tendons,) [N], of all fingers in turn.
            curvature: (pieces,) [1/m], of all fingers' pieces in turn, as measured by sensors.
        """
        self._data.qpos[:] = qpos
        mujoco.mj_forward(self._model, self._data)
        for own, tendons in self._tendons:
            tendons.show(tension[own])
        pen = _Pen(self._see())
        for points in finger_shapes(self._gripper, curvature):
            points[:, 1] -= _BEFORE
            pen.line(points, _SENSED_LINE, _TRAIL, emission=0.0)
        return self._context.draw(self._scene)


def finger_shapes(gripper: Gripper, curvature: ndarray) -> list[ndarray]:
    """Shapes (k, 3) [m] of the fingers, each piece an arc of its mean curvature (pieces,) [1/m]."""
    out, first = [], 0
    for finger in gripper.fingers:
        own = curvature[first : first + finger.robot.pieces]
        first += finger.robot.pieces
        points = centerline(finger.robot, own, _PIECE_POINTS)
        out.append(np.array(finger.base.position) + points @ finger.base.axes.T)
    return out


# ---------------------------------------------------------------- OpenGL

#: Backends in the order they are tried.
BACKENDS = ("egl", "osmesa", "glfw")

_OFF = ("disable", "disabled", "off", "false", "0")
_ANY = ("", "enable", "enabled", "on", "true", "1")
#: Supersampling factor along each side, which smooths the edges of shadows, and the size up to
#: which it is affordable.
_FINER, _LARGE = 2, 1000

_HELP = (
    "Install a software renderer (Debian, Ubuntu: apt-get install libegl1 libgl1-mesa-dri, or "
    "apt-get install libosmesa6) and the Python package PyOpenGL, or choose the backend with the "
    "environment variable MUJOCO_GL=egl|osmesa|glfw (glfw needs a display)"
)


class RenderError(RuntimeError):
    """No picture can be made on this machine; the message says what to install."""


def has_display() -> bool:
    """Whether a window is likely to open."""
    if platform.system() != "Linux":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def check_display() -> None:
    """Start GLFW, which windows need.

    Raises:
        RenderError: There is no display, or it refuses windows.
    """
    if not has_display():
        raise RenderError("there is no display: neither DISPLAY nor WAYLAND_DISPLAY is set")
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # GLFW gives the reason of a failure as a warning
        started = glfw.init()
    if not started:
        raise RenderError("the display cannot be opened: GLFW did not start")


def candidate_backends() -> tuple[str, ...]:
    """Backends to try: the one named by `MUJOCO_GL`, else all that may work here.

    Raises:
        RenderError: `MUJOCO_GL` switches rendering off or names no backend.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower().strip()
    if asked in _OFF:
        raise RenderError(f"rendering is switched off by MUJOCO_GL={asked}")
    if platform.system() != "Linux":
        return ("native",)
    if asked in _ANY:
        return BACKENDS if has_display() else BACKENDS[:2]
    asked = {"glx": "glfw"}.get(asked, asked)
    if asked not in BACKENDS:
        raise RenderError(f"MUJOCO_GL={asked} is not one of {', '.join(BACKENDS)}")
    return (asked,)


class OffscreenContext:
    """A framebuffer outside any window."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        """Open the first backend that works.

        Args:
            model: What is drawn.
            width, height: Of pictures in pixels.

        Raises:
            RenderError: None does; the message says why, and what to install.
        """
        self._finer = _FINER if max(width, height) <= _LARGE else 1
        if self._finer > 1:
            # Edges are smooth then, and finer shadows are not visible.
            model.vis.quality.offsamples, model.vis.quality.shadowsize = 0, 2048
        width, height = self._finer * width, self._finer * height
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        self._rect = mujoco.MjrRect(0, 0, width, height)
        self._gl, self._buffers = _open_first(model, width, height)
        # Also runs when the interpreter exits, while the OpenGL modules still exist.
        self._finalizer = weakref.finalize(self, _free, self._gl, self._buffers)

    def draw(self, scene: mujoco.MjvScene) -> ndarray:
        """Picture (height, width, 3) uint8 of a scene."""
        self._gl.make_current()
        mujoco.mjr_render(self._rect, scene, self._buffers)
        pixels = np.empty((self._rect.height, self._rect.width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rect, self._buffers)
        pixels = pixels[::-1]  # OpenGL counts rows from below
        if self._finer == 1:
            return np.ascontiguousarray(pixels)
        height, width = self._rect.height // self._finer, self._rect.width // self._finer
        total = np.full((height, width, 3), self._finer**2 // 2, np.uint16)
        for row, column in product(range(self._finer), repeat=2):
            total += pixels[row :: self._finer, column :: self._finer]
        return (total // self._finer**2).astype(np.uint8)

    def close(self) -> None:
        """Free the framebuffer and the context."""
        self._finalizer()


def _free(gl: Any, buffers: mujoco.MjrContext) -> None:
    with gl.as_current():
        buffers.free()
    gl.free()


def _open_first(model: mujoco.MjModel, width: int, height: int) -> tuple[Any, mujoco.MjrContext]:
    reasons = []
    for backend in candidate_backends():
        loaded = set(sys.modules)
        platform_before = os.environ.get("PYOPENGL_PLATFORM")
        try:
            return _open(backend, model, width, height)
        except Exception as error:  # a missing or broken driver may raise any type
            reasons.append(f"{backend}: {error or type(error).__name__}")
        _forget_opengl(loaded, platform_before)
    raise RenderError(f"no OpenGL for offscreen pictures ({'; '.join(reasons)}). {_HELP}")


def _open(
    backend: str, model: mujoco.MjModel, width: int, height: int
) -> tuple[Any, mujoco.MjrContext]:
    if backend == "glfw":
        check_display()
    name = "mujoco.gl_context" if backend == "native" else f"mujoco.{backend}"
    gl = importlib.import_module(name).GLContext(width, height)
    gl.make_current()
    with _loader_of(backend):
        buffers = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
    mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, buffers)
    return gl, buffers


@contextmanager
def _loader_of(backend: str) -> Iterator[None]:
    """Tell MuJoCo, which reads the variable again here, whose OpenGL functions to load."""
    before = os.environ.get("MUJOCO_GL")
    if backend != "native":
        os.environ["MUJOCO_GL"] = backend
    try:
        yield
    finally:
        _restore("MUJOCO_GL", before)


def _forget_opengl(loaded: set[str], platform_before: str | None) -> None:
    """Undo the imports of a failed attempt: PyOpenGL fixes its platform when imported."""
    for name in set(sys.modules) - loaded:
        if name.split(".")[0] == "OpenGL" or name.removeprefix("mujoco.").split(".")[0] in BACKENDS:
            del sys.modules[name]
    _restore("PYOPENGL_PLATFORM", platform_before)


def _restore(variable: str, value: str | None) -> None:
    if value is None:
        os.environ.pop(variable, None)
    else:
        os.environ[variable] = value
