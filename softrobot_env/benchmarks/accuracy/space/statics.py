"""Rods in space at rest: tip errors of all models, and whether one direction is worse.

Of the random wrenches a row has the mean and the largest error; of the slow continuum it has fewer
of them. A model that finds no equilibrium says so in a note. The chain does not stretch, and its
truth does not either; a row of its own tells how far the tips of a rod that does are from it.
"""

from collections.abc import Iterator, Sequence
from time import perf_counter

import numpy as np

from softrobot_env.beams.model import BeamModel
from softrobot_env.benchmarks.accuracy.cases.beam_models import CONTESTANTS, Contestant
from softrobot_env.benchmarks.accuracy.goals import goal
from softrobot_env.benchmarks.accuracy.rows import BENDING, CONTINUUM, SHEAR, Physics, Row
from softrobot_env.benchmarks.accuracy.space.cases import (
    HEADINGS,
    STEEL,
    TPU,
    SpatialCase,
    cases_of,
)
from softrobot_env.benchmarks.records import select
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.core.jobs import Job
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import TWISTING_RULE, SceneConfig

ROBOTS = (TPU, STEEL)

#: Stations of the chain, coarse to fine, and its rules.
STATIONS, RULES = (6, 12, 24, 48), ("coupled2", "balanced2", "gauss2")

_LOAD_STEPS = 5
_TRUTH = "exact rod ({}), from the tip"

#: Mean tip error [m] of the wrenches at 12 stations that the default chain stays below, and by how
#: much a sag at 45 degrees may err more than one along an axis.
_GOALS = {"tpu": 0.25e-3, "steel": 0.35e-3}
_DIRECTION = 1.5
_OF_GOALS = (f"mujoco_chain/{TWISTING_RULE}", 12)


def name_of(case: str, robot: RobotParams) -> str:
    """Name of a case of a robot in the report."""
    return f"{case}_{robot.name}"


def jobs(quick: bool = False) -> Iterator[Job]:
    """A job for each robot and case."""
    for robot in ROBOTS:
        for case in HEADINGS:
            yield f"{robot.name}, {case}", lambda c=case, r=robot: case_rows(c, r, quick)


def case_rows(case: str, robot: RobotParams, quick: bool = False) -> list[Row]:
    """Errors of all models in the cases of a name."""
    found = []
    shown = slice(2 if quick else None)
    for rule in RULES:
        name = f"mujoco_chain/{rule}"
        truths = cases_of(case, robot, BENDING, quick)
        for n in STATIONS[shown]:
            solve = [lambda c=c, n=n, r=rule: chain_tip(c, r, n) for c in truths]
            found.append(_row(case, robot, name, n, BENDING, truths, solve))
    for contestant in CONTESTANTS[1:]:  # at rest, masses do not matter
        slow = quick or contestant.physics == CONTINUUM
        truths = cases_of(case, robot, contestant.physics, slow)
        for n in contestant.sizes[: 1 if quick else None]:
            solve = [lambda c=c, n=n, m=contestant: beam_tip(c, m, n) for c in truths]
            physics = contestant.physics
            found.append(_row(case, robot, contestant.name, n, physics, truths, solve))
    return [*found, stretch_row(robot, quick)] if case == "wrenches" else found


def stretch_row(robot: RobotParams, quick: bool = False) -> Row:
    """Distance [m] of the tips of exact rods with and without shear and extension.

    Both bear the same random forces and moments, as their sections see them.
    """
    rigid, elastic = (cases_of("wrenches", robot, physics, quick) for physics in (BENDING, SHEAR))
    gaps = [np.linalg.norm(a.tip - b.tip) for a, b in zip(rigid, elastic, strict=True)]
    mean = float(np.mean(gaps))
    return Row(
        "physics",
        f"random wrenches, {robot.name}",
        "exact rods: shear and stretch",
        e_mean=mean,
        e_max=float(np.max(gaps)),
        physics=SHEAR.name,
        reference=_TRUTH.format(BENDING.name),
        value=mean / robot.length,
    )


def chain_tip(case: SpatialCase, rule: str, n: int) -> tuple[np.ndarray, float]:
    """Tip (3,) [m] of the chain with n stations, and the time [s] of its equilibrium."""
    config = SceneConfig(
        case.robot, pieces=n // 2, rule=rule, loads=case.loads, bending="spatial", torsion=True
    )
    return _solved(build_scene(config), case)


def beam_tip(case: SpatialCase, contestant: Contestant, n: int) -> tuple[np.ndarray, float]:
    """Tip (3,) [m] of a beam model with n pieces, and the time [s] of its equilibrium."""
    return _solved(contestant.build(case.robot, n, case.loads, "torsion"), case)


def _solved(model: Scene | BeamModel, case: SpatialCase) -> tuple[np.ndarray, float]:
    begin = perf_counter()
    q = model.equilibrium(np.ones(len(case.loads)), load_steps=_LOAD_STEPS, check_stability=False)
    return model.tip(q), perf_counter() - begin


def _row(
    case: str,
    robot: RobotParams,
    model: str,
    n: int,
    physics: Physics,
    truths: Sequence[SpatialCase],
    solve: Sequence,
) -> Row:
    errors, times, lost = [], [], []
    for truth, tip_of in zip(truths, solve, strict=True):
        try:
            tip, took = tip_of()
        except EquilibriumError as error:
            lost.append(str(error))
            continue
        errors.append(float(np.linalg.norm(tip - truth.tip)))
        times.append(took)
    name, text = name_of(case, robot), _TRUTH.format(physics.name)
    if lost:
        text = f"{len(lost)} of {len(truths)} not solved: {lost[0]}"
        return Row("note", name, model, n, physics=physics.name, reference=text)
    values = {"e_mean": float(np.mean(errors)), "e_max": float(np.max(errors))}
    values |= {"wall_time": float(np.min(times)), "physics": physics.name}
    return Row("static", name, model, n, reference=text, **values)


def goal_rows(rows: Sequence[Row]) -> Iterator[Row]:
    """What the default chain has to reach, and did it."""
    model, n = _OF_GOALS
    mine = {row.case: row for row in select(rows, kind="static", model=model, n=n)}
    for robot in ROBOTS:
        names = [name_of(case, robot) for case in ("wrenches", "sag_0deg", "sag_45deg")]
        if not set(names) <= set(mine):
            continue
        wrench, along, across = (mine[name] for name in names)
        bound = _GOALS[robot.name]
        case = f"random wrenches, {robot.name}, 12 stations: mean error [m]"
        yield goal(case, wrench, wrench.e_mean, most=bound)
        case = f"sag at 45 degrees, {robot.name}, 12 stations: times that along an axis"
        ratio = across.e_mean / along.e_mean
        yield goal(case, across, max(ratio, 1 / ratio), most=_DIRECTION)
