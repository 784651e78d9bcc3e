"""Is the rule's timestep good for contacts, and what do forces of contacts miss?

Moving scenes run on a grid of stiffness, friction and timestep and are judged by refined runs; rods
at rest are compared with exact solutions.
"""

from functools import partial
from itertools import product

from softrobot_env.benchmarks.contacts.cases import CASES
from softrobot_env.benchmarks.contacts.exact import CHECKS, check
from softrobot_env.benchmarks.contacts.judge import judged
from softrobot_env.benchmarks.contacts.rows import Cell, Check
from softrobot_env.core.jobs import Progress, run_in_processes

#: Stiffnesses over that of the robot's material [1], friction coefficients [1], and timesteps over
#: the rule's [1].
STIFFNESSES = (0.01, 0.1, 1.0, 10.0, 100.0)
FRICTIONS = (0.0, 0.3, 1.0)
STEPS = (1, 2, 4, 8, 16)

#: Scenes that take more computing than the others together.
LONGEST = ("trunk, box and wall", "gripper closes on bar")

#: Pieces of the rods at rest.
PIECES = (6, 12, 24, 48)


def run(quick: bool = False, progress: Progress | None = None) -> list[Cell | Check]:
    """Judge the grid and check the rods, in a process for each core.

    Args:
        quick: One stiffness and friction, two timesteps, few pieces, and none of the `LONGEST`.
        progress: Called with (description, done, total), or None.
    """
    stiffnesses, frictions = ((1.0,), (1.0,)) if quick else (STIFFNESSES, FRICTIONS)
    steps, pieces = ((1, 8), PIECES[:2]) if quick else (STEPS, PIECES)
    cases = [case for case in CASES if not (quick and case in LONGEST)]
    tasks = [
        (f"{case}, {stiffness:g} x, friction {friction:g}", partial(judged, *grid, steps))
        for grid in product(cases, stiffnesses, frictions)
        for case, stiffness, friction in [grid]
    ]
    tasks += [(f"{case}, {n} pieces", partial(check, case, n)) for case in CHECKS for n in pieces]
    return [row for rows in run_in_processes(tasks, progress) for row in rows]
