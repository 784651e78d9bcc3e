"""Optional parts: sensors, loads, markers, cameras and the visible body."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np

from softrobot_env.robots import Head, RobotParams, Tendon
from softrobot_env.scene.chain import HEAD_BODY, TIP_SITE, Chain
from softrobot_env.scene.config import Appearance, Camera, Load, Marker, PathMarker
from softrobot_env.scene.skin import add_skin
from softrobot_env.scene.tendons import route_through_guides

TIP_POSITION_SENSOR = "tip_position"
TIP_VELOCITY_SENSOR = "tip_velocity"
TENDON_LINE = "{}_line"

#: Radius [m] of a tendon's line.
TENDON_WIDTH = 0.0025

_CAMERA_DISTANCE = 1.5  # m
_LINE_STEP = 0.02  # m between the points of a tendon's line
_LINE_SPREAD = 0.45  # rad around the body between the lines of two groups
_DARK = (0.22, 0.24, 0.28, 1.0)
_WHITE = (0.97, 0.97, 0.97, 1.0)
_TAG_SHARE, _TAG_THICKNESS = 0.6, 0.0004  # of a side of the head, m
_WORLD_SITE = "world_axes"


def add_tip_sensors(spec: mujoco.MjSpec) -> None:
    """Position and velocity of the tip, both in world axes."""
    for name, kind in (
        (TIP_POSITION_SENSOR, mujoco.mjtSensor.mjSENS_FRAMEPOS),
        (TIP_VELOCITY_SENSOR, mujoco.mjtSensor.mjSENS_FRAMELINVEL),
    ):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=TIP_SITE)


def add_load(chain: Chain, load: Load) -> None:
    """Actuator that applies a load through a site; its control scales the load."""
    body, height = chain.locate(load.station)
    site = body.add_site(name=f"{load.name}_point", pos=[0, 0, height], size=[1e-3, 0, 0])
    actuator = chain.spec.add_actuator(
        name=load.name,
        target=site.name,
        trntype=mujoco.mjtTrn.mjTRN_SITE,
        gear=[*load.force, *load.moment],
    )
    if not load.follows:  # the load keeps the world's directions
        if chain.spec.site(_WORLD_SITE) is None:
            chain.spec.worldbody.add_site(name=_WORLD_SITE, size=[1e-3, 0, 0])
        actuator.refsite = _WORLD_SITE
    actuator.set_to_motor()


def add_marker(spec: mujoco.MjSpec, marker: Marker) -> None:
    """Ball on a mocap body of the marker's name."""
    body = spec.worldbody.add_body(name=marker.name, mocap=True, pos=marker.position)
    _add_visual(
        body, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[marker.radius, 0, 0], rgba=marker.rgba
    )


def add_path(spec: mujoco.MjSpec, path: PathMarker) -> None:
    """Capsules between consecutive points."""
    for start, end in pairwise(path.points):
        _add_visual(
            spec.worldbody,
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[*start, *end],
            size=[path.radius, 0, 0],
            rgba=path.rgba,
        )


def add_camera(spec: mujoco.MjSpec, camera: Camera) -> None:
    """Orthographic camera in front of the x-z plane: x to the right."""
    _, y, z = (_CAMERA_DISTANCE * x for x in camera.towards)
    spec.worldbody.add_camera(
        name=camera.name,
        pos=[camera.center[0], y, camera.center[1] + z],
        xyaxes=[1, 0, 0, *camera.up],
        proj=mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC,
        fovy=camera.height,
    )


def add_appearance(chain: Chain, robot: RobotParams, look: Appearance) -> None:
    """Visible body, base, wall and light, and a drawn line for every channel tendon."""
    add_skin(chain, robot, look.link_rgba)
    for tendon in robot.tendons:
        _draw_tendon(chain, tendon, robot.outer_radius, look)
    for end in sorted({tendon.end for tendon in robot.tendons}):
        _add_anchor_ring(chain, robot, end)
    if robot.head is not None:
        _add_head(chain.spec.body(HEAD_BODY), robot.head)
    _add_base(chain.spec, robot)
    # A planar robot needs no room behind it; a spatial one can reach as far as it is long.
    room = 0.0 if chain.kinds == ("hinge",) else robot.reach
    _add_surroundings(chain.spec, robot, 2 * robot.outer_radius + room)


def _draw_tendon(chain: Chain, tendon: Tendon, surface: float, look: Appearance) -> None:
    """Colour a guided tendon; give a channel tendon a line that carries no force."""
    line = chain.spec.tendon(tendon.name)
    if not tendon.guides:
        count = round(tendon.end / _LINE_STEP)
        guides = tuple(np.linspace(0, tendon.end, count + 1)[1:-1])
        drawn = replace(tendon, guides=guides, offset=_drawn_offset(tendon, surface))
        line = route_through_guides(chain, drawn, TENDON_LINE.format(tendon.name))
    line.rgba = look.tendon_rgba
    line.width = TENDON_WIDTH


