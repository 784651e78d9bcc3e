"""The rig at rest: error of every model against the column without a mesh, and of their limits."""

from collections.abc import Iterator

import numpy as np

from softrobot_env.beams.exact.rig_column import column_tip
from softrobot_env.beams.exact.rig_ritz_rod import RigRod
from softrobot_env.benchmarks.accuracy.rig.cases import ROBOT, STATIC
from softrobot_env.benchmarks.accuracy.rig.models import PIECE, entries
from softrobot_env.benchmarks.accuracy.rows import (
    BENDING,
    SHEAR,
    Limit,
    Physics,
    Row,
    agreement_row,
    distance,
    static_row,
)
from softrobot_env.benchmarks.jobs import Job
from softrobot_env.benchmarks.timing import best_of

#: Name of the rod by Ritz' method in the report.
RITZ = "ritz_rod"
_TERMS = 8

#: The Cosserat rod applies moments half a segment before its end, an error of first order.
_FIRST_ORDER = "cosserat"


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
    limit = converged(tips, sizes, 1 if model == _FIRST_ORDER else 2)
    text = f"limit of n = {', '.join(map(str, sizes))}; {exact.text}"
    gap = distance(limit, exact.tips)
    return agreement_row(case, model, sizes[-1], gap, ROBOT.length, physics, text)


def converged(tips: dict[int, np.ndarray], sizes: list[int], order: int) -> np.ndarray:
    """Limit (3,) [m] of three sizes, for an error series in powers of 1 / n^order."""
    x = np.array([1 / n**order for n in sizes])
    powers = np.vander(x, increasing=True)
    return np.linalg.solve(powers, np.array([tips[n] for n in sizes]))[0]
