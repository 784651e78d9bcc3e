"""Optional parts: the visible body of a robot and what stands around it, sensors, loads, cameras.

Nothing of them but loads moves the scene.

The body is one smooth surface that bends with the links (a MuJoCo skin).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import ceil
from typing import Any

import numpy as np
from mujoco import (
    MjsBody,
    MjSpec,
    mjtBuiltin,
    mjtGeom,
    mjtLightType,
    mjtObj,
    mjtProjection,
    mjtSensor,
    mjtTexture,
    mjtTextureRole,
    mjtTrn,
)
from numpy import ndarray

from softrobot_env.robots import Head, RobotParams, Tendon

from .chain import HEAD_BODY, TIP_SITE, Chain
from .config import Appearance, Camera, Load, Marker, PathMarker, Rgba
from .tendons import route_through_guides

BODY_SKIN = "soft_body"
TENDON_LINE = "{}_line"

#: Radius of a tendon's line: at most so many metres, and of the robot's radius.
_TENDON_WIDTH, _TENDON_SHARE = 0.0025, 0.1

_LINE_STEP = 0.02  # m between the points of a tendon's line
_LINE_TURN = 0.3  # rad about the fibre between them, so that chords stay outside the surface
_LINE_SPREAD = 0.45  # rad around the body between the lines of two groups
_UNSEEN = (0.0, 0.0, 0.0, 0.0)
_DARK = (0.22, 0.24, 0.28, 1.0)
_WHITE = (0.97, 0.97, 0.97, 1.0)
_TAG_SHARE, _TAG_THICKNESS = 0.6, 0.0004  # of a side of the head, m
_FLOOR = (0.97, 0.98, 1.0, 1.0)
_UPRIGHT = 0.99  # of the direction that is up, where robots stand on a floor
_BASE_DEPTH = 1.45  # of the radius, below the robot
_WIDEST_BASE = 0.2  # of the reach, half of the clamp block
_SIDES = 24
_RING_DISTANCE = 0.0125  # m
_ROUNDING = 0.15  # of the radius, at the rim of the tip


def tension_colours(share: ndarray) -> ndarray:
    """(n, 4) colours in [0, 1] of tendons whose tension is such a share (n,) of their limit."""
    slack, tight = np.array([0.62, 0.67, 0.76, 1.0]), np.array([0.75, 0.0, 0.10, 1.0])
    # The root shows small tensions, which are the usual ones.
    return slack + np.sqrt(share)[:, None] * (tight - slack)


def tendon_width(robot: RobotParams) -> float:
    """Radius [m] of the lines that show a robot's tendons."""
    return min(_TENDON_WIDTH, _TENDON_SHARE * robot.backbone.widest)


def add_appearance(chain: Chain, robot: RobotParams, look: Appearance) -> None:
    """Visible body, base, wall and light, and a visible line for every channel tendon."""
    _add_skin(chain, robot, look.link_rgba)
    for tendon in robot.tendons:
        _draw_tendon(chain, tendon, robot, look)
    for end in sorted({tendon.end for tendon in robot.tendons}):
        _add_anchor_ring(chain, robot, end)
    if robot.head is not None:
        _add_head(chain.spec.body(HEAD_BODY), robot.head)
    for index, disc in enumerate(robot.discs):
        radius, half = disc.cylinder
        least = _radius(robot, disc.station) + tendon_width(robot)
        size = [max(radius, least), half, 0]
        add_visual(chain.spec.body(f"disc{index}"), "CYLINDER", size, _DARK)
    _add_base(chain.bodies[0], robot)
    if not look.surroundings:  # seen alone, it is lit from the camera
        headlight = chain.spec.visual.headlight
        headlight.ambient, headlight.diffuse, headlight.specular = [0.4] * 3, [0.55] * 3, [0.1] * 3
    else:
        # A planar robot needs no room behind it; a spatial one can reach as far as it is long, and
        # is seen from above, where a floor shows.
        room = 0.0 if chain.kinds == ("hinge",) else robot.reach
        (_, y, z), axes = robot.clamp.position, robot.clamp.axes
        wall = 2 * robot.backbone.widest + room + y
        middle = robot.clamp.position + robot.length / 2 * axes[:, 2]
        add_surroundings(chain.spec, robot.length, wall, tuple(middle) if robot.base else None)
        if room and axes[2, 2] > _UPRIGHT:
            place = [0, wall - 1.5, z - _BASE_DEPTH * _radius(robot, 0.0) - 0.005]
            add_visual(chain.spec.worldbody, "BOX", [1.5, 1.5, 0.005], _FLOOR, pos=place)


