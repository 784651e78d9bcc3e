"""Error against run time of the MuJoCo chain and the beam models, each against a converged truth.

Statics are compared with closed forms and exact solutions, motions with
limits of infinitely many pieces. Models that shear and stretch converge to something else than
those that only bend and twist, so each is compared with the truth of its own physics, and where
models share the physics, their limits must agree (`cases.agreement`).
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import compress, product

import numpy as np
from numpy import ndarray

from softrobot_env.beams.model import IntegrationError
from softrobot_env.evaluation.models.runs import Limit, best_of, distance
from softrobot_env.robots import RobotParams
from softrobot_env.scene.quadrature import RULES
from studies.accuracy import pyelastica_rod, rig, rods, shown, space, spiral, tension_step
from studies.accuracy.cases import (
    BENDING,
    BOUND,
    CONTESTANTS,
    CONTINUUM,
    COSSERAT,
    DISTRIBUTED,
    DURATION,
    LUMPED,
    Contestant,
    Physics,
    Row,
    agreement_row,
    beam_limit,
    chain_limit,
    goal,
    limit_row,
    static_row,
    timed_row,
)
from studies.accuracy.planar import StaticCase, static_cases
from studies.beams import chain_scene, step_cost
from studies.lab import Job, Study, groups, select
from studies.thesis import evaluation_time

#: Numbers of hinges, coarse to fine; a quick run stops after the second.
HINGES = (6, 12, 24, 48)

#: The arm's tendons end at thirds of its length, where pieces of three hinges must end too.
HINGES_OF_THIRDS = (9, 18, 36)

#: Timesteps [s] and integrators of the chain in the tension step.
TIMESTEPS = (1e-3, 2e-3, 5e-3, 1e-2)
DYNAMIC_INTEGRATORS = ("implicitfast", "discrete")

#: Joints of the chain in the spiral, and timesteps [s].
SPIRAL_JOINTS = (2, 4, 6, 12)
SPIRAL_JOINTS_OF_THREES = (3, 6, 12)
SPIRAL_TIMESTEPS = (5e-3, spiral.PERIOD / 3, 2e-3, 1e-3)

#: Tolerances of the adaptive integrators, and fixed steps [s].
TOLERANCES, FINE_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5), (1e-6, 1e-7)
FIXED_STEPS = {"implicit_euler": (1e-2, 2.5e-3), "sdirk2": (2e-2, 1e-2, 5e-3)}

#: Error of the run that measures the error in time, far below those of the others.
_CONVERGED = 1e-8

_LOAD_STEPS = 5

#: Case -> module with its motions, limit of the chain, and robot.
MOTIONS = {module.CASE: module for module in (spiral, tension_step)}

#: Converged motions by case and physics.
Limits = dict[tuple[str, str], Limit]

#: Motions in which a step of the chain costs the same throughout.
_EVEN = (tension_step.CASE, *rig.MOTIONS)


def jobs(quick: bool) -> Iterator[Job]:
    """All cases, models and resolutions."""
    parts = _static_jobs, _dynamic_jobs, space.jobs, rig.static_jobs, rig.motion_jobs, rods.jobs
    for some in parts:
        yield from some(quick)
    yield "PyElastica", partial(pyelastica_rod.rows, quick)


def derived(rows: list[Row]) -> list[Row]:
    """The rows and what they say of the goals."""
    _share_step_times(rows)
    return [*rows, *goal_rows(rows)]


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
    numbers = HINGES_OF_THIRDS if len(RULES[rule]) == 3 and bool(robot.tendons) else HINGES
    return numbers[:2] if quick else numbers


# ---------------------------------------------------------------- statics


def _static_jobs(quick: bool) -> Iterator[Job]:
    repeats = 2 if quick else 5
    for case in static_cases():
        yield case.name, partial(_static_rows, case, quick, repeats)


def _static_rows(case: StaticCase, quick: bool, repeats: int) -> list[Row]:
    found, tips = [], {}
    for rule in RULES:
        for n in hinge_numbers(case.robot, rule, quick):
            row, tip = chain_static_row(case, rule, n, repeats)
            found.append(row)
            tips.setdefault((row.model, BENDING), {})[n] = tip
    for contestant in CONTESTANTS:
        name, physics = contestant.name, contestant.physics
        truth = case.truth(physics)
        for n in contestant.sizes[: 2 if quick else None]:
            model = contestant.build(case.robot, n, case.loads)
            solve = partial(
                model.equilibrium, case.ctrl, load_steps=_LOAD_STEPS, check_stability=False
            )
            solve()  # compiles
            wall_time, q = best_of(solve, repeats)
            tip = model.tip(q)[[0, 2]]
            tips.setdefault((name, physics), {})[n] = tip
            found.append(static_row(case.name, name, n, physics, truth, tip, wall_time=wall_time))
    found += static_rows(case, tips)
    return found if quick else found + slender_static_rows(case)


def chain_static_row(case: StaticCase, rule: str, n: int, repeats: int = 1) -> tuple[Row, ndarray]:
    """Solve one static case on a chain of n hinges; times are the best of `repeats`.

    Returns:
        The row, and the tip (2,) [m].
    """
    scene = chain_scene(case.robot, rule, n, loads=case.loads)
    wall_time, posture = best_of(lambda: scene.equilibrium(case.ctrl), repeats)
    tip, choice = scene.tip(posture)[[0, 2]], scene.timestep
    about = case.name, f"mujoco_chain/{rule}", scene.model.nv, BENDING, case.truth(BENDING), tip
    steps = {"timestep": choice.timestep, "integrator": choice.integrator}
    step_time = step_cost(scene.model, posture, case.ctrl, repeats)
    return static_row(*about, wall_time=wall_time, step_time=step_time, **steps), tip


# ---------------------------------------------------------------- motions


def _dynamic_jobs(quick: bool) -> Iterator[Job]:
    limits: Limits = {}

    def find_limits(case: str, contestant: Contestant) -> list[Row]:
        limits[case, contestant.physics.name] = case_limit(case, contestant, quick)
        return []

    for case in MOTIONS:
        # Of the models of equal physics the last one gives the truth: it has the full inertia.
        for one in {c.physics: c for c in CONTESTANTS}.values():
            yield f"{case}, limit of {one.name}", partial(find_limits, case, one)
        yield f"{case}, agreement", partial(dynamic_rows, case, limits, quick)
        for one in CONTESTANTS:
            yield f"{case}, {one.name}", partial(_beam_rows, case, one, limits, quick)
        for rule in RULES:
            yield f"{case}, chain {rule}", partial(_chain_rows, case, rule, limits, quick)


def _beam_rows(case: str, contestant: Contestant, limits: Limits, quick: bool) -> list[Row]:
    found, physics = [], contestant.physics
    truth = limits[case, physics.name]
    numbers = contestant.spiral if case == spiral.CASE else contestant.step
    for index, n in enumerate(numbers[: 2 if quick else None]):
        motion = MOTIONS[case].beam_motion(contestant, n)
        exact = replace(motion, tolerance=_CONVERGED)()
        for method, step, tolerance in _settings(contestant, index, quick):
            run = replace(motion, method=method, step=step, tolerance=tolerance)
            try:
                found.append(timed_row(case, physics, truth, run, 2 if quick else 5, exact))
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


def _chain_rows(case: str, rule: str, limits: Limits, quick: bool) -> list[Row]:
    if case == spiral.CASE:
        numbers = SPIRAL_JOINTS_OF_THREES if len(RULES[rule]) == 3 else SPIRAL_JOINTS
        numbers = numbers[: -1 if quick else None]
        steps = SPIRAL_TIMESTEPS[: 3 if quick else None]
        repeats = 5 if quick else 20
    else:
        numbers, steps = hinge_numbers(tension_step.ROBOT, rule, quick), TIMESTEPS
        repeats = 2 if quick else 5
    make, truth = MOTIONS[case].chain_motion, limits[case, BENDING.name]
    return [
        timed_row(case, BENDING, truth, make(rule, n, step, integrator), repeats)
        for n, integrator, step in product(numbers, DYNAMIC_INTEGRATORS, steps)
    ]


# ---------------------------------------------------------------- agreement

_SLENDER = 30.0

#: Elements of a slender continuum, which converges slowly: bending also strains its fibres.
_FINE = 96

#: Pieces of the limits of each model in the spiral and the tension step, full and quick.
_SIZES = {
    ("pcc", spiral.CASE): ((5, 10, 20), (3, 6, 12)),
    ("pcc", tension_step.CASE): ((6, 12, 24), (3, 6, 12)),
    ("cosserat", spiral.CASE): ((8, 16, 32), (8, 16, 32)),
    ("cosserat", tension_step.CASE): ((12, 24, 48), (6, 12, 24)),
    ("ancf", spiral.CASE): ((3, 6, 12), (2, 4, 8)),
    ("ancf", tension_step.CASE): ((6, 12, 24), (3, 6, 12)),
}


def slender(robot: RobotParams) -> RobotParams:
    """A robot of equal EI and mass per length, with a thirtieth of the radius."""
    return replace(
        robot,
        outer_radius=robot.outer_radius / _SLENDER,
        inner_radius=robot.inner_radius / _SLENDER,
        youngs_modulus=robot.youngs_modulus * _SLENDER**4,
        density=robot.density * _SLENDER**2,
    )


def static_rows(case: StaticCase, tips: dict[tuple[str, Physics], dict[int, ndarray]]) -> list[Row]:
    """How far the limits of models are from the exact equilibrium of their physics.

    Args:
        case: The case.
        tips: Tips (2,) [m] by model, physics and number of pieces; the two finest are extrapolated
            to infinitely many for an error of second order.
    """
    found = []
    for (model, physics), by_size in tips.items():
        finest = dict(sorted(by_size.items())[-2:])
        truth, length = case.truth(physics), case.robot.length
        row = limit_row(case.name, model, finest, physics, truth, length)
        # Where bending is not uniform, no rod is the limit of a continuum: reported, not checked.
        found.append(_unchecked(row) if physics == CONTINUUM and not case.uniform else row)
    return found


def slender_static_rows(case: StaticCase) -> list[Row]:
    """How far a fine continuum model of a slender robot is from the exact rod that only bends."""
    robot, found = slender(case.robot), []
    for contestant in CONTESTANTS:
        if contestant.physics == CONTINUUM:
            model = contestant.build(robot, _FINE, case.loads)
            q = model.equilibrium(case.ctrl, load_steps=5, check_stability=False)
            truth, name = case.truth(BENDING), f"{contestant.name}, slender"
            gap, length = distance(model.tip(q)[[0, 2]], truth.tips), robot.length
            about = gap, length, BENDING.name, truth.text
            found.append(agreement_row(case.name, name, _FINE, *about))
    return found


def case_limit(
    case: str, contestant: Contestant, quick: bool, robot: RobotParams | None = None
) -> Limit:
    """Converged motion of a model, of the case's own robot unless another is given."""
    sizes = _SIZES[contestant.name.split("/")[0], case][quick]
    module = MOTIONS[case]
    return beam_limit(module.beam_motion, contestant, sizes, robot or module.ROBOT)


