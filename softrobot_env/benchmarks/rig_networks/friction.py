"""How far friction of the tendons sets the errors of the rig's networks.

On the stand-in of `training.rig_statics`: one piece, no servos, and of a camera nothing but its
noise. It is visited without dither, so that of all errors of a rig friction alone is varied.
"""

from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np

from softrobot_env.benchmarks.rig_networks.cases import Case, CellRow, run_case
from softrobot_env.control.rig.inverse import TOTAL
from softrobot_env.core.jobs import Progress, run_in_processes
from softrobot_env.identification.networks import DIRECTIONS, HIDDEN, TRAINING
from softrobot_env.identification.slow_rig import RigStatics
from softrobot_env.identification.visits import collect, split
from softrobot_env.robots import RIG

#: Friction [N] of each tendon.
FRICTIONS = (0.0, 0.05, 0.1, 0.3)

#: Sums of the tensions [N] that remove the redundancy; None for the least tensions.
TOTALS = (TOTAL, None)

#: Of the camera's noise, the order of the visit and the split of the data.
_SEED = 0


@dataclass(frozen=True)
class FrictionRow(CellRow):
    """Trainings with the data of one stand-in.

    Attributes:
        friction: [N] of each tendon.
        total: [N], one of `TOTALS`.
    """

    friction: float
    total: float | None


def friction_rows(
    points: np.ndarray, trainings: int, progress: Progress, processes: int | None = None
) -> list[FrictionRow]:
    """Train the networks that are used with data of stand-ins that differ in their friction.

    Args:
        points: (n, 2) [m] to visit, 215 or more.
        trainings: Per network, of which the median counts.
        progress: Called with (description, done, total).
        processes: Visits at a time; one per core unless given.
    """
    tasks = [
        (f"friction {friction:g} N", partial(_rows, points, trainings, friction, total))
        for total, friction in product(TOTALS, FRICTIONS)
    ]
    return [row for rows in run_in_processes(tasks, progress, processes) for row in rows]


def _rows(
    points: np.ndarray, trainings: int, friction: float, total: float | None
) -> list[FrictionRow]:
    """Rows of both directions, of one visit."""
    rig = RigStatics(friction=friction, seed=_SEED)
    data = collect(RIG, rig, np.random.default_rng(_SEED), points, total)
    parts = split(len(points), np.random.default_rng(_SEED))
    used = {"layers": len(HIDDEN), "neurons": HIDDEN[0], "samples": TRAINING}
    cases = [Case("friction", direction, trainings=trainings, **used) for direction in DIRECTIONS]
    cells = [run_case(case, data, parts) for case in cases]
    return [FrictionRow(**vars(cell), friction=friction, total=total) for cell in cells]
