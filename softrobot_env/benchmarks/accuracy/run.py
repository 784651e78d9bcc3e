"""Error against run time of the MuJoCo chain and the beam models, each against a converged truth.

Statics and frequencies are compared with closed forms and boundary-value solutions, motions with
limits of infinitely many pieces. Models that shear and stretch converge to something else than
those that only bend and twist, so each is compared with the truth of its own physics, and where
models share the physics, their limits must agree (`cases.agreement`).
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import compress, product
from typing import Any

import numpy as np

from softrobot_env.beams.model import IntegrationError
from softrobot_env.benchmarks.accuracy import goals
from softrobot_env.benchmarks.accuracy.cases import agreement, pyelastica_rod, spiral, tension_step
from softrobot_env.benchmarks.accuracy.cases.beam_models import CONTESTANTS, Contestant
from softrobot_env.benchmarks.accuracy.cases.frequencies import (
    ScalarCase,
    beam_row,
    chain_row,
    scalar_cases,
)
from softrobot_env.benchmarks.accuracy.cases.motions import timed_row
from softrobot_env.benchmarks.accuracy.cases.statics import StaticCase, static_cases
from softrobot_env.benchmarks.accuracy.rig import motions as rig_motions
from softrobot_env.benchmarks.accuracy.rig import statics as rig_statics
from softrobot_env.benchmarks.accuracy.rig.cases import MOTIONS as RIG_MOTIONS
from softrobot_env.benchmarks.accuracy.rows import (
    BENDING,
    DURATION,
    Limit,
    Physics,
    Row,
    static_row,
)
from softrobot_env.benchmarks.accuracy.space import statics as space_statics
from softrobot_env.benchmarks.beams import chain_scene
from softrobot_env.benchmarks.records import groups
from softrobot_env.benchmarks.timing import best_of, step_cost
from softrobot_env.core.jobs import Job, Progress, run_jobs
from softrobot_env.robots import ARM, RobotParams
from softrobot_env.scene.quadrature import RULES

#: Numbers of hinges, coarse to fine; a quick run stops after the second.
HINGES = (6, 12, 24, 48)

#: The arm's tendons end at thirds of its length, where pieces of three hinges must end too.
HINGES_OF_THIRDS = (9, 18, 36)

#: Timesteps [s] and integrators of the chain in the tension step.
TIMESTEPS = (1e-3, 2e-3, 5e-3, 1e-2)
DYNAMIC_INTEGRATORS = ("implicitfast", "discrete")

#: Joints of the chain in the spiral, and steps per 10 ms.
SPIRAL_JOINTS = (2, 4, 6, 12)
SPIRAL_JOINTS_OF_THREES = (3, 6, 12)
SUBSTEPS = (2, 3, 5, 10)

#: Tolerances of the adaptive integrators, and fixed steps [s].
TOLERANCES, FINE_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5), (1e-6, 1e-7)
FIXED_STEPS = {"implicit_euler": (1e-2, 2.5e-3), "sdirk2": (2e-2, 1e-2, 5e-3)}

#: Error of the run that measures the error in time, far below those of the others.
_CONVERGED = 1e-8

_LOAD_STEPS = 5

#: Motions in which a step of the chain costs the same throughout.
_EVEN = (tension_step.CASE, *RIG_MOTIONS)


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Measure all cases, models and resolutions.

    Args:
        quick: Only the coarser models, and coarser references.
        progress: Called with (description, done, total), or None.

    Returns:
        The rows.
    """
    rows: list[Row] = []

    def reach_goals() -> list[Row]:
        _share_step_times(rows)
        return [*goals.rows(rows, quick), *space_statics.goal_rows(rows)]

    jobs = [*_static_jobs(quick), *_number_jobs(quick), *_dynamic_jobs(quick)]
    jobs += [*space_statics.jobs(quick), *rig_statics.jobs(quick), *rig_motions.jobs(quick)]
    jobs.append(("PyElastica", lambda: pyelastica_rod.rows(quick)))
    jobs.append(("goals", reach_goals))
    return run_jobs(jobs, progress, rows)


