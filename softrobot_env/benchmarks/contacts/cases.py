"""The moving scenes of the contact study."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from softrobot_env.robots import ARM, Base, RobotParams
from softrobot_env.robots.loads import Load
from softrobot_env.robots.registry import GRIPPERS, find_robot
from softrobot_env.scene.assembly import AssembledScene, Assembly, build_assembly
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.gripper import gripper_scene
from softrobot_env.scene.objects import Box, Capsule, Contacts, Cylinder, Ground, Object, Sphere
from softrobot_env.scene.registry import scene_of

_DOWN = (0.0, 0.0, -9.81)
_ACROSS = (pi / 2, 0.0, 0.0)  # an axis along y

_ROD = RobotParams(
    "rod",
    length=0.3,
    outer_radius=0.01,
    inner_radius=0.0,
    youngs_modulus=5e5,
    density=1000.0,
    damping_time=0.02,
    pieces=12,
    gravity=_DOWN,
    base=Base((0.0, 0.0, 0.06), (1.0, 0.0, 0.0)),
)
_CURL = replace(
    _ROD,
    length=0.4,
    outer_radius=0.005,
    damping_time=0.05,
    pieces=24,
    gravity=(0.0, 0.0, 0.0),
    base=None,
)


@dataclass(frozen=True)
class Case:
    """A moving scene.

    Attributes:
        config: Of one robot without contacts, or of several.
        full: (n_inputs,) that the inputs reach.
        rise: [s] until then, from zero.
        duration: [s].
        objects: What the robot touches.
        self_contact: Whether the robot touches itself.
    """

    config: SceneConfig | Assembly
    full: tuple[float, ...]
    rise: float
    duration: float
    objects: tuple[Object, ...] = ()
    self_contact: bool = False

    @property
    def robot(self) -> RobotParams:
        """The robot, or the first of several, which are alike."""
        config = self.config
        return config.robot if isinstance(config, SceneConfig) else config.members[0].config.robot

    def build(
        self, stiffness: float, friction: float, timestep: float | None = None
    ) -> Scene | AssembledScene:
        """The scene with a skin of a stiffness [N/m2], a friction coefficient and a timestep [s].

        Raises:
            ValueError: The contacts are too stiff for the timestep.
        """
        contacts = Contacts(
            stiffness=stiffness,
            friction=friction,
            self_contact=self.self_contact,
            between_robots=False,
        )
        touching = replace(self.config, contacts=contacts, objects=self.objects)
        if isinstance(touching, SceneConfig):
            return build_scene(replace(touching, timestep=timestep))
        return build_assembly(touching.with_timestep(timestep))

    def inputs(self, time: float) -> np.ndarray:
        """(n_inputs,) at a time [s]."""
        return np.array(self.full) * min(1.0, time / self.rise)


def _falling() -> Case:
    """A cantilever falls on the ground."""
    return Case(SceneConfig(_ROD), (), 1.0, 1.0, objects=(Ground(name="ground"),))


def _sweeping() -> Case:
    """The thesis' arm bends into a post."""
    post = Cylinder(name="post", radius=0.03, length=0.2, turn=_ACROSS, position=(0.15, 0.0, 0.35))
    return Case(SceneConfig(ARM), (8, 0, 8, 0, 8, 0), 0.2, 1.5, objects=(post,))


def _curling() -> Case:
    """A moment at the tip curls a rod one and a half times, so that it meets itself."""
    turns = 1.5 * 2 * pi * _CURL.bending_stiffness / _CURL.length
    load = Load("curl", _CURL.length, moment=(0.0, turns, 0.0), follows=True)
    return Case(SceneConfig(_CURL, loads=(load,)), (1,), 1.0, 2.0, self_contact=True)


def _pushing() -> Case:
    """The hanging arm pushes a ball over the ground; with much friction it jams."""
    hanging = replace(ARM, gravity=_DOWN, base=Base((0.0, 0.0, 0.5), (0.0, 0.0, -1.0)))
    ball = Sphere(name="ball", radius=0.05, density=400.0, position=(-0.085, 0.0, 0.03))
    ground = Ground(name="ground", position=(0.0, 0.0, -0.02))
    return Case(SceneConfig(hanging), (8, 0, 8, 0, 8, 0), 0.2, 1.0, objects=(ground, ball))


def _trunk() -> Case:
    """A hanging trunk of two sections swings into a box in space and shoves another."""
    config = scene_of(find_robot("hanging_trunk"))
    base = config.robot.base
    x, y, z = (np.array(base.position) + base.axes[:, 2] * config.robot.length).tolist()
    wall = Box(name="wall", size=(0.04, 0.4, 0.2), position=(x - 0.1, y, z + 0.05))
    crate = Box(name="crate", size=(0.05, 0.05, 0.05), mass=0.05, position=(x + 0.06, y, z))
    table = Ground(name="table", position=(x, y, z - 0.025))
    full = tuple(8.0 if k in (1, 4) else 0.0 for k in range(len(config.robot.tendons)))
    return Case(config, full, 0.1, 1.0, objects=(wall, crate, table))


def _gripping() -> Case:
    """Two fingers of the gripper close on a free bar that lies on the palm."""
    gripper = GRIPPERS["gripper"]
    left, middle, _ = gripper.fingers
    x, _, z = left.base.position
    left = replace(left, base=replace(left.base, position=(x, 0.0, z)))
    pair = replace(gripper, fingers=(left, middle))
    bar = Capsule(
        name="bar",
        radius=0.03,
        length=0.06,
        turn=_ACROSS,
        mass=0.08,
        position=(0.0, 0.0, gripper.seat(0.03) + 1e-4),
    )
    scene = gripper_scene(pair, (bar,), control_period=0.01)
    return Case(scene, (20.0, 20.0), 0.3, 0.5, objects=scene.objects)


#: Name -> what makes the case.
CASES: dict[str, Callable[[], Case]] = {
    "rod falls on ground": _falling,
    "arm sweeps into post": _sweeping,
    "rod curls on itself": _curling,
    "arm pushes ball": _pushing,
    "trunk, box and wall": _trunk,
    "gripper closes on bar": _gripping,
}
