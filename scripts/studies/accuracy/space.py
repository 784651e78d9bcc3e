"""Equilibria of slender rods in space whose tips are known exactly, without any mesh.

Loads are sampled as they are seen from the section that carries them, and gravity as seen from
the tip: then the shape is an initial-value problem (`studies.truths.spatial_rod`), and loads and
gravity follow in the world's directions, in which the models get them.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from math import cos, pi, sin
from time import perf_counter
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.beams.model import BeamModel
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import Scene
from studies.accuracy import cases
from studies.beams import chain_scene
from studies.lab import Job
from studies.truths.analytic import Section, bent_rod, section
from studies.truths.spatial_rod import SpatialShape, dead_loads, followed_rod, helix

#: A rod of thermoplastic polyurethane and a steel wire; length over radius is 80 and 750.
TPU = RobotParams("tpu", 0.4, 0.005, 0.0, 70e6, 1200.0, 0.01, 12, poisson_ratio=0.4)
STEEL = RobotParams("steel", 0.6, 0.0008, 0.0, 200e9, 7850.0, 0.01, 12, poisson_ratio=0.4)

#: Number of random wrenches, and of a quick run; their seed.
WRENCHES, QUICK_WRENCHES, _SEED = 20, 4, 16

#: Azimuth [rad] of the plane of planar cases, in no direction of the hinges.
_OBLIQUE = 0.5

#: Strength of the dead and the follower force in EI / L^2.
_FORCE = 5.0

#: Forces along the rod over those across: near its buckling load every model is at its worst.
_AXIAL = 0.3

_G = 9.81


@dataclass(frozen=True)
class SpatialCase:
    """A rod at rest.

    Attributes:
        robot: The rod, with the gravity of the case.
        loads: Loads, applied in full.
        tip: (3,) [m], exact.
    """

    robot: RobotParams
    loads: tuple[Load, ...]
    tip: ndarray


#: Name -> heading in the tables, see `cases_of`.
HEADINGS = {
    "wrenches": "random wrenches",
    "sag_0deg": "sag, 0°",
    "sag_45deg": "sag, 45°",
    "helix_dead": "helix, dead",
    "helix_follower": "helix, follows",
    "circle": "full circle",
    "force_dead": "force, dead",
    "force_follower": "force, follows",
}


def cases_of(name: str, robot: RobotParams, physics: cases.Physics, quick: bool = False) -> tuple:
    """The cases that go by a name, each a `SpatialCase`; many for wrenches, else one.

    Args:
        name: A key of `HEADINGS`.
        robot: A rod without gravity.
        physics: What the truth deforms by.
        quick: Fewer wrenches.
    """
    rod = section(robot, physics.shear_coefficient)
    if name == "wrenches":
        return tuple(wrenches(robot, rod, QUICK_WRENCHES if quick else WRENCHES))
    return (_SINGLE[name](robot, rod),)


def wrenches(robot: RobotParams, section: Section, count: int) -> Iterator[SpatialCase]:
    """Random forces and moments in the middle and at the tip, and gravity from any side.

    Universal joints at 12 stations err by about 0.7 and 1 mm on TPU and steel (see `scene.chain`).
    """
    rng, length = np.random.default_rng(_SEED), robot.length
    force, moment = section.bending / length**2, section.bending / length
    for _ in range(count):
        follower = tuple(
            Load(*place, _vector(rng, 0.85 * force, _AXIAL), _vector(rng, 0.5 * moment), True)
            for place in (("middle", length / 2), ("tip", length))
        )
        gravity = _G * np.array(_vector(rng, 1.0))
        weight = robot.mass_per_length * gravity / np.linalg.norm(gravity) * _G
        shape = _shape(robot, section, follower, weight)
        loads = tuple(dead_loads(follower, shape))
        yield SpatialCase(_heavy(robot, weight, shape), loads, shape.tip)


def _vector(rng: np.random.Generator, size: float, axial: float = 1.0) -> tuple[float, ...]:
    return tuple((size * rng.standard_normal(3) * (1.0, 1.0, axial)).tolist())


def _shape(robot: RobotParams, section: Section, loads: tuple, *weight: Any) -> SpatialShape:
    stations = np.array([0.0, robot.length / 2, robot.length])
    return followed_rod(robot.length, section, loads, stations, *weight)


def _heavy(robot: RobotParams, weight: ndarray, shape: SpatialShape) -> RobotParams:
    """A robot with the gravity that its tip sees as a weight (3,) [N/m]."""
    world = shape.frame[-1] @ weight / robot.mass_per_length
    return replace(robot, gravity=tuple(world.tolist()))


def _sag(azimuth: float) -> Callable[[RobotParams, Section], SpatialCase]:
    """A weight that bends the rod visibly."""

    def case(robot: RobotParams, section: Section) -> SpatialCase:
        # A tip turned by about w L^3 / (6 EI) sees a weight across the straight rod from behind.
        size = 6 * section.bending / robot.length**3
        across = np.array([cos(azimuth), sin(azimuth), 0.0])
        weight = size * (0.8 * across + np.array([0.0, 0.0, 0.6]))
        shape = _shape(robot, section, (), weight)
        return SpatialCase(_heavy(robot, weight, shape), (), shape.tip)

    return case


def _helix(follows: bool) -> Callable[[RobotParams, Section], SpatialCase]:
    """A tip moment across and about the rod."""

    def case(robot: RobotParams, section: Section) -> SpatialCase:
        moment = section.bending / robot.length * np.array([0.8, 2.0, 1.5])
        load = Load("load", robot.length, moment=tuple(moment.tolist()), follows=follows)
        tip = helix(robot.length, section, moment, np.array([0.0, robot.length]), follows).tip
        return SpatialCase(robot, (load,), tip)

    return case


def _circle(robot: RobotParams, section: Section) -> SpatialCase:
    """A tip moment that closes the rod to a circle: its tip comes back to the clamp."""
    size = 2 * pi * section.bending / robot.length
    moment = (-size * sin(_OBLIQUE), size * cos(_OBLIQUE), 0.0)
    load = Load("load", robot.length, moment=moment, follows=True)
    return SpatialCase(robot, (load,), np.zeros(3))


def _force_follower(robot: RobotParams, section: Section) -> SpatialCase:
    """A force on the tip, across the tip's section."""
    size = _FORCE * section.bending / robot.length**2
    across = (size * cos(_OBLIQUE), size * sin(_OBLIQUE), 0.0)
    load = Load("load", robot.length, force=across, follows=True)
    return SpatialCase(robot, (load,), _shape(robot, section, (load,)).tip)


