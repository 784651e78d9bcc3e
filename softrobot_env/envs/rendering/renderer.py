"""Pictures of a running simulation, rendered from a scene of their own.

The simulated scene has nothing to see. A renderer builds the visible scene of the same robot,
copies the posture into it, and adds the reference, the target and the trail of the tip.
"""

import threading
import time
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import degrees

import mujoco
import numpy as np

from softrobot_env.envs.rendering.opengl import OffscreenContext, RenderError, check_display
from softrobot_env.envs.simulation.grippers import GripperBatch, bar
from softrobot_env.robots import Gripper, RobotParams, centerline
from softrobot_env.scene.appearance import TENDON_LINE, tendon_width, tension_colours
from softrobot_env.scene.assembly import build_assembly
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.chain import TIP_SITE
from softrobot_env.scene.config import FRONT_CAMERA, Appearance, Camera, SceneConfig, visible
from softrobot_env.scene.gripper import gripper_scene

__all__ = ["Frame", "GripperRenderer", "RenderError", "finger_shapes", "lifted", "make_renderer"]

_MAX_GEOMS = 2000
_PATH_POINTS = 50
_TRAIL_POINTS = 300
_TRAIL_STEP = 0.008  # m between two points of the trail
_FULL_SIZE = 0.4  # m of reach from which on target and tip are drawn in full size

_SPACE = 32  # GLFW's number of the key that pauses
_PAUSE = 0.02  # s between two looks at a window that is paused

_PATH = np.array([0.40, 0.42, 0.48, 1.0])
_TARGET = np.array([0.05, 0.65, 0.30, 1.0])
_WHITE = np.array([1.0, 1.0, 1.0, 1.0])
_BAR = (0.55, 0.65, 0.6, 0.3)
_SENSED_LINE = 0.0007  # m
_WIDER = 2.5  # lines of tendons, which are thin on fingers, than of robots alone
_BEFORE = 0.0045  # m towards the camera, so that a line is seen before its finger
_PIECE_POINTS = 6
_TRAIL = np.array([0.05, 0.30, 0.90, 1.0])


@dataclass(frozen=True)
class Frame:
    """What a picture shows.

    Attributes:
        episode: Number of the episode; a new one clears the trail.
        time: [s] since the episode began.
        qpos: (nq,) [rad].
        tension: (n_tendons,) [N].
        target: (3,) [m], the reference now.
        path: (k, 3) [m], the whole reference; two points are shown as points.
        jumps: Whether the reference jumps between the points of its path; then all are points.
    """

    episode: int
    time: float
    qpos: np.ndarray
    tension: np.ndarray
    target: np.ndarray
    path: np.ndarray
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


class OffscreenRenderer:
    """Renders into arrays.

    Attributes:
        metres: [m] from the lower to the upper edge of a picture.
    """

    def __init__(self, config: SceneConfig, width: int, height: int) -> None:
        self._view = _View(config, width / height)
        self.metres = self._view.camera.height
        model = self._view.model
        self._context = OffscreenContext(model, width, height)
        self._scene = mujoco.MjvScene(model, _MAX_GEOMS)
        self._option = mujoco.MjvOption()
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = model.camera(FRONT_CAMERA).id

    def draw(self, frame: Frame) -> np.ndarray:
        """Picture (height, width, 3) uint8."""
        view = self._view
        view.update(frame)
        mujoco.mjv_updateScene(
            view.model,
            view.data,
            self._option,
            None,
            self._camera,
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )
        view.decorate_flat(self._scene, frame)
        return self._context.draw(self._scene)

    def close(self) -> None:
        """Free the OpenGL context; closing twice is harmless."""
        self._context.close()