def _draw_tendon(chain: Chain, tendon: Tendon, robot: RobotParams, look: Appearance) -> None:
    """Colour a tendon whose guides stand outside; show any other by a line on the surface.

    The line carries no force. Inside, the chords of a bent robot would leave its surface here and
    there, like cracks.
    """
    line, stations = chain.spec.tendon(tendon.name), np.array(tendon.stations)
    line.width, line.rgba = tendon_width(robot), look.tendon_rgba
    away = np.linalg.norm(tendon.at(stations), axis=1)
    if tendon.guides and np.all(away >= robot.backbone.outer_radius(stations)):
        return
    line.rgba = _UNSEEN
    count = max(round(tendon.end / _LINE_STEP), ceil(_turning(tendon) / _LINE_TURN))
    places = [
        (s, *_shown_offset(tendon, robot, s)) for s in np.linspace(0, tendon.end, max(count, 1) + 1)
    ]
    guides = tuple(s for s, _, _ in places[1:-1])
    shown = replace(tendon, guides=guides, offset=places[0][1:], route=tuple(places[1:]), turns=0.0)
    line = route_through_guides(chain, shown, TENDON_LINE.format(tendon.name))
    line.width, line.rgba = tendon_width(robot), look.tendon_rgba


def _turning(tendon: Tendon) -> float:
    """Angle [rad] that a tendon winds about the fibre, to and fro."""
    x, y = tendon.at(np.linspace(0, tendon.end, 200)).T
    return float(np.abs(np.diff(np.unwrap(np.arctan2(y, x)))).sum())


def _radius(robot: RobotParams, station: float) -> float:
    """Outer radius [m] at a station [m]."""
    return float(robot.backbone.outer_radius(station))


def _shown_offset(tendon: Tendon, robot: RobotParams, station: float) -> tuple[float, float]:
    """Position (x, y) [m] of a tendon's line, on or outside the surface, at a station [m].

    Straight tendons of several groups share one channel; their lines are spread side by side
    towards the viewer, so that each can be seen.
    """
    x, y = tendon.at(np.array([station]))[0]
    radius = max(_radius(robot, station), float(np.hypot(x, y))) + tendon_width(robot) / 2
    angle = np.arctan2(y, x)
    if tendon.is_straight:
        angle -= _LINE_SPREAD * tendon.group * (1 if x >= 0 else -1)
    return radius * float(np.cos(angle)), radius * float(np.sin(angle))


def _add_anchor_ring(chain: Chain, robot: RobotParams, station: float) -> None:
    """Thin ring where tendons end."""
    half = 0.0025
    body, height = chain.locate(min(station, robot.length - 2 * half))
    radius = _radius(robot, station) + tendon_width(robot)
    add_visual(body, "CYLINDER", [radius, half, 0], _DARK, pos=[0, 0, height - half])


def _add_head(body: MjsBody, head: Head) -> None:
    """Block on a stem: the uniform one of the head's inertia, with a dark tag on each side."""
    half = np.array(head.half_sizes)
    centre, stem = np.array([0.0, 0.0, head.centre]), head.centre / 2
    add_visual(body, "CYLINDER", [min(half) / 2, stem, 0], _DARK, pos=[0, 0, stem])
    add_visual(body, "BOX", half, _WHITE, pos=centre)
    for axis, side in ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1)):
        out = side * np.eye(3)[axis]
        size = np.where(out == 0, _TAG_SHARE * half, _TAG_THICKNESS)
        add_visual(body, "BOX", size, _DARK, pos=centre + out * half)


def _add_base(body: MjsBody, robot: RobotParams) -> None:
    """Clamp block below the robot; of a short and thick one not much wider than itself."""
    radius = _radius(robot, 0.0)
    widest = max(1.3 * radius, _WIDEST_BASE * robot.reach)
    for width, top, height in ((1.5, 0.25, 0.25), (2.6, -0.25, (_BASE_DEPTH - 0.25) / 2)):
        size, z = min(width * radius, widest), (top - height) * radius
        add_visual(body, "BOX", [size, size, height * radius], _DARK, pos=[0, 0, z])


