"""Equilibria with a known tip, computed without MuJoCo."""

from dataclasses import dataclass, replace

import numpy as np

from softrobot_env.beams.analytic import arc_tip, elastica
from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.robots import ARM, CANTILEVER_STIFF, CANTILEVER_WEAK, RobotParams
from softrobot_env.scene.config import Load
from softrobot_env.tendon_map import TendonMap

_ELASTICA = "elastica (boundary-value solution)"


@dataclass(frozen=True)
class StaticCase:
    """An equilibrium with a known tip.

    Attributes:
        name: Name in the report.
        robot: The robot, with the gravity of the case.
        tip: (2,) [m], true tip in (x, z).
        reference: Where the truth comes from.
        loads: Dead loads, applied in full.
        reduced: (n_inputs,) [N], tendon inputs; empty for robots without tendons.
    """

    name: str
    robot: RobotParams
    tip: np.ndarray
    reference: str
    loads: tuple[Load, ...] = ()
    reduced: tuple[float, ...] = ()

    @property
    def ctrl(self) -> np.ndarray:
        """Controls (n_tendons + n_loads,) of the scene: tensions [N], then full loads [1]."""
        tension = TendonMap(self.robot).tension(np.array(self.reduced)) if self.reduced else ()
        return np.array([*tension, *np.ones(len(self.loads))])


def static_cases() -> list[StaticCase]:
    """All static cases of the accuracy benchmark."""
    return [
        self_weight("self_weight_weak", CANTILEVER_WEAK),
        self_weight("self_weight_stiff", CANTILEVER_STIFF),
        tip_moment(1.0),
        tip_force(3.0),
        tendon(20.0),
    ]


def self_weight(name: str, robot: RobotParams) -> StaticCase:
    """A robot under its own weight."""
    weight = robot.mass_per_length * np.array(robot.gravity)[[0, 2]]
    rod = elastica(robot.length, robot.bending_stiffness, weight=tuple(weight))
    return StaticCase(name, robot, rod.tip, _ELASTICA)


def tip_moment(moment: float) -> StaticCase:
    """The weak cantilever without gravity under a tip moment [N m]."""
    robot = _weightless()
    tip = arc_tip(robot.length, moment / robot.bending_stiffness)
    load = Load("load", robot.length, moment=(0.0, moment, 0.0))
    return StaticCase(f"tip_moment_{moment:g}Nm", robot, tip, "circular arc (exact)", (load,))


def tip_force(force: float) -> StaticCase:
    """The weak cantilever without gravity under a lateral tip force [N]."""
    robot = _weightless()
    rod = elastica(robot.length, robot.bending_stiffness, force=(force, 0.0))
    load = Load("load", robot.length, force=(force, 0.0, 0.0))
    return StaticCase(f"tip_force_{force:g}N", robot, rod.tip, _ELASTICA, (load,))


def tendon(force: float) -> StaticCase:
    """The arm with the longest tendon pair at `force` [N]."""
    reduced = (0.0, 0.0, force)
    tip = ConstantCurvatureStatics(ARM).tip(np.array(reduced))
    return StaticCase("tendon_static", ARM, tip, "constant curvature (exact)", reduced=reduced)


def _weightless() -> RobotParams:
    return replace(CANTILEVER_WEAK, gravity=(0.0, 0.0, 0.0))