class WindowRenderer:
    """Shows frames in MuJoCo's viewer, not faster than real time.

    Attributes:
        paused: Whether frames wait, which the space bar changes.
    """

    def __init__(self, config: SceneConfig, controls: bool = False) -> None:
        """Open the window, with sliders for the drives if asked for. The space bar pauses.

        Raises:
            RenderError: There is no display.
        """
        try:
            check_display()  # the viewer's thread would wait for ever after a failure
        except RenderError as error:
            raise RenderError(
                f'{error}; render_mode="human" needs one, render_mode="rgb_array" does not'
            ) from None
        from mujoco import viewer

        self._view = _View(config, 4 / 3)
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
        """Update the window, after waiting until the frame is due; no picture is returned."""
        while self.paused and self.is_open:
            self._window.sync()
            time.sleep(_PAUSE)
        if not self.is_open:
            return
        self._wait(frame.time)
        with self._window.lock():
            self._view.update(frame)
            self._window.user_scn.ngeom = 0
            self._view.decorate_in_space(self._window.user_scn, frame)
        self._window.sync()

    @property
    def is_open(self) -> bool:
        """Whether nobody has closed the window."""
        return self._window.is_running()

    @property
    def controls(self) -> np.ndarray:
        """(nu,) where the sliders are [N or m], to be written to."""
        return self._view.data.ctrl

    def push(self, data: mujoco.MjData) -> None:
        """Let the force of the mouse act on the bodies of the simulated scene."""
        seen = self._view.data
        for body in range(1, data.model.nbody):
            name = data.model.body(body).name
            data.xfrc_applied[body] = seen.body(name).xfrc_applied

    def _on_key(self, key: int) -> None:
        if key == _SPACE:
            self.paused = not self.paused

    def _wait(self, now: float) -> None:
        simulated, wall = self._last
        if now > simulated:
            time.sleep(max(0.0, now - simulated - (time.perf_counter() - wall)))
        self._last = (now, time.perf_counter())

    def close(self) -> None:
        """Close the window."""
        self._window.close()
        for thread in self._threads:  # still in OpenGL; leaving Python under it would crash
            thread.join(timeout=5.0)


class _View:
    """The visible scene, its posture, and the trail of the tip."""

    def __init__(self, config: SceneConfig, aspect: float) -> None:
        drawn = replace(
            visible(config, aspect),
            timestep=None,
            integrator="discrete",  # stable for every robot; the view never integrates
            sensors=(),
        )
        self.camera = drawn.cameras[0]
        self.model = build_scene(drawn).model
        self.data = mujoco.MjData(self.model)
        # Layers lie in front of the body, which in space comes nearer by up to its reach. Moved
        # along the line of sight they stay where they are in the picture.
        room = config.robot.reach if config.bending == "spatial" else 0.0
        self._front = config.robot.backbone.widest + room
        self._disc_size = min(1.0, config.robot.reach / _FULL_SIZE)
        self._tendons = Lines(self.model, config.robot)
        self._tip = self.data.site(TIP_SITE).xpos
        self._trail: list[np.ndarray] = []
        self._episode = 0

    def update(self, frame: Frame) -> None:
        """Take over posture and tensions; a diverged posture leaves the last one standing."""
        if np.all(np.isfinite(frame.qpos)):
            self.data.qpos[:] = frame.qpos
        mujoco.mj_fwdPosition(self.model, self.data)
        self._tendons.show(frame.tension)
        self._extend_trail(frame.episode)

    def _extend_trail(self, episode: int) -> None:
        if episode != self._episode:
            self._trail.clear()
        self._episode = episode
        tip = self._tip.copy()
        if not self._trail or np.linalg.norm(tip - self._trail[-1]) > _TRAIL_STEP * self._disc_size:
            self._trail.append(tip)
            del self._trail[:-_TRAIL_POINTS]

    def decorate_in_space(self, scene: mujoco.MjvScene, frame: Frame) -> None:
        """Add reference, target, trail and tip where they are, for cameras that move."""
        ball, size = partial(_add_ball, scene), self._disc_size
        if len(frame.path) > 2 and not frame.jumps:
            _add_line(scene, _thinned(frame.path), 0.0020 * size, _PATH)
        else:
            for point in frame.path:
                ball(point, 0.005 * size, _PATH)
        ball(frame.target, 0.010 * size, _TARGET)
        _add_line(scene, np.array([*self._trail, self._tip]), 0.0022 * size, _TRAIL)
        ball(self._tip, 0.006 * size, _TRAIL)

    def decorate_flat(self, scene: mujoco.MjvScene, frame: Frame) -> None:
        """Add the same in layers in front of the body, as the fixed camera sees them."""
        towards = np.array(self.camera.towards)
        layer = (self._front + 0.008 + 0.004 * np.arange(6))[:, None] * towards
        disc = partial(_add_disc, scene, up=np.array(self.camera.up), towards=towards)
        size = self._disc_size
        if len(frame.path) > 2 and not frame.jumps:
            _add_line(scene, _thinned(frame.path) + layer[0], 0.0020 * size, _PATH)
        else:
            for point in frame.path:
                disc(point + layer[0], 0.005 * size, _PATH)
        disc(frame.target + layer[1], 0.014 * size, _TARGET)
        disc(frame.target + layer[2], 0.010 * size, _WHITE)
        trail = np.array([*self._trail, self._tip])
        _add_line(scene, trail + layer[3], 0.0022 * size, _TRAIL)
        disc(self._tip + layer[5], 0.006 * size, _TRAIL)