def _share_step_times(rows: list[Row]) -> None:
    """Give the chain's motions of equal cost the same time.

    A step costs the same whatever the rule and the timestep, so its best time over all runs with
    as many hinges and the same integrator is the truth; single runs differ by the machine's noise.
    """
    even = [r.kind == "dynamic" and r.is_chain and r.case in _EVEN for r in rows]
    alike = groups(compress(rows, even), "case", "n", "integrator")
    best = {key: min(row.step_time for row in mine) for key, mine in alike.items()}
    for index in compress(range(len(rows)), even):
        row = rows[index]
        step = best[row.case, row.n, row.integrator]
        rows[index] = replace(row, step_time=step, wall_time=step * DURATION / row.timestep)


def hinge_numbers(robot: RobotParams, rule: str, quick: bool = False) -> tuple[int, ...]:
    """Numbers of hinges of a rule on a robot: tendons must end between pieces."""
    thirds = len(RULES[rule]) == 3 and bool(robot.tendons)
    numbers = HINGES_OF_THIRDS if thirds else HINGES
    return numbers[:2] if quick else numbers


# ---------------------------------------------------------------- statics


def _static_jobs(quick: bool) -> Iterator[Job]:
    repeats = 2 if quick else 5
    for case in static_cases():
        yield case.name, lambda c=case: _static_rows(c, quick, repeats)


def _static_rows(case: StaticCase, quick: bool, repeats: int) -> list[Row]:
    found, tips = [], {}
    for rule in RULES:
        for n in hinge_numbers(case.robot, rule, quick):
            row, tip = chain_static_row(case, rule, n, repeats)
            found.append(row)
            tips.setdefault((row.model, BENDING), {})[n] = tip
    for contestant in CONTESTANTS:
        name, physics = contestant.name, contestant.physics
        truth = _truth(case, physics)
        for n in contestant.sizes[: 2 if quick else None]:
            model = contestant.build(case.robot, n, case.loads)

            def solve(model: Any = model) -> np.ndarray:
                return model.equilibrium(case.ctrl, load_steps=_LOAD_STEPS, check_stability=False)

            solve()  # compiles
            wall_time, q = best_of(solve, repeats)
            tip = model.tip(q)[[0, 2]]
            tips.setdefault((name, physics), {})[n] = tip
            found.append(static_row(case.name, name, n, physics, truth, tip, wall_time=wall_time))
    found += agreement.static_rows(case, tips)
    return found if quick else found + agreement.slender_static_rows(case)


def _truth(case: StaticCase, physics: Physics) -> Limit:
    tip, text = case.truth(physics)
    return Limit(tip, 0.0, text)


def chain_static_row(
    case: StaticCase, rule: str, n: int, repeats: int = 1
) -> tuple[Row, np.ndarray]:
    """Solve one static case on a chain of n hinges; times are the best of `repeats`.

    Returns:
        The row, and the tip (2,) [m].
    """
    scene = chain_scene(case.robot, rule, n, loads=case.loads)
    wall_time, posture = best_of(lambda: scene.equilibrium(case.ctrl), repeats)
    tip = scene.tip(posture)[[0, 2]]
    row = static_row(
        case.name,
        f"mujoco_chain/{rule}",
        scene.model.nv,
        BENDING,
        _truth(case, BENDING),
        tip,
        wall_time=wall_time,
        timestep=scene.timestep.timestep,
        integrator=scene.timestep.integrator,
        step_time=step_cost(scene.model, posture, case.ctrl, repeats),
    )
    return row, tip


# ---------------------------------------------------------------- frequencies and torsion


def _number_jobs(quick: bool) -> Iterator[Job]:
    for case in scalar_cases():
        yield case.name, lambda c=case: _number_rows(c, quick)


