"""Random robots in random motion, of every kind of which derivatives are known."""

from dataclasses import dataclass, replace

import numpy as np
from mujoco import MjData, mj_kinematics
from numpy import ndarray

from softrobot_env.robots import Base, Disc, Drive, Head, RobotParams, Section, Tendon
from softrobot_env.robots.loads import Load
from softrobot_env.robots.tendons import FeedLine
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.chain import TIP_SITE
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.objects import Contacts, Sphere

#: How robots bend, and how their tendons run.
BENDING = ("planar", "spatial", "twisting")
ROUTES = ("straight", "converging", "guides", "helix")

#: Control periods of robots that touch something.
PRESSED = 4

#: What rubs along tendons: nothing, whatever their tension, or as it grows.
FRICTION = ("", "", "along", "", "dry")


@dataclass(frozen=True)
class Moving:
    """A robot and what moves it.

    Attributes:
        scene: The scene.
        inputs: (periods, n_inputs) of it.
        position, velocity: (nv,) at the start.
        parameters: Names of numbers of the robot.
    """

    scene: Scene
    inputs: ndarray
    position: ndarray
    velocity: ndarray
    parameters: tuple[str, ...]


def moving(seed: int, periods: int = 10, **options: object) -> Moving:
    """A random robot; options of its `SceneConfig` in place of usual ones."""
    rng = np.random.default_rng(seed)
    bending = BENDING[seed % 3]
    rubs = FRICTION[seed % len(FRICTION)]
    robot = _robot(rng, bending, ("tension", "length")[seed // 3 % 2], rubs)
    loads = ()
    if rng.random() < 0.5:
        force = rng.uniform(-0.3, 0.3, 3) * (1, bending != "planar", 1)
        loads = (
            Load(
                "load", robot.length * rng.uniform(0.3, 1), tuple(force), follows=rng.random() < 0.5
            ),
        )
        if robot.base is not None and bending == "planar":
            loads = (replace(loads[0], follows=True),)
    own = {"actuation": robot.drive.kind, "loads": loads, "torsion": bending == "twisting"}
    own |= {"bending": "planar" if bending == "planar" else "spatial", "rule": "gauss2"}
    scene = build_scene(SceneConfig(robot, **own | options))
    low, high = scene.model.actuator_ctrlrange.T.copy()
    low[len(robot.tendons) :], high[len(robot.tendons) :] = -1, 1
    held = rng.uniform(low, high, (periods // 3 + 1, len(low))) * 0.3
    inputs = np.clip(np.repeat(held, 3, axis=0)[:periods], low, high)
    nv = scene.model.nv
    position, velocity = 0.02 * rng.normal(size=nv), 0.3 * rng.normal(size=nv)
    return Moving(scene, inputs, position, velocity, _parameters(robot))


def touching(seed: int) -> Moving:
    """A random robot that begins with its end against a ball, on which friction acts."""
    rng, free = np.random.default_rng(seed), moving(seed, PRESSED)
    scene, robot = free.scene, free.scene.config.robot
    data = MjData(scene.model)
    mj_kinematics(scene.model, data)
    tip = data.site(TIP_SITE)
    radius = 2 * robot.backbone.sections[0].outer_radius[1]
    angle = 0.0 if scene.config.bending == "planar" else rng.uniform(0, 2 * np.pi)
    away = tip.xmat.reshape(3, 3) @ [np.cos(angle), np.sin(angle), 0.0]
    place = tip.xpos + 1.49 * radius * away
    ball = Sphere(name="ball", position=tuple(place.tolist()), radius=radius)
    contacts = Contacts(stiffness=2e3, friction=float(rng.choice([0.0, 0.1, 0.5])))
    own = {"pieces": robot.backbone.sections[0].pieces, "timestep": 1e-4}
    config = replace(scene.config, contacts=contacts, objects=(ball,), **own)
    still = np.zeros_like(free.position)
    return replace(free, scene=build_scene(config), position=still, velocity=0.1 * free.velocity)


def _robot(rng: np.random.Generator, bending: str, kind: str, rubs: str) -> RobotParams:
    length, radius = rng.uniform(0.15, 0.4), rng.uniform(0.006, 0.014)
    modulus = 10 ** rng.uniform(5.7, 6.6)
    section = Section(
        length, (radius, radius * rng.uniform(0.6, 1)), modulus, 1100.0,
        rng.uniform(0.01, 0.04), int(rng.integers(3, 6)), poisson_ratio=rng.uniform(0, 0.5),
        inner_radius=radius * 0.2,
    )  # fmt: skip
    routes = ROUTES[: 1 + int(rng.integers(4 if bending == "twisting" else 3))]
    limit = modulus * radius**3 / length * 3
    tendons = tuple(
        _tendon(rng, place, (radius, length, section.pieces), routes[-1], (limit, rubs))
        for place in _places(bending)
    )
    base = None
    if rng.random() < 0.5:
        direction = rng.normal(size=3) * (1, bending != "planar", 1)
        base = Base(tuple(rng.uniform(-0.3, 0.3, 3)), tuple(direction))
    head = Head(0.01, 0.005, (2e-6, 2e-6, 3e-6), 0.01) if rng.random() < 0.5 else None
    discs = (Disc.uniform(length / 2, 0.004, 2 * radius, 0.002),) if rng.random() < 0.4 else ()
    gravity = (0.0, 0.0, -9.81)
    return RobotParams(
        "random", sections=(section,), tendons=tendons, base=base, head=head, discs=discs,
        gravity=gravity, drive=Drive(kind),
        precurvature=(rng.uniform(-0.5, 0.5), 0.0),
    )  # fmt: skip


def _places(bending: str) -> list[tuple[str, float]]:
    if bending == "planar":
        return [("left", 0.0), ("right", np.pi)]
    return [("a", 0.1), ("b", 2.2), ("c", 4.3)]


def _tendon(
    rng: np.random.Generator,
    place: tuple[str, float],
    body: tuple[float, float, int],
    route: str,
    pull: tuple[float, str],
) -> Tendon:
    (name, angle), (radius, length, pieces), (limit, rubs) = place, body, pull
    x, y = (0.8 * radius * f(angle) for f in (np.cos, np.sin))
    x, y = (0.0 if abs(v) < 1e-9 else v for v in (x, y))
    options: dict = {}
    if route == "converging":
        options["route"] = ((length, 0.5 * x, 0.5 * y),)
    elif route == "guides":
        options["guides"] = tuple(length * (k + 1) / pieces for k in range(pieces - 1))
    elif route == "helix":
        options["turns"] = rng.uniform(-0.5, 0.5)
    if rubs == "dry":
        options["friction"] = 0.03 * limit
    if rubs == "along":
        options["friction_coefficient"] = rng.uniform(0.05, 0.3)
        options["feed_line"] = FeedLine(rng.uniform(0.5, 3), 0.1)
    stiffness = 40 * limit / length
    return Tendon(
        name, (x, y), length, 0, limit, stiffness=stiffness, pretension=0.1 * limit, **options
    )


def _parameters(robot: RobotParams) -> tuple[str, ...]:
    """Numbers of every kind."""
    names = [
        "youngs_modulus", "density", "damping_time", "tendon_radius", "sections.0.outer_radius.1",
        "sections.0.inner_radius", "precurvature.0", "gravity.2",
    ]  # fmt: skip
    if robot.tendons[0].is_straight:
        names.append("tendons.0.offset.0")
    if robot.tendons[0].friction:
        names.append("tendons.0.friction")
    if robot.tendons[0].friction_coefficient:
        names += ["tendons.0.friction_coefficient", "tendons.0.feed_line.bend_angle"]
    if robot.drive.kind == "length":
        names += ["tendons.0.stiffness", "tendons.0.pretension"]
    if robot.tendons[0].turns:
        names.append("tendons.0.turns")
    if robot.base is not None:
        names += ["base.position.0", "base.direction.0"]
    if robot.head is not None:
        names += ["head.mass", "head.output", "head.centre"]
    return tuple(names)