class Lines:
    """The drawn lines of a robot's tendons, in colours and widths that tell their tensions."""

    def __init__(
        self, model: mujoco.MjModel, robot: RobotParams, prefix: str = "", wider: float = 1.0
    ) -> None:
        """Find them, of a robot whose parts have names with a prefix, and make them wider [1]."""
        self._model, self._width = model, wider * tendon_width(robot)
        self._limit = np.array([t.tension_limit for t in robot.tendons])
        self._lines = [_line_id(model, prefix + t.name) for t in robot.tendons]

    def show(self, tension: np.ndarray) -> None:
        """Colour them by tensions (n_tendons,) [N]."""
        share = np.clip(tension / self._limit, 0, 1)
        self._model.tendon_rgba[self._lines] = tension_colours(share)
        self._model.tendon_width[self._lines] = self._width * (0.8 + 0.7 * np.sqrt(share))


def _line_id(model: mujoco.MjModel, tendon: str) -> int:
    """The drawn line of a tendon: its own for a channel, itself for guides."""
    line = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON.value, TENDON_LINE.format(tendon))
    return line if line >= 0 else model.tendon(tendon).id


def _thinned(path: np.ndarray) -> np.ndarray:
    """At most about `_PATH_POINTS` of a path's points, ends included."""
    stride = max(1, len(path) // _PATH_POINTS)
    return np.concatenate((path[:-1:stride], path[-1:]))


def _add_line(
    scene: mujoco.MjvScene,
    points: np.ndarray,
    radius: float,
    rgba: np.ndarray,
    emission: float | None = None,
) -> None:
    for start, end in pairwise(points):
        geom = _next_geom(scene, mujoco.mjtGeom.mjGEOM_CAPSULE, np.zeros(3), rgba)
        if geom is None:
            return
        geom.emission = geom.emission if emission is None else emission
        mujoco.mjv_connector(geom, mujoco.mjtGeom.mjGEOM_CAPSULE.value, radius, start, end)


def _add_disc(
    scene: mujoco.MjvScene,
    center: np.ndarray,
    radius: float,
    rgba: np.ndarray,
    up: np.ndarray,
    towards: np.ndarray,
) -> None:
    """Thin disc facing the camera, in the direction `towards` (3,)."""
    size = np.array([radius, 0.0005, 0.0])
    geom = _next_geom(scene, mujoco.mjtGeom.mjGEOM_CYLINDER, size, rgba)
    if geom is not None:
        geom.pos[:] = center
        geom.mat[:] = np.stack([np.cross(up, towards), up, towards], axis=1)


def _add_ball(scene: mujoco.MjvScene, center: np.ndarray, radius: float, rgba: np.ndarray) -> None:
    geom = _next_geom(scene, mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, radius), rgba)
    if geom is not None:
        geom.pos[:] = center


def _next_geom(
    scene: mujoco.MjvScene, kind: mujoco.mjtGeom, size: np.ndarray, rgba: np.ndarray
) -> mujoco.MjvGeom | None:
    """A fresh geom at the end of the scene's list, or None when that is full."""
    if scene.ngeom >= scene.maxgeom:
        return None
    geom = scene.geoms[scene.ngeom]
    mujoco.mjv_initGeom(
        geom, kind.value, size, np.zeros(3), np.eye(3).ravel(), rgba.astype(np.float32)
    )
    geom.emission = 0.3  # lines keep their colour in any light
    geom.category = mujoco.mjtCatBit.mjCAT_DECOR.value
    scene.ngeom += 1
    return geom


