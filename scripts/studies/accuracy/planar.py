"""Equilibria with a known tip, computed without any mesh."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.evaluation.models.runs import Limit, best_of
from softrobot_env.robots import ARM, CANTILEVER_STIFF, CANTILEVER_WEAK, RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.robots.loads import Load
from softrobot_env.scene.chain import joint_angles
from softrobot_env.scene.timestep import linearize
from studies.accuracy.cases import BENDING, CONTINUUM, Contestant, Physics, Row
from studies.beams import chain_scene, mode_frequency, tip_twist, weightless
from studies.truths.analytic import (
    arc_tip,
    bent_rod,
    elastica,
    section,
    torsion_angle,
    torsion_frequency,
)
from studies.truths.continuum_arc import TEXT as CONTINUUM_ARC
from studies.truths.continuum_arc import continuum_arc_tip
from studies.truths.tendon_rod import guided_rod, tendon_rod
from studies.truths.varying_beam import bending_frequencies

_GUIDE_DISTANCE = 1 / 12  # m
_SHEAR = "geometrically exact rod, k = {:g} (boundary-value solution)"

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
        if k is None:
            rod = elastica(robot.length, robot.bending_stiffness, **loads)
            return rod.tip, "elastica (boundary-value solution)"
        return bent_rod(robot.length, section(robot, k), **loads).tip, _SHEAR.format(k)

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


# ---------------------------------------------------------------- frequencies and torsion

MOMENT = 0.01  # N m

_MOMENT_LOAD = Load("load", CANTILEVER_WEAK.length, moment=(0.0, 0.0, MOMENT))


@dataclass(frozen=True)
class ScalarCase:
    """A number with a closed form.

    Attributes:
        name: Name in the report.
        robot: The robot, without gravity.
        truth: The number, and where it comes from.
        torsion: Whether the robot twists, else it bends.
        static: Whether the number is the tip's twist [rad], else a frequency [Hz].
    """

    name: str
    robot: RobotParams
    truth: Callable[[Physics], tuple[float, str]]
    torsion: bool
    static: bool


def scalar_cases() -> list[ScalarCase]:
    """All cases whose result is a number."""
    weak, stiff = weightless(CANTILEVER_WEAK), weightless(CANTILEVER_STIFF)
    twist, turning = torsion_angle(weak, MOMENT), torsion_frequency(weak)
    analytic = "analytic torsion"
    return [
        ScalarCase("bending_frequency_weak", weak, _bending(weak), False, False),
        ScalarCase("bending_frequency_stiff", stiff, _bending(stiff), False, False),
        ScalarCase("torsion_static", weak, lambda _: (twist, analytic), True, True),
        ScalarCase("torsion_frequency", weak, lambda _: (turning, analytic), True, False),
    ]


def _bending(robot: RobotParams) -> Callable[[Physics], tuple[float, str]]:
    def truth(physics: Physics) -> tuple[float, str]:
        k = physics.shear_coefficient
        text = "Rayleigh beam" if k is None else f"Timoshenko beam, k = {k:g}"
        return bending_frequencies(robot, 1, k)[0], f"{text} (analytic)"

    return truth


def beam_row(case: ScalarCase, contestant: Contestant, n: int, repeats: int = 1) -> Row:
    """Compare a beam model."""
    space = "torsion" if case.torsion else "planar"
    loads = (_MOMENT_LOAD,) if case.static else ()
    model = contestant.build(case.robot, n, loads, space)
    if case.static:
        one = np.ones(1)
        time, q = best_of(lambda: model.equilibrium(one, check_stability=False), repeats)
        found = tip_twist(model, q)
    else:
        time, found = best_of(lambda: mode_frequency(model, case.torsion), repeats)
    return _row(case, contestant.name, contestant.physics, n, time, found)


def chain_row(case: ScalarCase, rule: str, n: int, repeats: int = 1) -> Row:
    """Compare the MuJoCo chain."""
    options = {"bending": "spatial" if case.torsion else "planar", "torsion": case.torsion}
    loads = (_MOMENT_LOAD,) if case.static else ()
    scene = chain_scene(case.robot, rule, n, loads=loads, **options)
    if case.static:
        time, q = best_of(lambda: scene.equilibrium(np.ones(1)), repeats)
        found = float(joint_angles(scene.model, q)[:, 2].sum())
    else:
        time, found = best_of(lambda: _chain_frequency(scene.model, case.torsion), repeats)
    return _row(case, f"mujoco_chain/{rule}", BENDING, n, time, found)


def _chain_frequency(model: mujoco.MjModel, torsion: bool) -> float:
    chain = linearize(model)
    if not torsion:
        return float(chain.frequencies()[0] / (2 * np.pi))
    # In the straight pose torsion is decoupled: the third coordinate of each ball joint.
    mass, stiffness = (m[2::3, 2::3] for m in (chain.mass, chain.stiffness))
    squares = np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real
    return float(np.sqrt(squares.min()) / (2 * np.pi))


def _row(case: ScalarCase, model: str, physics: Physics, n: int, time: float, found: float) -> Row:
    truth, text = case.truth(physics)
    values = {"e_relative": abs(found / truth - 1), "value": found, "wall_time": time}
    about = {"physics": physics.name, "reference": text}
    return Row("number", case.name, model, n, **about, **values)