def dynamic_rows(case: str, limits: Limits, quick: bool) -> list[Row]:
    """Distances of the limits of different models.

    Args:
        case: "spiral" or "tension_step".
        limits: Converged motion by case and physics.
        quick: Coarser limits, and no slender robot.
    """
    robot, truth, name = MOTIONS[case].ROBOT, limits[case, BENDING.name], DISTRIBUTED.name
    chain = chain_limit(MOTIONS[case].chain_motion, *MOTIONS[case].LIMIT[quick])
    found = [_pair(case, f"mujoco_chain/gauss2 / {name}", chain, truth, robot)]
    others = [one for one in CONTESTANTS if one.physics != BENDING]
    for one in others:
        other, pair = limits[case, one.physics.name], f"{one.name} / {name} (other physics)"
        # Not a check: what shear and extension do to the motion.
        found.append(_unchecked(_pair(case, pair, other, truth, robot)))
    if not quick:
        thin = slender(robot)
        truth = case_limit(case, DISTRIBUTED, True, thin)
        for one in others:
            limit, pair = case_limit(case, one, True, thin), f"{one.name} / {name}, slender"
            found.append(_pair(case, pair, limit, truth, thin))
    return found


def _pair(case: str, pair: str, a: Limit, b: Limit, robot: RobotParams) -> Row:
    error = np.linalg.norm(a.tips - b.tips, axis=-1)
    gap, text = distance(a.tips, b.tips), f"{a.text}; {b.text}"
    row = agreement_row(case, pair, None, gap, robot.length, BENDING.name, text)
    row = replace(row, e_mean=float(error.mean()))
    if max(a.uncertainty, b.uncertainty) > BOUND * robot.length:
        return replace(_unchecked(row), model=f"{pair}: no limit found")
    return row


