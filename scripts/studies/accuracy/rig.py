"""Lengths pulled in at the rig's servos, at rest and over time."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.optimize import root

from softrobot_env.beams import signals
from softrobot_env.beams.model import BeamModel
from softrobot_env.beams.pcc import PCC
from softrobot_env.evaluation.models import runs
from softrobot_env.robots import RIG
from softrobot_env.robots.loads import Load
from softrobot_env.scene.config import TipSensors
from softrobot_env.scene.quadrature import RULES
from softrobot_env.thesis.rig.spatial_piece import SUBPIECES
from studies.accuracy import cases
from studies.beams import chain_scene
from studies.lab import Job
from studies.truths.rig_column import column_tip
from studies.truths.rig_ritz_rod import RigRod

#: Lengths (3,) [m] of the static cases. In the last one a tendon hangs slack.
STATIC: dict[str, tuple[float, float, float]] = {
    "rig_pull_10mm": (10e-3, 0.0, 0.0),
    "rig_pull_20mm": (20e-3, 0.0, 0.0),
    "rig_general": (12e-3, 6e-3, 0.0),
    "rig_slack": (12e-3, 4e-3, -25e-3),
}

STEP, CIRCLE = "rig_length_step", "rig_fast_circle"

#: [s] between compared instants: a control period of the rig's environments.
PERIOD = 0.02

#: The step pulls in one tendon [m]. The circle pulls them in and lets them out in turn by as much,
#: once a second after the first one, which takes the tip round at about 0.6 m/s.
_STEP, _CIRCLE, _LAP, _RISE = 10e-3, 7e-3, 1.0, 1.0


def step(t: float | ndarray) -> ndarray:
    """Lengths (..., 3) [m] at times (...) [s] of one tendon that is pulled in at once."""
    return np.ones(np.shape(t))[..., None] * np.array([_STEP, 0.0, 0.0])


def circle(t: float | ndarray) -> ndarray:
    """Lengths (..., 3) [m] at times (...) [s] that lead the tip to a circle and round on it."""
    t = np.asarray(t)[..., None]
    size = _CIRCLE * np.sin(np.pi / 2 * np.minimum(t / _RISE, 1)) ** 2
    return size * np.cos(2 * np.pi * (t / _LAP - np.arange(3) / 3))


MOTIONS: dict[str, Callable[[float | ndarray], ndarray]] = {STEP: step, CIRCLE: circle}

CASES = (*STATIC, *MOTIONS)


def sample_times() -> ndarray:
    """Instants [s] at which tips are compared."""
    return np.linspace(0, cases.DURATION, round(cases.DURATION / PERIOD) + 1)


#: The robot of all cases, and its MuJoCo chain.
ROBOT = RIG
CHAIN = {
    "actuation": "length",
    "bending": "spatial",
    "control_period": PERIOD,
    "sensors": (TipSensors(),),
}


# ---------------------------------------------------------------- at rest

#: Joints of the chain, coarse to fine; those of rules with three joints per piece.
JOINTS, JOINTS_OF_THREES = (2, 4, 8, 16, 32), (3, 6, 12, 24)

#: Pieces of the beam models at rest.
PIECES = {cases.DISTRIBUTED.name: (1, 2, 4, 8, 16), cases.COSSERAT.name: (6, 12, 24, 48)}

_LOAD_STEPS = 4
_SHARES = np.arange(1, _LOAD_STEPS + 1) / _LOAD_STEPS
_TOLERANCE = 1e-12

#: Output point (3,) [m] for lengths (3,) [m].
Solve = Callable[[ndarray], ndarray]


#: Name, pieces or joints, physics and statics of a model.
Entry = tuple[str, int, cases.Physics, Solve]


def entries(quick: bool = False) -> list[Entry]:
    """All models at rest; a quick run has the coarsest ones."""
    found = []
    for one in (cases.DISTRIBUTED, cases.COSSERAT):
        for n in PIECES[one.name][: 2 if quick else None]:
            found.append((one.name, n, one.physics, beam_statics(one, n)))
    for rule in RULES:
        for n in joint_numbers(rule)[: 3 if quick else None]:
            found.append((f"mujoco_chain/{rule}", n, cases.BENDING, chain_statics(rule, n)))
    return found


def joint_numbers(rule: str) -> tuple[int, ...]:
    """Joints of the chain with a rule."""
    return JOINTS_OF_THREES if len(RULES[rule]) == 3 else JOINTS


def beam_statics(contestant: cases.Contestant, n: int) -> Solve:
    """A beam model that carries the head as a dead load."""
    weight, end = ROBOT.head.mass * np.array(ROBOT.gravity), ROBOT.length
    loads = (
        Load("head", end, force=tuple(weight)),
        Load("lever_x", end, moment=(1.0, 0.0, 0.0)),
        Load("lever_y", end, moment=(0.0, 1.0, 0.0)),
    )
    model = contestant.build(replace(ROBOT, head=None), n, loads, "spatial", drive="length")

    def solve(pulled: ndarray) -> ndarray:
        q, moment = model.rest(), np.zeros(2)
        for share in _SHARES:
            near, lengths = q, share * pulled

            def posture(moment: ndarray, u: ndarray = lengths, q: ndarray = near) -> Any:
                return model.equilibrium(np.array([*u, 1.0, *moment]), q, check_stability=False)

            def missing(moment: ndarray, posture: Callable = posture) -> ndarray:
                moment_arm = ROBOT.head.centre * end_axis(model, posture(moment))
                return np.cross(moment_arm, weight)[:2] - moment

            moment = root(missing, moment, tol=_TOLERANCE).x
            q = posture(moment)
        return model.tip(q) + ROBOT.head.output * end_axis(model, q)

    return solve


def end_axis(model: BeamModel, q: ndarray) -> ndarray:
    """Unit vectors (..., 3) along a head that is fixed to the end, at q (n,) or (T, n)."""
    radius = model.robot.outer_radius
    places = np.array([[0.0, 0.0], [radius, 0.0], [0.0, radius]])
    centre, x, y = np.moveaxis(model.positions(q, np.full(3, model.robot.length), places), -2, 0)
    axis = np.cross(x - centre, y - centre)
    return axis / np.linalg.norm(axis, axis=-1, keepdims=True)


def chain_statics(rule: str, n: int) -> Solve:
    """The MuJoCo chain on n joints."""
    scene = chain_scene(ROBOT, rule, n, **CHAIN)
    return lambda pulled: scene.tip(scene.equilibrium(pulled, load_steps=_LOAD_STEPS))


def static_jobs(quick: bool = False) -> Iterator[Job]:
    """One job for each case; a quick run has the first and the last one."""
    for case in list(STATIC)[:: len(STATIC) - 1 if quick else 1]:
        yield f"{case}, all models", partial(case_rows, case, quick)


def static_truth(case: str, physics: cases.Physics) -> runs.Limit:
    """The exact tip (3,) [m] of a case."""
    tip = column_tip(ROBOT, np.array(STATIC[case]), physics.shear_coefficient)
    kind = "that only bends" if physics == cases.BENDING else "with shear and extension"
    return runs.Limit(tip, 0.0, f"column {kind} (initial values from the end)")


def case_rows(case: str, quick: bool = False) -> list[cases.Row]:
    """Errors of all models, and what they converge to.

    The Cosserat rod applies moments half a segment before its end, an error of first order.
    """
    truths = {physics.name: static_truth(case, physics) for physics in (cases.BENDING, cases.SHEAR)}
    found, tips = [], {}
    for name, n, physics, statics in entries(quick):
        solve = partial(statics, np.array(STATIC[case]))
        if name not in {known for known, _ in tips}:
            solve()  # compiles
        wall_time, tip = runs.best_of(solve, 1 if quick else 5)
        exact = truths[physics.name]
        found.append(cases.static_row(case, name, n, physics, exact, tip, wall_time=wall_time))
        tips.setdefault((name, physics), {})[n] = tip
    if not quick:
        for (model, physics), by_size in tips.items():
            finest = dict(sorted(by_size.items())[-3:])
            order = 1 if model == cases.COSSERAT.name else 2
            about = physics, truths[physics.name], ROBOT.length, order
            found.append(cases.limit_row(case, model, finest, *about))
    return found


# ---------------------------------------------------------------- in motion

#: Timesteps [s] and integrators of the chain, and hinge rules of a quick run.
TIMESTEPS = (1e-3, 2e-3, 5e-3, 1e-2)
INTEGRATORS = ("implicitfast", "discrete")
QUICK_RULES = ("gauss2", "balanced2")

#: Pieces of PCC, whose three rigid bodies give inertia to no more, and tolerances.
MOVING_PIECES = (1, 2, 3)
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
_CONVERGED = 1e-8

#: Models that are left out, and why.
LEFT_OUT = {
    "cosserat, in motion": "it has no rigid bodies, and the head has most of the rig's inertia",
    "pcc/lumped, pcc/distributed, in motion": "no rigid body beyond the backbone's end",
    "ancf": "no rod is exact for this continuum where bending is uneven, and it has no head",
}

#: Terms and tolerances of the truth, the coarser first; of a quick run.
_TRUTHS = ((5, 1e-6), (6, 1e-7))
_QUICK_TRUTHS = ((3, 1e-4), (4, 1e-4))

#: Joints and longest timestep [s] of the chain's limit.
LIMIT = (8, 16, 32), 5e-4


def motion_truth(case: str, quick: bool = False) -> runs.Limit:
    """Tips (k, 3) [m] of the rod by Ritz' method; the coarser one gives the uncertainty."""
    settings = _QUICK_TRUTHS if quick else _TRUTHS
    coarse, fine = (
        RigRod(ROBOT, terms).motion(MOTIONS[case], sample_times(), rtol) for terms, rtol in settings
    )
    uncertainty, (terms, rtol) = runs.distance(coarse, fine), settings[1]
    text = f"rod by Ritz' method, {terms} terms, Radau {rtol:.0e}"
    return runs.Limit(fine, uncertainty, f"{text}; uncertainty {1e3 * uncertainty:.1g} mm")