def add_surroundings(
    spec: MjSpec, height: float, wall: float, middle: tuple[float, float, float] | None = None
) -> None:
    """Light, and a wall with a grid of 100 mm squares at y = `wall` [m].

    Args:
        spec: The scene.
        height: [m], size of what stands there.
        wall: [m].
        middle: (3,) [m], of what stands there; `height` / 2 above the origin unless given.
    """
    clip = 2.0 if middle is None else 3.0  # seen from below, the wall shows farther from the light
    middle = (0.0, 0.0, height / 2) if middle is None else middle
    spec.visual.headlight.ambient = [0.45, 0.45, 0.45]
    spec.visual.headlight.diffuse = [0.28, 0.28, 0.28]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    direction = (0.4, 1.0, -0.5)
    spec.worldbody.add_light(  # its shadow map is centred on the robot
        type=mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[m - 2 * d for m, d in zip(middle, direction, strict=True)],
        dir=direction,
        diffuse=[0.33, 0.33, 0.33],
        specular=[0.2, 0.2, 0.2],
        castshadow=True,
    )
    # Hundreds of thin capsules make up the lines: coarse ones look the same and draw faster.
    spec.visual.quality.numslices, spec.visual.quality.numstacks = 10, 4
    spec.visual.quality.shadowsize, spec.visual.map.shadowclip = 4096, clip
    spec.stat.extent = 1.6 * height
    spec.stat.center = middle
    spec.visual.global_.azimuth = 90
    spec.visual.global_.elevation = -5
    _add_wall(spec, wall)


def _add_wall(spec: MjSpec, behind: float) -> None:
    spec.add_texture(
        name="grid",
        type=mjtTexture.mjTEXTURE_2D,
        builtin=mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.94, 0.945, 0.955],
        rgb2=[0.905, 0.912, 0.925],
        width=256,
        height=256,
    )
    grid = spec.add_material(name="grid", texrepeat=[10, 10], texuniform=True, specular=0.0)
    grid.textures[mjtTextureRole.mjTEXROLE_RGB] = "grid"
    turn, size = [0.7071067811865476, 0.7071067811865476, 0, 0], [1.5, 1.5, 0.1]
    add_visual(spec.worldbody, "PLANE", size, pos=[0, behind, 0], quat=turn, material="grid")


def _add_skin(chain: Chain, robot: RobotParams, rgba: Rgba) -> None:
    """Add the surface of a straight cylinder and tie it to the links of the chain."""
    gaps = np.diff(chain.layout.stations)  # every link has a ring at least
    distance = min(_RING_DISTANCE, 0.5 * gaps[gaps > 0].min(initial=np.inf))
    stations, radii = _profile(robot, distance)
    weights = _bone_weights(stations, chain.layout.stations, robot.length)
    ring_of_vertex = np.repeat(np.arange(len(stations)), _SIDES)
    bones = [np.flatnonzero(w > 1e-6) for w in weights[ring_of_vertex].T]
    origins = np.concatenate(([0.0], chain.layout.stations))
    chain.spec.add_skin(
        name=BODY_SKIN,
        rgba=rgba,
        vert=_vertices(stations, radii).ravel(),
        face=_faces(len(stations)).ravel(),
        bodyname=[body.name for body in chain.bodies],
        bindpos=np.stack([0 * origins, 0 * origins, origins], axis=1).ravel(),
        bindquat=np.tile([1.0, 0.0, 0.0, 0.0], len(origins)),
        vertid=[ids.tolist() for ids in bones],
        vertweight=[weights[ring_of_vertex[ids], i].tolist() for i, ids in enumerate(bones)],
    )


def _profile(robot: RobotParams, distance: float) -> tuple[ndarray, ndarray]:
    """Arc length (n,) and radius (n,) [m] of the rings, with a rounded rim and a closed tip."""
    length, radius = robot.length, _radius(robot, robot.length)
    edge = _ROUNDING * radius
    rings = int(np.ceil((length - edge) / distance)) + 1
    body = np.linspace(0.0, length - edge, rings)
    angle = np.linspace(0, np.pi / 2, 4)[1:]
    stations = np.concatenate((body, length - edge * (1 - np.sin(angle)), [length]))
    rim = radius - edge * (1 - np.cos(angle))
    return stations, np.concatenate((robot.backbone.outer_radius(body), rim, [0.0]))


