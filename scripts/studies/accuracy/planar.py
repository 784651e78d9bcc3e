"""Equilibria with a known tip, computed without any mesh."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy import ndarray

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.evaluation.models.runs import Limit
from softrobot_env.robots import ARM, CANTILEVER_STIFF, CANTILEVER_WEAK, RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.robots.loads import Load
from studies.accuracy.cases import CONTINUUM, Physics
from studies.beams import weightless
from studies.truths.analytic import (
    arc_tip,
    bent_rod,
    section,
)
from studies.truths.continuum_arc import TEXT as CONTINUUM_ARC
from studies.truths.continuum_arc import continuum_arc_tip
from studies.truths.tendon_rod import guided_rod, tendon_rod

_GUIDE_DISTANCE = 1 / 12  # m
_SHEAR = "geometrically exact rod, k = {:g}"

#: Tip (2,) [m] in (x, z) and where it comes from, for some physics.
Truth = Callable[[Physics], tuple[ndarray, str]]


@dataclass(frozen=True)
class StaticCase:
    """An equilibrium with a known tip.

    Attributes:
        name: Name in the report.
        robot: The robot, with the gravity of the case.
        exact: The true tip for some physics, and where it comes from.
        loads: Dead loads, applied in full.
        reduced: (n_inputs,) [N], tendon inputs; empty for robots without tendons.
        uniform: Whether the truth for the continuum has its large strains, which are known where
            bending is uniform; else it is that of a rod.
    """

    name: str
    robot: RobotParams
    exact: Truth
    loads: tuple[Load, ...] = ()
    reduced: tuple[float, ...] = ()
    uniform: bool = False

    def truth(self, physics: Physics) -> Limit:
        """The true tip (2,) [m] in (x, z)."""
        tip, text = self.exact(physics)
        return Limit(tip, 0.0, text)

    @property
    def ctrl(self) -> ndarray:
        """Inputs (n_tendons + n_loads,): tensions [N], then full loads [1]."""
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
        guided_tendon(20.0),
    ]


def self_weight(name: str, robot: RobotParams) -> StaticCase:
    """A robot under its own weight."""
    weight = robot.mass_per_length * np.array(robot.gravity)[[0, 2]]
    return StaticCase(name, robot, _dead_load(robot, weight=tuple(weight)))


def tip_moment(moment: float) -> StaticCase:
    """The weak cantilever without gravity under a tip moment [N m]; no force, so no shear."""
    robot = weightless(CANTILEVER_WEAK)
    tip = arc_tip(robot.length, moment / robot.bending_stiffness)
    load = Load("load", robot.length, moment=(0.0, moment, 0.0))

    def truth(physics: Physics) -> tuple[ndarray, str]:
        if physics == CONTINUUM:
            return continuum_arc_tip(robot, moment), CONTINUUM_ARC
        return tip, "circular arc (exact)"

    return StaticCase(f"tip_moment_{moment:g}Nm", robot, truth, (load,), uniform=True)


def tip_force(force: float) -> StaticCase:
    """The weak cantilever without gravity under a lateral tip force [N]."""
    robot = weightless(CANTILEVER_WEAK)
    load = Load("load", robot.length, force=(force, 0.0, 0.0))
    truth = _dead_load(robot, force=(force, 0.0))
    return StaticCase(f"tip_force_{force:g}N", robot, truth, (load,))


def _dead_load(robot: RobotParams, **loads: tuple[float, float]) -> Truth:
    def truth(physics: Physics) -> tuple[ndarray, str]:
        k = physics.shear_coefficient
        text = "elastica" if k is None else _SHEAR.format(k)
        return bent_rod(robot.length, section(robot, k), **loads).tip, text

    return truth


def tendon(force: float) -> StaticCase:
    """The arm with the longest tendon pair, in channels, at `force` [N]."""
    reduced = (0.0, 0.0, force)

    def truth(physics: Physics) -> tuple[ndarray, str]:
        if physics.shear_coefficient is None:
            tip = ConstantCurvatureStatics(ARM).tip(np.array(reduced))
            return tip, "constant curvature (exact)"
        if physics == CONTINUUM:
            return continuum_arc_tip(ARM, tension=force, offset=ARM.outer_radius), CONTINUUM_ARC
        tip = _pulled_tip(tendon_rod, ARM, reduced, physics)
        return tip, "constant curvature and compression (exact)"

    return StaticCase("tendon_static", ARM, truth, reduced=reduced, uniform=True)


def guided_tendon(force: float) -> StaticCase:
    """The same with guides every 1/12 m, between which the tendons are straight."""
    robot, reduced = guided_arm(), (0.0, 0.0, force)

    @cache
    def truth(physics: Physics) -> tuple[ndarray, str]:
        text = "elastica" if physics.shear_coefficient is None else _SHEAR.split(",")[0]
        return _pulled_tip(guided_rod, robot, reduced, physics), f"{text} between the guides"

    return StaticCase("tendon_guided", robot, truth, reduced=reduced)


def guided_arm() -> RobotParams:
    """The arm with discrete guides at multiples of 1/12 m."""

    def guides(end: float) -> tuple[float, ...]:
        return tuple(k * _GUIDE_DISTANCE for k in range(1, round(end / _GUIDE_DISTANCE)))

    return replace(ARM, tendons=tuple(replace(t, guides=guides(t.end)) for t in ARM.tendons))


def _pulled_tip(
    rod: Callable, robot: RobotParams, reduced: tuple[float, ...], physics: Physics
) -> ndarray:
    tension = TendonMap(robot).tension(np.array(reduced))
    return rod(robot, tension, [robot.length], physics.shear_coefficient).tip[[0, 2]]