def _force_dead(robot: RobotParams, section: Section) -> SpatialCase:
    """A force on the tip that stays across the straight rod: the planar elastica, turned."""
    size = _FORCE * section.bending / robot.length**2
    aside, along = bent_rod(robot.length, section, force=(size, 0.0)).tip
    turn = np.array([cos(_OBLIQUE), sin(_OBLIQUE)])
    load = Load("load", robot.length, force=(*(size * turn).tolist(), 0.0))
    return SpatialCase(robot, (load,), np.array([*(aside * turn), along]))


_SINGLE = {
    "sag_0deg": _sag(0.0),
    "sag_45deg": _sag(pi / 4),
    "helix_dead": _helix(False),
    "helix_follower": _helix(True),
    "circle": _circle,
    "force_dead": _force_dead,
    "force_follower": _force_follower,
}


# ---------------------------------------------------------------- errors

ROBOTS = (TPU, STEEL)

#: Stations of the chain, coarse to fine, and its rules.
STATIONS, RULES = (6, 12, 24, 48), ("coupled2", "balanced2", "gauss2")

_LOAD_STEPS = 5
_TRUTH = "exact rod ({}), from the tip"


def name_of(case: str, robot: RobotParams) -> str:
    """Name of a case of a robot in the report."""
    return f"{case}_{robot.name}"


