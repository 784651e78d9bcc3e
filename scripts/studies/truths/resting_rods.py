"""Rods at rest on something, against the closed form and elasticas of `studies.truths`."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import pi

import numpy as np
from numpy import ndarray

from softrobot_env.robots import Base, RobotParams
from softrobot_env.robots.loads import Load
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.contacts import Touch
from softrobot_env.scene.objects import Contacts, Cylinder
from studies.truths.touching_rod import propped_reaction, rod_on_post, rod_round_cylinder

_ACROSS = (pi / 2, 0.0, 0.0)

ROD = RobotParams("rod", 0.4, 0.005, 0.0, 5e6, 1000.0, 0.01, 12)
_LYING = replace(ROD, gravity=(0.0, 0.0, -0.1), base=Base((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)))

#: [N/m2], of the skin.
STIFFNESS = 1e6


@dataclass(frozen=True)
class Exact:
    """A rod at rest, and what is exact of it.

    Attributes:
        config: The scene, loaded by its inputs of one.
        contact: From what touches to the sum of all forces on the rod (3,) [N].
        pressed: The same, to the sum of their sizes [N].
        tip: (3,) [m]; None if unknown.
    """

    config: SceneConfig
    contact: Callable[[tuple[Touch, ...]], ndarray]
    pressed: Callable[[tuple[Touch, ...]], float]
    tip: ndarray | None


_SKIN = Contacts(friction=0.0, stiffness=STIFFNESS)


def _across(name: str, radius: float, x: float, z: float) -> Cylinder:
    """A cylinder whose axis is along y."""
    return Cylinder(name=name, radius=radius, length=0.1, turn=_ACROSS, position=(x, 0.0, z))


def _propped() -> Exact:
    """A cantilever under its weight with a prop near its end."""
    station, radius = 0.36, 0.02
    prop = _across("prop", radius, station, -radius - _LYING.outer_radius)
    load = _LYING.mass_per_length * -_LYING.gravity[2]
    beam = _LYING.length, _LYING.bending_stiffness, load, station

    def reaction(touches: tuple[Touch, ...]) -> float:
        size = sum(float(np.linalg.norm(touch.force)) for touch in touches)
        depth = sum(touch.depth for touch in touches) / len(touches)
        return propped_reaction(*beam, depth / size)

    config = SceneConfig(_LYING, contacts=_SKIN, objects=(prop,))
    return Exact(config, lambda t: np.array([0.0, 0.0, reaction(t)]), reaction, None)


def _loaded(force: float, post: tuple[float, float], radius: float, exact: Callable) -> Exact:
    """A rod pressed on a round post by a dead force [N] at its tip."""
    truth = exact(ROD.length, ROD.bending_stiffness, (force, 0.0), post, radius)
    thing = _across("post", radius - ROD.outer_radius, *post)
    load = Load("push", ROD.length, force=(force, 0.0, 0.0))
    config = SceneConfig(ROD, contacts=_SKIN, objects=(thing,), loads=(load,))
    contact, tip = (np.array([x, 0.0, z]) for x, z in (truth.contact, truth.tip))
    return Exact(config, lambda _: contact, lambda _: truth.pressed, tip)


#: Name -> what makes the check; the rod bends over a thin post, and lies on an arc of a thick one.
CHECKS: dict[str, Callable[[], Exact]] = {
    "propped cantilever": _propped,
    "rod on post": partial(_loaded, 0.06, (0.025, 0.2), 0.025, rod_on_post),
    "rod round cylinder": partial(_loaded, 0.3, (0.1, 0.15), 0.1, rod_round_cylinder),
}
