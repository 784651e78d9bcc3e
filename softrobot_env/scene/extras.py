"""Optional parts: sensors, loads, markers, paths and cameras."""

from itertools import pairwise
from typing import Any

import mujoco

from softrobot_env.scene.chain import TIP_SITE, Chain
from softrobot_env.scene.config import Camera, Load, Marker, PathMarker

TIP_POSITION_SENSOR = "tip_position"
TIP_VELOCITY_SENSOR = "tip_velocity"

_CAMERA_DISTANCE = 1.5  # m
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
    add_visual(
        body, type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[marker.radius, 0, 0], rgba=marker.rgba
    )


def add_path(spec: mujoco.MjSpec, path: PathMarker) -> None:
    """Capsules between consecutive points."""
    for start, end in pairwise(path.points):
        add_visual(
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


def add_visual(body: mujoco.MjsBody, **geom: Any) -> None:
    """Geom that is only seen: no mass, no contacts."""
    body.add_geom(mass=0, contype=0, conaffinity=0, **geom)