def chain_motion(
    case: str, rule: str, n: int, timestep: float, integrator: str = "implicitfast"
) -> cases.ChainMotion:
    """A motion of the MuJoCo chain with n joints."""
    options = CHAIN | {"timestep": timestep, "integrator": integrator}
    return cases.ChainMotion(chain_scene(ROBOT, rule, n, **options), MOTIONS[case])


def subpieces_motion(case: str, n: int, tolerance: float) -> cases.BeamMotion:
    """PCC of n pieces with the thesis' three rigid bodies, which hold the head."""
    beam = PCC(ROBOT, n, axes="spatial", inertia=SUBPIECES, drive="length")

    def tips(q: ndarray) -> ndarray:
        return beam.tip(q) + ROBOT.head.output * end_axis(beam, q)

    signal = signals.smooth(MOTIONS[case], cases.DURATION)
    return cases.BeamMotion("pcc/subpieces", n, beam, signal, tips, PERIOD, tolerance=tolerance)


def motion_jobs(quick: bool = False) -> Iterator[Job]:
    """Jobs of all motions; a quick run has one of them, on few models."""
    limits: dict[str, runs.Limit] = {}

    def find(case: str) -> list[cases.Row]:
        limits[case] = motion_truth(case, quick)
        return []

    for case in (STEP,) if quick else MOTIONS:
        yield f"{case}, truth", partial(find, case)
        yield f"{case}, chain", partial(chain_rows, case, limits, quick)
        yield f"{case}, PCC", partial(pcc_rows, case, limits, quick)
        if not quick:
            yield f"{case}, agreement", lambda c=case: [agreement(c, limits[c])]
    left_out = [
        cases.Row("note", "rig", m, reference=f"left out: {why}") for m, why in LEFT_OUT.items()
    ]
    yield "rig, models left out", lambda: left_out