def jobs(quick: bool = False) -> Iterator[Job]:
    """A job for each robot and case."""
    for robot in ROBOTS:
        for case in HEADINGS:
            yield f"{robot.name}, {case}", partial(case_rows, case, robot, quick)


def case_rows(case: str, robot: RobotParams, quick: bool = False) -> list[cases.Row]:
    """Errors of all models in the cases of a name."""
    found, shown = [], slice(2 if quick else None)
    truths = cases_of(case, robot, cases.BENDING, quick)
    for rule, n in product(RULES, STATIONS[shown]):
        name = f"mujoco_chain/{rule}"
        found.append(
            _row(case, robot, name, n, cases.BENDING, truths, partial(chain_tip, rule=rule, n=n))
        )
    for one in cases.CONTESTANTS[1:]:  # at rest, masses do not matter
        physics = one.physics
        truths = cases_of(case, robot, physics, quick or physics == cases.CONTINUUM)
        for n in one.sizes[: 1 if quick else None]:
            solve = partial(beam_tip, contestant=one, n=n)
            found.append(_row(case, robot, one.name, n, physics, truths, solve))
    return [*found, stretch_row(robot, quick)] if case == "wrenches" else found


def stretch_row(robot: RobotParams, quick: bool = False) -> cases.Row:
    """Distance [m] of the tips of exact rods with and without shear and extension.

    Both bear the same random forces and moments, as their sections see them.
    """
    rigid, elastic = (
        cases_of("wrenches", robot, physics, quick) for physics in (cases.BENDING, cases.SHEAR)
    )
    gaps = [np.linalg.norm(a.tip - b.tip) for a, b in zip(rigid, elastic, strict=True)]
    values = {"e_mean": float(np.mean(gaps)), "e_max": float(np.max(gaps))}
    values |= {"value": values["e_mean"] / robot.length, "physics": cases.SHEAR.name}
    about = "physics", f"random wrenches, {robot.name}", "exact rods: shear and stretch"
    return cases.Row(*about, reference=_TRUTH.format(cases.BENDING.name), **values)


def chain_tip(case: SpatialCase, rule: str, n: int) -> tuple[ndarray, float]:
    """Tip (3,) [m] of the chain with n stations, and the time [s] of its equilibrium."""
    options = {"loads": case.loads, "bending": "spatial", "torsion": True}
    return _solved(chain_scene(case.robot, rule, n, **options), case)


def beam_tip(case: SpatialCase, contestant: cases.Contestant, n: int) -> tuple[ndarray, float]:
    """Tip (3,) [m] of a beam model with n pieces, and the time [s] of its equilibrium."""
    return _solved(contestant.build(case.robot, n, case.loads, "torsion"), case)


def _solved(model: Scene | BeamModel, case: SpatialCase) -> tuple[ndarray, float]:
    begin = perf_counter()
    q = model.equilibrium(np.ones(len(case.loads)), load_steps=_LOAD_STEPS, check_stability=False)
    return model.tip(q), perf_counter() - begin


def _row(
    case: str,
    robot: RobotParams,
    model: str,
    n: int,
    physics: cases.Physics,
    truths: Sequence[SpatialCase],
    solve: Callable[[SpatialCase], tuple[ndarray, float]],
) -> cases.Row:
    errors, times, lost = [], [], []
    for truth in truths:
        try:
            tip, took = solve(truth)
        except EquilibriumError as error:
            lost.append(str(error))
            continue
        errors.append(float(np.linalg.norm(tip - truth.tip)))
        times.append(took)
    name, text = name_of(case, robot), _TRUTH.format(physics.name)
    if lost:
        text = f"{len(lost)} of {len(truths)} not solved: {lost[0]}"
        return cases.Row("note", name, model, n, physics=physics.name, reference=text)
    values = {"e_mean": float(np.mean(errors)), "e_max": float(np.max(errors))}
    values |= {"wall_time": float(np.min(times)), "physics": physics.name}
    return cases.Row("static", name, model, n, reference=text, **values)
