"""The rig at rest: all models against the column without a mesh, and what they converge to.

Each model gives the output point for lengths pulled in. The closed form and the chain have the
head. The beam models have none beyond the backbone's end: at rest its weight is a dead force on the
end, and a moment that is found together with the posture.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import root

from softrobot_env.beams.model import BeamModel
from softrobot_env.benchmarks.accuracy.cases.beam_models import COSSERAT, DISTRIBUTED, Contestant
from softrobot_env.benchmarks.accuracy.rig.cases import CHAIN, ROBOT, STATIC
from softrobot_env.benchmarks.accuracy.rows import (
    BENDING,
    SHEAR,
    Limit,
    Physics,
    Row,
    agreement_row,
    converged,
    distance,
    static_row,
)
from softrobot_env.benchmarks.beams import chain_scene
from softrobot_env.benchmarks.timing import best_of
from softrobot_env.core.jobs import Job
from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load
from softrobot_env.scene.quadrature import RULES
from softrobot_env.thesis.rig.spatial_piece import RigPiece, add_static, make_rig_piece, output
from studies.truths.rig_column import column_tip, tensions
from studies.truths.rig_ritz_rod import RigRod

PIECE = "rig_piece"

#: Joints of the chain, coarse to fine; those of rules with three joints per piece.
JOINTS, JOINTS_OF_THREES = (2, 4, 8, 16, 32), (3, 6, 12, 24)

#: Pieces of the beam models at rest.
PIECES = {DISTRIBUTED.name: (1, 2, 4, 8, 16), COSSERAT.name: (6, 12, 24, 48)}

_LOAD_STEPS = 4
_TOLERANCE = 1e-12

#: Name of the rod by Ritz' method in the report.
RITZ = "ritz_rod"
_TERMS = 8

#: The Cosserat rod applies moments half a segment before its end, an error of first order.
_FIRST_ORDER = "cosserat"

#: Output point (3,) [m] for lengths (3,) [m].
Solve = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Entry:
    """A model with its resolution.

    Attributes:
        name: Name in the report.
        n: Pieces, of the chain joints.
        physics: What it converges to.
        solve: Statics.
    """

    name: str
    n: int
    physics: Physics
    solve: Solve


def entries(quick: bool = False) -> list[Entry]:
    """All models at rest; a quick run has the coarsest ones."""
    found = [Entry(PIECE, 1, BENDING, piece_statics())]
    for contestant in (DISTRIBUTED, COSSERAT):
        for n in PIECES[contestant.name][: 2 if quick else None]:
            solve = beam_statics(contestant, n)
            found.append(Entry(contestant.name, n, contestant.physics, solve))
    for rule in RULES:
        for n in joint_numbers(rule)[: 3 if quick else None]:
            found.append(Entry(f"mujoco_chain/{rule}", n, BENDING, chain_statics(rule, n)))
    return found


def joint_numbers(rule: str) -> tuple[int, ...]:
    """Joints of the chain with a rule."""
    return JOINTS_OF_THREES if len(RULES[rule]) == 3 else JOINTS


def piece_statics(robot: RobotParams = ROBOT) -> Solve:
    """The closed form of one piece, with uniform backbone and head."""
    piece = make_rig_piece(robot, "distributed")
    offsets = np.array([t.offset for t in robot.tendons])

    def missing(y: np.ndarray, pulled: np.ndarray) -> np.ndarray:
        moment = tensions(robot, pulled, np.array([y[1], -y[0]])) @ offsets
        out = np.array([moment[1], -moment[0]])
        add_static(piece, y, out)
        return out

    def solve(pulled: np.ndarray) -> np.ndarray:
        y = np.zeros(2)
        for share in np.arange(1, _LOAD_STEPS + 1) / _LOAD_STEPS:
            y = root(missing, y, (share * pulled,), tol=_TOLERANCE).x
        return piece_output(piece, y)

    return solve


def piece_output(piece: RigPiece, y: np.ndarray) -> np.ndarray:
    """Output point (3,) [m] of the closed form at y (2,) [rad]."""
    point, jacobian = np.empty(3), np.empty((3, 2))
    output(piece, np.ascontiguousarray(y), point, jacobian)
    return point


def beam_statics(contestant: Contestant, n: int) -> Solve:
    """A beam model that carries the head as a dead load."""
    weight = ROBOT.head.mass * np.array(ROBOT.gravity)
    end = ROBOT.length
    loads = (
        Load("head", end, force=tuple(weight)),
        Load("lever_x", end, moment=(1.0, 0.0, 0.0)),
        Load("lever_y", end, moment=(0.0, 1.0, 0.0)),
    )
    model = contestant.build(replace(ROBOT, head=None), n, loads, "spatial", drive="length")

    def solve(pulled: np.ndarray) -> np.ndarray:
        q, moment = model.rest(), np.zeros(2)
        for share in np.arange(1, _LOAD_STEPS + 1) / _LOAD_STEPS:

            def posture(
                moment: np.ndarray, share: float = share, near: np.ndarray = q
            ) -> np.ndarray:
                u = np.array([*(share * pulled), 1.0, *moment])
                return model.equilibrium(u, near, check_stability=False)

            def missing(moment: np.ndarray, posture: Callable = posture) -> np.ndarray:
                lever = ROBOT.head.centre * end_axis(model, posture(moment))
                return np.cross(lever, weight)[:2] - moment

            moment = root(missing, moment, tol=_TOLERANCE).x
            q = posture(moment)
        return model.tip(q) + ROBOT.head.output * end_axis(model, q)

    return solve


def end_axis(model: BeamModel, q: np.ndarray) -> np.ndarray:
    """Unit vectors (..., 3) along a head that is fixed to the end, at q (n,) or (T, n)."""
    radius = model.robot.outer_radius
    places = np.array([[0.0, 0.0], [radius, 0.0], [0.0, radius]])
    points = model.positions(q, np.full(3, model.robot.length), places)
    centre, x, y = np.moveaxis(points, -2, 0)
    axis = np.cross(x - centre, y - centre)
    return axis / np.linalg.norm(axis, axis=-1, keepdims=True)


def chain_statics(rule: str, n: int) -> Solve:
    """The MuJoCo chain on n joints."""
    scene = chain_scene(ROBOT, rule, n, **CHAIN)

    def solve(pulled: np.ndarray) -> np.ndarray:
        return scene.tip(scene.equilibrium(pulled, load_steps=_LOAD_STEPS))

    return solve


def jobs(quick: bool = False) -> Iterator[Job]:
    """One job for each case; a quick run has the first and the last one."""
    for case in list(STATIC)[:: len(STATIC) - 1 if quick else 1]:
        yield f"{case}, all models", lambda c=case: case_rows(c, quick)


def truth(case: str, physics: Physics) -> Limit:
    """The exact tip (3,) [m] of a case."""
    tip = column_tip(ROBOT, np.array(STATIC[case]), physics.shear_coefficient)
    kind = "that only bends" if physics == BENDING else "with shear and extension"
    return Limit(tip, 0.0, f"column {kind} (initial values from the end)")


def case_rows(case: str, quick: bool = False) -> list[Row]:
    """Errors of all models, and what they converge to."""
    truths = {physics.name: truth(case, physics) for physics in (BENDING, SHEAR)}
    found, tips = [], {}
    for entry in entries(quick):
        if entry.name not in {name for name, _ in tips}:
            entry.solve(np.array(STATIC[case]))  # compiles
        wall_time, tip = best_of(lambda e=entry: e.solve(np.array(STATIC[case])), 1 if quick else 5)
        exact = truths[entry.physics.name]
        options = {"wall_time": wall_time}
        found.append(static_row(case, entry.name, entry.n, entry.physics, exact, tip, **options))
        tips.setdefault((entry.name, entry.physics.name), {})[entry.n] = tip
    found.append(_ritz_row(case, truths[BENDING.name]))
    if not quick:
        for (model, physics), by_size in tips.items():
            if model != PIECE:
                found.append(_limit_row(case, model, by_size, physics, truths[physics]))
    return found


def _ritz_row(case: str, exact: Limit) -> Row:
    """Whether two independent truths agree, one by polynomials, one by initial values."""
    rod = RigRod(ROBOT, _TERMS)
    tip = rod.tip(rod.equilibrium(np.array(STATIC[case])))
    gap = distance(tip, exact.tips)
    return agreement_row(case, RITZ, _TERMS, gap, ROBOT.length, BENDING.name, exact.text)


def _limit_row(
    case: str, model: str, tips: dict[int, np.ndarray], physics: str, exact: Limit
) -> Row:
    sizes = sorted(tips)[-3:]
    limit = converged({n: tips[n] for n in sizes}, 1 if model == _FIRST_ORDER else 2)
    text = f"limit of n = {', '.join(map(str, sizes))}; {exact.text}"
    gap = distance(limit, exact.tips)
    return agreement_row(case, model, sizes[-1], gap, ROBOT.length, physics, text)
