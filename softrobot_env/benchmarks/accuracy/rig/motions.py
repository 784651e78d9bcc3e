"""Motions of the rig: a step of one length and a fast circle, on all models that can move it.

What takes part: the chain on all hinge rules and the closed form of one piece have the head, and
do everything. PCC and the Cosserat rod bend in space with elastic tendons, but have no body beyond
the end of the backbone: at rest the head is a dead load, in motion PCC has the thesis' three rigid
bodies in its place, and the Cosserat rod has none.
"""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

from softrobot_env.beams import signals
from softrobot_env.beams.pcc import PCC
from softrobot_env.benchmarks.accuracy.cases.motions import (
    BeamMotion,
    ChainMotion,
    TimedMotion,
    timed_row,
)
from softrobot_env.benchmarks.accuracy.rig.cases import (
    CHAIN,
    MOTIONS,
    PERIOD,
    ROBOT,
    STEP,
    sample_times,
)
from softrobot_env.benchmarks.accuracy.rig.statics import (
    PIECE,
    end_axis,
    joint_numbers,
    piece_output,
)
from softrobot_env.benchmarks.accuracy.rows import (
    BENDING,
    DURATION,
    Limit,
    Row,
    Settings,
    agreement_row,
    distance,
    extrapolate,
    zero_timestep,
)
from softrobot_env.benchmarks.beams import chain_scene
from softrobot_env.core.jobs import Job
from softrobot_env.scene.quadrature import RULES
from softrobot_env.thesis.rig.spatial_piece import SUBPIECES, acceleration, make_rig_piece
from studies.truths.rig_column import tensions
from studies.truths.rig_ritz_rod import RigRod

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

#: Terms and tolerances of the truth, the coarser first; of a quick run.
_TRUTHS = ((5, 1e-6), (6, 1e-7))
_QUICK_TRUTHS = ((3, 1e-4), (4, 1e-4))

#: Substeps of the chain's limit: h, h / 2 and h / 4.
_FINE = (40, 80, 160)
_SIZES = (8, 16, 32)


def truth(case: str, quick: bool = False) -> Limit:
    """Tips (k, 3) [m] of the rod by Ritz' method; the coarser one gives the uncertainty."""
    coarse, fine = (
        RigRod(ROBOT, terms).motion(MOTIONS[case], sample_times(), rtol)
        for terms, rtol in (_QUICK_TRUTHS if quick else _TRUTHS)
    )
    uncertainty = distance(coarse, fine)
    terms, rtol = (_QUICK_TRUTHS if quick else _TRUTHS)[1]
    text = f"rod by Ritz' method, {terms} terms, Radau {rtol:.0e}"
    return Limit(fine, uncertainty, f"{text}; uncertainty {1e3 * uncertainty:.1g} mm")


def chain_motion(case: str, rule: str, n: int, substeps: int, integrator: str) -> ChainMotion:
    """A motion of the MuJoCo chain with n joints and some timesteps per control period."""
    options = CHAIN | {"timestep": PERIOD / substeps, "integrator": integrator}
    return ChainMotion(chain_scene(ROBOT, rule, n, **options), MOTIONS[case])


def chain_limit(case: str) -> Limit:
    """The chain's motion with infinitely many joints and at zero timestep."""

    def solve(n: int) -> np.ndarray:
        motions = [chain_motion(case, "gauss2", n, k, "implicitfast")() for k in _FINE]
        return zero_timestep(motions)[0]

    return extrapolate(solve, _SIZES, "limit of mujoco_chain/gauss2 at zero timestep")


def subpieces_motion(case: str, n: int, tolerance: float) -> BeamMotion:
    """PCC of n pieces with the thesis' three rigid bodies, which hold the head."""
    beam = PCC(ROBOT, n, axes="spatial", inertia=SUBPIECES, drive="length")

    def tips(q: np.ndarray) -> np.ndarray:
        return beam.tip(q) + ROBOT.head.output * end_axis(beam, q)

    signal = signals.smooth(MOTIONS[case], DURATION)
    return BeamMotion("pcc/subpieces", n, beam, signal, tips, PERIOD, tolerance=tolerance)


class PieceMotion:
    """The closed form of one piece with uniform backbone and head, integrated by SciPy.

    Args:
        case: Key of `MOTIONS`.
        tolerance: Relative, and absolute of angles and rates.
    """

    def __init__(self, case: str, tolerance: float) -> None:
        self._piece, self._pulled = make_rig_piece(ROBOT, "distributed"), MOTIONS[case]
        self._tolerance, self._steps = tolerance, 1

    @property
    def settings(self) -> Settings:
        """What it was simulated with; the steps are those of the last call."""
        return Settings(PIECE, 1, DURATION / self._steps, "RK45", self._tolerance)

    def _slope(self, t: float, x: np.ndarray) -> np.ndarray:
        out = np.empty(4)
        out[:2] = x[2:]
        force = tensions(ROBOT, self._pulled(t), np.array([x[1], -x[0]]))
        acceleration(self._piece, x[:2], x[2:], force, out[2:])
        return out

    def __call__(self) -> np.ndarray:
        """Tips (k, 3) [m]."""
        found = solve_ivp(
            self._slope,
            (0, DURATION),
            np.zeros(4),
            t_eval=sample_times(),
            rtol=self._tolerance,
            atol=self._tolerance,
            dense_output=True,
        )
        self._steps = len(found.sol.ts) - 1
        return np.array([piece_output(self._piece, y) for y in found.y[:2].T])


def jobs(quick: bool = False) -> Iterator[Job]:
    """Jobs of all motions; a quick run has one of them, on few models."""
    limits: dict[str, Limit] = {}

    def find(case: str) -> list[Row]:
        limits[case] = truth(case, quick)
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
    limit = chain_limit(case)
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