#: Of circular arcs [rad]; the farthest tip of the rig is at about 2 rad.
_ANGLES = np.linspace(0.0, 2.2, 200)


def lifted(robot: RobotParams, points: np.ndarray) -> np.ndarray:
    """Points (k, 3) [m] above x and y (k, 2) [m], where the tip of a circular arc would be.

    Beyond the reach of an arc the height of the farthest one is taken.
    """
    head = robot.reach - robot.length
    half = np.sinc(_ANGLES / (2 * np.pi))  # sin(a / 2) / (a / 2)
    chord = robot.length * half
    distance = chord * np.sin(_ANGLES / 2) + head * np.sin(_ANGLES)
    height = chord * np.cos(_ANGLES / 2) + head * np.cos(_ANGLES)
    rising = slice(0, int(np.argmax(distance)) + 1)
    z = np.interp(np.hypot(*points.T), distance[rising], height[rising])
    return np.column_stack((points, z))


class GripperRenderer:
    """Renders into arrays.

    Attributes:
        diameter: [m], of the bar.
        metres: [m] from the lower to the upper edge of a picture.
    """

    def __init__(self, batch: GripperBatch, diameter: float, width: int, height: int) -> None:
        self.diameter = diameter
        gripper, task, config = batch.gripper, batch.task, batch.scene.config
        reach = max(finger.robot.reach for finger in gripper.fingers)
        self.metres = 1.6 * reach
        camera = Camera(FRONT_CAMERA, (0.0, 0.45 * reach), self.metres, 0.25)
        own = config.members[0].config
        self._scene = build_assembly(
            gripper_scene(
                gripper,
                (bar(gripper, task, diameter, rgba=_BAR),),
                control_period=own.control_period,
                pieces=own.pieces,
                appearance=Appearance(surroundings=False),
                cameras=(camera,),
            )
        )
        self._gripper, model = gripper, self._scene.model
        parts = self._scene.parts.values()
        self._tendons = [
            (part.u, Lines(model, part.scene.config.robot, part.member.prefix, _WIDER))
            for part in parts
        ]
        self._data = mujoco.MjData(model)
        self._context = OffscreenContext(model, width, height)
        self._shown = mujoco.MjvScene(model, _MAX_GEOMS)
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._camera.fixedcamid = model.camera(FRONT_CAMERA).id

    def draw(self, qpos: np.ndarray, tension: np.ndarray, curvature: np.ndarray) -> np.ndarray:
        """Picture (height, width, 3) uint8.

        Args:
            qpos: (nq,), posture of fingers and bar.
            tension: (n_tendons,) [N], of all fingers in turn.
            curvature: (pieces,) [1/m], of all fingers' pieces in turn, as sensors tell it.
        """
        model, data = self._scene.model, self._data
        data.qpos[:] = qpos
        mujoco.mj_forward(model, data)
        for own, tendons in self._tendons:
            tendons.show(tension[own])
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        option = mujoco.MjvOption()
        mujoco.mjv_updateScene(model, data, option, None, self._camera, everything, self._shown)
        for points in finger_shapes(self._gripper, curvature):
            points[:, 1] -= _BEFORE
            _add_line(self._shown, points, _SENSED_LINE, _TRAIL, emission=0.0)
        return self._context.draw(self._shown)

    def close(self) -> None:
        """Free the OpenGL context; closing twice is harmless."""
        self._context.close()


def finger_shapes(gripper: Gripper, curvature: np.ndarray) -> list[np.ndarray]:
    """Shapes (k, 3) [m] of the fingers, each piece an arc of its mean curvature (pieces,) [1/m]."""
    out, first = [], 0
    for finger in gripper.fingers:
        own = curvature[first : first + finger.robot.pieces]
        first += finger.robot.pieces
        points = centerline(finger.robot, own, _PIECE_POINTS)
        out.append(np.array(finger.base.position) + points @ finger.base.axes.T)
    return out
