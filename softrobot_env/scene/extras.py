"""Optional parts: sensors, loads, markers, cameras and the visible body."""

from dataclasses import replace
from math import radians, tan

import mujoco
import numpy as np

from softrobot_env.robots import RobotParams
from softrobot_env.scene.chain import TIP_SITE, Chain
from softrobot_env.scene.config import Appearance, Camera, Load, Marker, PathMarker
from softrobot_env.scene.tendons import route_through_guides

TIP_POSITION_SENSOR = "tip_position"
TIP_VELOCITY_SENSOR = "tip_velocity"
TENDON_LINE = "{}_line"

_FIELD_OF_VIEW = 20.0  # degrees; narrow, so that the picture is nearly free of perspective
_WORLD_SITE = "world_axes"


def add_tip_sensors(spec: mujoco.MjSpec) -> None:
    """Position and velocity of the tip, both in world axes."""
    for name, kind in (
        (TIP_POSITION_SENSOR, mujoco.mjtSensor.mjSENS_FRAMEPOS),
        (TIP_VELOCITY_SENSOR, mujoco.mjtSensor.mjSENS_FRAMELINVEL),
    ):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=TIP_SITE)


def add_load(chain: Chain, load: Load) -> None:
    """Actuator that applies a dead load through a site; its control scales the load."""
    body, height = chain.locate(load.station)
    site = body.add_site(name=f"{load.name}_point", pos=[0, 0, height], size=[1e-3, 0, 0])
    if chain.spec.site(_WORLD_SITE) is None:
        chain.spec.worldbody.add_site(name=_WORLD_SITE, size=[1e-3, 0, 0])
    actuator = chain.spec.add_actuator(
        name=load.name,
        target=site.name,
        refsite=_WORLD_SITE,  # the load keeps the world's directions
        trntype=mujoco.mjtTrn.mjTRN_SITE,
        gear=[*load.force, *load.moment],
    )
    actuator.set_to_motor()


def add_marker(spec: mujoco.MjSpec, marker: Marker) -> None:
    """Ball on a mocap body of the marker's name."""
    body = spec.worldbody.add_body(name=marker.name, mocap=True, pos=marker.position)
    _add_visual(
        body, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[marker.radius, 0, 0], rgba=marker.rgba
    )


def add_path(spec: mujoco.MjSpec, path: PathMarker) -> None:
    """Capsules between consecutive points."""
    for start, end in zip(path.points, path.points[1:], strict=False):
        _add_visual(
            spec.worldbody,
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[*start, *end],
            size=[path.radius, 0, 0],
            rgba=path.rgba,
        )


def add_camera(spec: mujoco.MjSpec, camera: Camera) -> None:
    """Camera in front of the bending plane: x to the right, z up."""
    distance = camera.height / 2 / tan(radians(_FIELD_OF_VIEW / 2))
    spec.worldbody.add_camera(
        name=camera.name,
        pos=[camera.center[0], -distance, camera.center[1]],
        xyaxes=[1, 0, 0, 0, 0, 1],
        fovy=_FIELD_OF_VIEW,
    )


def add_appearance(chain: Chain, robot: RobotParams, look: Appearance) -> None:
    """Visible links, base, wall and light, and a drawn line for every channel tendon."""
    ends = np.concatenate(([0.0], chain.layout.stations, [robot.length]))
    for body, start, end in zip(chain.bodies, ends, ends[1:], strict=False):
        _add_visual(
            body,
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=[0, 0, 0, 0, 0, end - start],
            size=[robot.outer_radius, 0, 0],
            rgba=look.link_rgba,
        )
    for tendon in robot.tendons:
        _draw_tendon(chain, tendon, look)
    _add_surroundings(chain.spec, robot)


def _draw_tendon(chain: Chain, tendon, look: Appearance) -> None:
    """Colour a guided tendon; give a channel tendon a line that carries no force."""
    line = chain.spec.tendon(tendon.name)
    if not tendon.guides:
        step = chain.length / (4 * chain.layout.pieces)
        guides = tuple(np.arange(step, tendon.end - step / 2, step))
        drawn = replace(tendon, guides=guides)
        line = route_through_guides(chain, drawn, TENDON_LINE.format(tendon.name))
    line.rgba = look.tendon_rgba
    line.width = 0.0025


def _add_visual(body: mujoco.MjsBody, **geom) -> None:
    """Geom that is only seen: no mass, no contacts."""
    body.add_geom(mass=0, contype=0, conaffinity=0, **geom)


def _add_surroundings(spec: mujoco.MjSpec, robot: RobotParams) -> None:
    spec.visual.headlight.ambient = [0.45, 0.45, 0.45]
    spec.visual.headlight.diffuse = [0.45, 0.45, 0.45]
    spec.visual.headlight.specular = [0.1, 0.1, 0.1]
    spec.worldbody.add_light(
        pos=[-0.5, -2.0, 2.0], dir=[0.2, 1.0, -0.8], diffuse=[0.4, 0.4, 0.4], castshadow=True
    )
    spec.add_texture(
        name="grid",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.95, 0.95, 0.96],
        rgb2=[0.91, 0.92, 0.94],
        width=256,
        height=256,
    )
    grid = spec.add_material(name="grid", texrepeat=[10, 10], texuniform=True, reflectance=0.0)
    grid.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grid"
    behind = 2 * robot.outer_radius
    _add_visual(
        spec.worldbody,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        pos=[0, behind, 0],
        quat=[0.7071067811865476, 0.7071067811865476, 0, 0],
        size=[3, 3, 0.1],
        material="grid",
    )
    size = 1.6 * robot.outer_radius
    _add_visual(
        spec.worldbody,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=[0, 0, -robot.outer_radius],
        size=[size, size, robot.outer_radius],
        rgba=[0.3, 0.32, 0.36, 1],
    )