def _unchecked(row: Row) -> Row:
    """What other physics, or an unknown limit, make of an agreement: a distance without a bound."""
    return replace(row, kind="physics", limit=None, met=None)


# ---------------------------------------------------------------- goals

#: Errors in time [m]: our own, and the thesis' (Tab. 2.2, whose unit is m according to the audit).
_SMALL, _THESIS = 1e-6, 0.9e-3

#: Model, pieces and run time [s] of the spiral.
_SPIRALS = (("pcc/lumped", 2, 0.020), ("cosserat", 7, 0.100), ("ancf", 2, 1.0))


def goal_rows(found: list[Row]) -> list[Row]:
    """Goals and what rows of the benchmark say about them; limits of a speed-up are lower ones."""
    return [*_spirals(found), *_right_hand_side(), *_chain(found), *_speed_up(found)]


def _spirals(found: list[Row]) -> Iterator[Row]:
    for model, n, bound in _SPIRALS:
        mine = select(found, case=spiral.CASE, model=model, n=n)
        for error in (_SMALL, _THESIS):
            good = (row for row in mine if row.e_time is not None and row.e_time <= error)
            best = _fastest(good)
            if best is not None:
                case = f"3 s spiral, error in time <= {1e3 * error:g} mm: time [s]"
                yield goal(case, best, best.wall_time, most=bound)


