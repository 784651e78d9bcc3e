"""Chains of every kind of joints, without gravity."""

from dataclasses import replace

from softrobot_env.robots import CANTILEVER_WEAK
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import RULES

ROBOT = replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, 0.0))
LENGTH, EI = ROBOT.length, ROBOT.bending_stiffness

#: A chain that twists, without springs between its pieces.
TWISTING = {"bending": "spatial", "torsion": True, "rule": "balanced2"}

#: Robot and options of every kind of chain.
KINDS = {
    "planar": (ROBOT, {}),
    "universal": (ROBOT, {"bending": "spatial"}),
    "ball": (ROBOT, TWISTING),
    "three_hinges": (replace(ROBOT, poisson_ratio=0.5), TWISTING),
}

#: Without springs between the pieces, which tests/scene/test_coupling.py is for.
SIMPLE_RULES = [rule for rule in RULES if rule != "coupled2"]


def chain(kind: str = "planar", robot=None, **options) -> Scene:
    """A chain of a kind, of its own robot or of another."""
    default, bending = KINDS[kind]
    return build_scene(SceneConfig(robot or default, **bending | options))