def agreement(case: str, exact: runs.Limit) -> cases.Row:
    """Distance of the chain's limit from the rod by Ritz' method."""
    limit = cases.chain_limit(partial(chain_motion, case), *LIMIT)
    gap = runs.distance(limit.tips, exact.tips)
    text = f"{limit.text}; {exact.text}"
    pair = "mujoco_chain/gauss2 / ritz_rod"
    return cases.agreement_row(case, pair, 32, gap, ROBOT.length, cases.BENDING.name, text)


def chain_rows(case: str, limits: dict[str, runs.Limit], quick: bool = False) -> list[cases.Row]:
    """Runs of the chain over rules, joints, integrators and timesteps."""
    motions = (
        chain_motion(case, rule, n, timestep, integrator)
        for rule in (QUICK_RULES if quick else RULES)
        for n in joint_numbers(rule)[1 : 3 if quick else 4]
        for integrator, timestep in product(INTEGRATORS, TIMESTEPS)
    )
    repeats = 2 if quick else 5
    return [
        cases.timed_row(case, cases.BENDING, limits[case], motion, repeats) for motion in motions
    ]


def pcc_rows(case: str, limits: dict[str, runs.Limit], quick: bool = False) -> list[cases.Row]:
    """Runs of PCC with given rigid bodies, with adapted steps."""
    found, repeats = [], 1 if quick else 5
    for n in MOVING_PIECES:
        still = subpieces_motion(case, n, _CONVERGED)()
        for tolerance in TOLERANCES[1:3] if quick else TOLERANCES:
            about = case, cases.BENDING, limits[case], subpieces_motion(case, n, tolerance)
            found.append(cases.timed_row(*about, repeats, still))
    return found