def _right_hand_side() -> Iterator[Row]:
    """Of the spatial PCC model in the spiral."""
    five, twenty = (
        evaluation_time(LUMPED.build(spiral.ROBOT, n, spiral.loads(), "spatial")) for n in (5, 20)
    )
    few, many = (Row("goal", "", LUMPED.name, n) for n in (5, 20))
    yield goal("right-hand side in 3-D: time [s]", few, five, most=10e-6)
    growth = twenty / five
    yield goal("its growth from 5 to 20 pieces: factor", many, growth, most=(20 / 5) ** 2)


def _chain(found: list[Row]) -> Iterator[Row]:
    chains = (r for r in select(found, case=spiral.CASE, kind="dynamic") if r.is_chain)
    best = _fastest(row for row in chains if row.e_mean < 1e-4)
    if best is not None:
        speed = spiral.DURATION / best.wall_time
        yield goal("spiral, mean error < 0.1 mm: times real time", best, speed, least=300.0)


def _speed_up(found: list[Row]) -> Iterator[Row]:
    """The fastest run of at most the same error, for each of PyElastica's: chain and rod.

    The goal is the chain's; the rod, which has PyElastica's physics, stands beside it.
    """
    runs = select(found, case=pyelastica_rod.CASE, kind="dynamic")
    for theirs in select(runs, model=pyelastica_rod.NAME):
        for model in (pyelastica_rod.CHAIN, COSSERAT.name):
            best = _fastest(r for r in select(runs, model=model) if r.e_max <= theirs.e_max)
            if best is not None:
                ratio = theirs.wall_time / best.wall_time
                case = f"undamped spiral, error of PyElastica {theirs.n} or less: times faster"
                row = goal(case, best, ratio, least=30.0)
                yield row if model == pyelastica_rod.CHAIN else replace(row, limit=None, met=None)


def _fastest(found: Iterable[Row]) -> Row | None:
    return min(found, key=lambda row: row.wall_time, default=None)


STUDY = Study(
    kinds=(Row,),
    jobs=jobs,
    derive=derived,
    tables=shown.TABLES,
    plots=shown.PLOTS,
    note="Error in time on robots of all kinds: softrobot benchmark scenes",
    alone=True,
)
