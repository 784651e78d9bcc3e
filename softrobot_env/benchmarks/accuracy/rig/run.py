"""Error against run time of all models of the spatial rig: elastic tendons, pretension, a head.

What takes part: the chain on all hinge rules and the closed form of one piece have the head, and
do everything. PCC and the Cosserat rod bend in space with elastic tendons, but have no body beyond
the end of the backbone: at rest the head is a dead load, in motion PCC has the thesis' three rigid
bodies in its place, and the Cosserat rod has none.
"""

from collections.abc import Callable, Iterator
from functools import partial

from softrobot_env.benchmarks.accuracy.cases.motions import TimedMotion, timed_row
from softrobot_env.benchmarks.accuracy.rig import motions, statics
from softrobot_env.benchmarks.accuracy.rig.cases import MOTIONS, ROBOT, STEP
from softrobot_env.benchmarks.accuracy.rig.models import joint_numbers
from softrobot_env.benchmarks.accuracy.rig.motions import (
    PieceMotion,
    chain_motion,
    subpieces_motion,
)
from softrobot_env.benchmarks.accuracy.rows import BENDING, Limit, Row, agreement_row, distance
from softrobot_env.benchmarks.jobs import Job
from softrobot_env.scene.quadrature import RULES

#: Timesteps per control period, integrators of the chain, and hinge rules of a quick run.
SUBSTEPS = (20, 10, 4, 2)
INTEGRATORS = ("implicitfast", "discrete")
QUICK_RULES = ("gauss2", "balanced2")

#: Pieces of PCC, whose three rigid bodies give inertia to no more, and tolerances.
PIECES = (1, 2, 3)
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
_CONVERGED = 1e-8

#: Models that are left out, and why.
LEFT_OUT = {
    "cosserat, in motion": "it has no rigid bodies, and the head has most of the rig's inertia",
    "pcc/lumped, pcc/distributed, in motion": "no rigid body beyond the backbone's end",
    "ancf": "no rod is exact for this continuum where bending is uneven, and it has no head",
}


def jobs(quick: bool = False) -> Iterator[Job]:
    """Jobs of all cases; a quick run moves in one of them, on few models."""
    yield from statics.jobs(quick)
    limits: dict[str, Limit] = {}

    def find(case: str) -> list[Row]:
        limits[case] = motions.truth(case, quick)
        return []

    for case in (STEP,) if quick else MOTIONS:
        yield f"{case}, truth", lambda c=case: find(c)
        yield f"{case}, chain", lambda c=case: chain_rows(c, limits[c], quick)
        yield f"{case}, one piece and PCC", lambda c=case: piece_rows(c, limits[c], quick)
        if not quick:
            yield f"{case}, agreement", lambda c=case: [agreement(c, limits[c])]
    yield "rig, models left out", notes


def notes() -> list[Row]:
    """Which models cannot be the rig, and why."""
    return [
        Row("note", "rig", model, reference=f"left out: {why}") for model, why in LEFT_OUT.items()
    ]


def agreement(case: str, exact: Limit) -> Row:
    """Distance of the chain's limit from the rod by Ritz' method."""
    limit = motions.chain_limit(case)
    gap = distance(limit.tips, exact.tips)
    text = f"{limit.text}; {exact.text}"
    pair = "mujoco_chain/gauss2 / ritz_rod"
    return agreement_row(case, pair, 32, gap, ROBOT.length, BENDING.name, text)


def chain_rows(case: str, exact: Limit, quick: bool = False) -> list[Row]:
    """Runs of the chain over rules, joints, integrators and timesteps."""
    return [
        timed_row(
            case, BENDING, exact, chain_motion(case, rule, n, k, integrator), 2 if quick else 5
        )
        for rule in (QUICK_RULES if quick else RULES)
        for n in joint_numbers(rule)[1 : 3 if quick else 4]
        for integrator in INTEGRATORS
        for k in SUBSTEPS
    ]


def piece_rows(case: str, exact: Limit, quick: bool = False) -> list[Row]:
    """Runs of the closed form and of PCC with given rigid bodies, with adapted steps."""
    found = _adaptive_rows(case, partial(PieceMotion, case), exact, quick)
    for n in PIECES:
        found += _adaptive_rows(case, partial(subpieces_motion, case, n), exact, quick)
    return found


def _adaptive_rows(
    case: str, make: Callable[[float], TimedMotion], exact: Limit, quick: bool
) -> list[Row]:
    """Runs at several tolerances, for which `make` makes the motion."""
    still, repeats = make(_CONVERGED)(), 1 if quick else 5
    return [
        timed_row(case, BENDING, exact, make(tolerance), repeats, still)
        for tolerance in (TOLERANCES[1:3] if quick else TOLERANCES)
    ]