def _number_rows(case: ScalarCase, quick: bool) -> list[Row]:
    shown, repeats = slice(2 if quick else None), 2 if quick else 5
    out = [
        beam_row(case, contestant, n, repeats)
        for contestant in CONTESTANTS
        for n in contestant.sizes[shown]
    ]
    return out + [
        chain_row(case, rule, n, BENDING, repeats) for rule in RULES for n in HINGES[shown]
    ]


# ---------------------------------------------------------------- motions


def _dynamic_jobs(quick: bool) -> Iterator[Job]:
    limits: dict[tuple[str, str], Limit] = {}

    def find_limits(case: str, contestant: Contestant) -> list[Row]:
        limits[case, contestant.physics.name] = agreement.beam_limit(case, contestant, quick)
        return []

    for case in (spiral.CASE, tension_step.CASE):
        # Of the models of equal physics the last one gives the truth: it has the full inertia.
        for contestant in {c.physics: c for c in CONTESTANTS}.values():
            description = f"{case}, limit of {contestant.name}"
            yield description, lambda s=case, c=contestant: find_limits(s, c)
        yield f"{case}, agreement", lambda s=case: agreement.dynamic_rows(s, limits, quick)
        for contestant in CONTESTANTS:
            yield (
                f"{case}, {contestant.name}",
                lambda s=case, c=contestant: _beam_rows(s, c, limits[s, c.physics.name], quick),
            )
        for rule in RULES:
            yield (
                f"{case}, chain {rule}",
                lambda s=case, r=rule: _chain_rows(s, r, limits[s, BENDING.name], quick),
            )


def _beam_rows(case: str, contestant: Contestant, truth: Limit, quick: bool) -> list[Row]:
    found, (module, _) = [], agreement.MOTIONS[case]
    numbers = contestant.spiral if module is spiral else contestant.step
    for index, n in enumerate(numbers[: 2 if quick else None]):
        motion = module.beam_motion(contestant, n)
        exact = replace(motion, tolerance=_CONVERGED)()
        for method, step, tolerance in _settings(contestant, index, quick):
            run = replace(motion, method=method, step=step, tolerance=tolerance)
            repeats = 2 if quick else 5
            try:
                found.append(timed_row(case, contestant.physics, truth, run, repeats, exact))
            except IntegrationError as error:
                text = f"left out: {error}"
                found.append(Row("note", case, contestant.name, n, reference=text))
    return found


def _settings(
    contestant: Contestant, index: int, quick: bool
) -> Iterator[tuple[str, float | None, float | None]]:
    """Method, step and tolerance; fixed steps and the finest ones for the coarsest model only."""
    for tolerance in (*TOLERANCES, *(FINE_TOLERANCES if index == 0 else ())):
        yield "sdirk4", None, tolerance
    if contestant.explicit and index < 2:
        for tolerance in TOLERANCES[1:]:
            yield "dormand_prince", None, tolerance
    if index == 0:
        for method, steps in FIXED_STEPS.items():
            for step in steps[: 2 if quick else None]:
                yield method, step, None


def _chain_rows(case: str, rule: str, truth: Limit, quick: bool) -> list[Row]:
    if case == spiral.CASE:
        numbers = SPIRAL_JOINTS_OF_THREES if len(RULES[rule]) == 3 else SPIRAL_JOINTS
        numbers, steps = (numbers[:-1], SUBSTEPS[:3]) if quick else (numbers, SUBSTEPS)
        make, repeats = spiral.chain_motion, 5 if quick else 20
    else:
        numbers, steps = hinge_numbers(ARM, rule, quick), TIMESTEPS
        make, repeats = tension_step.chain_motion, 2 if quick else 5
    return [
        timed_row(case, BENDING, truth, make(rule, n, step, integrator), repeats)
        for n, integrator, step in product(numbers, DYNAMIC_INTEGRATORS, steps)
    ]