def _drawn_offset(tendon: Tendon, surface: float) -> tuple[float, float]:
    """Position (x, y) [m] of a tendon's line outside the `surface` [m].

    Tendons of several groups share one channel; their lines are spread side by side towards
    the viewer, so that each can be seen.
    """
    radius = max(surface, float(np.hypot(*tendon.offset))) + TENDON_WIDTH / 2
    angle = np.arctan2(tendon.offset[1], tendon.offset[0])
    turn = -_LINE_SPREAD * tendon.group * (1 if tendon.offset[0] >= 0 else -1)
    return radius * float(np.cos(angle + turn)), radius * float(np.sin(angle + turn))


def _add_anchor_ring(chain: Chain, robot: RobotParams, station: float) -> None:
    """Thin ring where tendons end."""
    half = 0.0025
    body, height = chain.locate(min(station, robot.length - 2 * half))
    _add_visual(
        body,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        pos=[0, 0, height - half],
        size=[robot.outer_radius + TENDON_WIDTH, half, 0],
        rgba=_DARK,
    )


def _add_head(body: mujoco.MjsBody, head: Head) -> None:
    """Block on a stem: the uniform one of the head's inertia, with a dark tag on each side."""
    squares = 1.5 / head.mass * (sum(head.inertia) - 2 * np.array(head.inertia))
    half = np.sqrt(np.maximum(squares, 1e-6))  # a thin body is seen, too
    box, cylinder = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    centre, stem = np.array([0.0, 0.0, head.centre]), head.centre / 2
    _add_visual(body, type=cylinder, pos=[0, 0, stem], size=[min(half) / 2, stem, 0], rgba=_DARK)
    _add_visual(body, type=box, pos=centre, size=half, rgba=_WHITE)
    for axis, side in ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1)):
        out = side * np.eye(3)[axis]
        size = np.where(out == 0, _TAG_SHARE * half, _TAG_THICKNESS)
        _add_visual(body, type=box, pos=centre + out * half, size=size, rgba=_DARK)


def _add_visual(body: mujoco.MjsBody, **geom: Any) -> None:
    """Geom that is only seen: no mass, no contacts."""
    body.add_geom(mass=0, contype=0, conaffinity=0, **geom)


def _add_base(spec: mujoco.MjSpec, robot: RobotParams) -> None:
    """Clamp block below the robot."""
    for width, top, height in ((1.5, 0.25, 0.25), (2.6, -0.25, 0.6)):
        size = width * robot.outer_radius
        _add_visual(
            spec.worldbody,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[0, 0, (top - height) * robot.outer_radius],
            size=[size, size, height * robot.outer_radius],
            rgba=_DARK,
        )


def _add_surroundings(spec: mujoco.MjSpec, robot: RobotParams, wall: float) -> None:
    """Light, and a wall with a grid of 100 mm squares at y = `wall` [m] behind the robot."""
    spec.visual.headlight.ambient = [0.45, 0.45, 0.45]
    spec.visual.headlight.diffuse = [0.28, 0.28, 0.28]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    direction = (0.4, 1.0, -0.5)
    spec.worldbody.add_light(  # its shadow map is centred on the robot
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[-2 * direction[0], -2 * direction[1], robot.length / 2 - 2 * direction[2]],
        dir=direction,
        diffuse=[0.33, 0.33, 0.33],
        specular=[0.2, 0.2, 0.2],
        castshadow=True,
    )
    # Hundreds of thin capsules make up the lines: coarse ones look the same and draw faster.
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 10, 4
    spec.visual.quality.shadowsize, spec.visual.map.shadowclip = 2048, 2.0
    spec.stat.extent = 1.6 * robot.length
    spec.stat.center = [0, 0, robot.length / 2]
    spec.visual.global_.azimuth = 90
    spec.visual.global_.elevation = -5
    _add_wall(spec, wall)


def _add_wall(spec: mujoco.MjSpec, behind: float) -> None:
    spec.add_texture(
        name="grid",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.94, 0.945, 0.955],
        rgb2=[0.905, 0.912, 0.925],
        width=256,
        height=256,
    )
    grid = spec.add_material(name="grid", texrepeat=[10, 10], texuniform=True, specular=0.0)
    grid.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grid"
    _add_visual(
        spec.worldbody,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0, behind, 0],
        quat=[0.7071067811865476, 0.7071067811865476, 0, 0],
        size=[1.5, 1.5, 0.1],
        material="grid",
    )