def _bone_weights(stations: ndarray, hinges: ndarray, length: float) -> ndarray:
    """Share (n, 1 + n_hinges) of each link in the position of each ring.

    It passes from one link to the next between their middles. The smooth step makes the bent
    centre line tangent to every link in its middle.
    """
    edges = np.concatenate(([0.0], hinges, [length]))
    middles = (edges[:-1] + edges[1:]) / 2
    u = np.clip((stations[:, None] - middles[:-1]) / np.diff(middles), 0, 1)
    passed = np.hstack((np.ones((len(stations), 1)), u * u * (3 - 2 * u)))
    return passed - np.hstack((passed[:, 1:], np.zeros((len(stations), 1))))


def _vertices(stations: ndarray, radii: ndarray) -> ndarray:
    """(n * _SIDES, 3) [m], rounded to keep exported scenes short."""
    angle = 2 * np.pi * np.arange(_SIDES) / _SIDES
    x, y = np.multiply.outer(radii, np.cos(angle)), np.multiply.outer(radii, np.sin(angle))
    z = np.broadcast_to(stations[:, None], x.shape)
    return np.stack([x, y, z], axis=-1).reshape(-1, 3).round(5)


def _faces(rings: int) -> ndarray:
    """(n_faces, 3) vertex indices, counter-clockwise seen from outside."""
    ring, side = np.meshgrid(np.arange(rings - 1), np.arange(_SIDES), indexing="ij")
    a, b = ring * _SIDES + side, ring * _SIDES + (side + 1) % _SIDES
    c, d = a + _SIDES, b + _SIDES
    lower, upper = np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)
    return np.concatenate((lower.reshape(-1, 3), upper.reshape(-1, 3)))


# ---------------------------------------------------------------- sensors, loads, markers, cameras

_TIP_SENSORS = {
    "tip_position": mjtSensor.mjSENS_FRAMEPOS,
    "tip_velocity": mjtSensor.mjSENS_FRAMELINVEL,
}

_CAMERA_DISTANCE = 1.5  # m
_WORLD_SITE = "world_axes"


def add_tip_sensors(spec: MjSpec) -> None:
    """Position and velocity of the tip, both in world axes."""
    for name, kind in _TIP_SENSORS.items():
        spec.add_sensor(name=name, type=kind, objtype=mjtObj.mjOBJ_SITE, objname=TIP_SITE)


def add_load(chain: Chain, load: Load) -> None:
    """Actuator that applies a load through a site; its control scales the load."""
    body, height = chain.locate(load.station)
    site = body.add_site(name=f"{load.name}_point", pos=[0, 0, height], size=[1e-3, 0, 0])
    actuator = chain.spec.add_actuator(
        name=load.name,
        target=site.name,
        trntype=mjtTrn.mjTRN_SITE,
        gear=[*load.force, *load.moment],
    )
    if not load.follows:  # the load keeps the world's directions
        if chain.spec.site(_WORLD_SITE) is None:
            chain.spec.worldbody.add_site(name=_WORLD_SITE, size=[1e-3, 0, 0])
        actuator.refsite = _WORLD_SITE
    actuator.set_to_motor()


def add_marker(spec: MjSpec, marker: Marker) -> None:
    """Ball on a mocap body of the marker's name."""
    body = spec.worldbody.add_body(name=marker.name, mocap=True, pos=marker.position)
    add_visual(body, "SPHERE", [marker.radius, 0, 0], marker.rgba)


def add_path(spec: MjSpec, path: PathMarker) -> None:
    """Capsules between consecutive points."""
    for start, end in pairwise(path.points):
        size = [path.radius, 0, 0]
        add_visual(spec.worldbody, "CAPSULE", size, path.rgba, fromto=[*start, *end])


def add_camera(spec: MjSpec, camera: Camera) -> None:
    """Orthographic camera in front of the x-z plane: x to the right."""
    _, y, z = (_CAMERA_DISTANCE * x for x in camera.towards)
    spec.worldbody.add_camera(
        name=camera.name,
        pos=[camera.center[0], y, camera.center[1] + z],
        xyaxes=[1, 0, 0, *camera.up],
        proj=mjtProjection.mjPROJ_ORTHOGRAPHIC,
        fovy=camera.height,
    )


def add_visual(
    body: MjsBody, shape: str, size: Sequence[float], rgba: Rgba | None = None, **geom: Any
) -> None:
    """Geom of a shape such as "BOX" that is only seen: no mass, no contacts."""
    if rgba is not None:
        geom["rgba"] = rgba
    kind = getattr(mjtGeom, f"mjGEOM_{shape}")
    body.add_geom(type=kind, size=size, mass=0, contype=0, conaffinity=0, **geom)
