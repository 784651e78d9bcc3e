"""Which timesteps are safe: maps of stability, the timestep rule on them, and extreme cases.

A run is stable only if it stays finite and its tip stays within a stated bound of a refined run
of the same model (or of an independent truth). Everything else is a failure with its reason.
"""

from collections.abc import Iterator
from itertools import product

from softrobot_env.benchmarks.stability import extremes, front
from softrobot_env.benchmarks.stability.map import ALL_DAMPINGS, NOMINAL, SOME_DAMPINGS, Family
from softrobot_env.benchmarks.stability.map import jobs as map_jobs
from softrobot_env.benchmarks.stability.rig import runs as rig
from softrobot_env.benchmarks.stability.runs import CHAIN
from softrobot_env.benchmarks.stability.verdicts import Row
from softrobot_env.core.jobs import Job, Progress, run_jobs

#: Beam models, see `benchmarks.beams.make_beam`.
BEAMS = ("pcc", "cosserat", "ancf2d")

#: Hinges of the chain and pieces of the beams, with the damping ratios of their maps.
CHAINS = ((12, ALL_DAMPINGS), (6, SOME_DAMPINGS), (48, SOME_DAMPINGS))
PIECES = ((6, ALL_DAMPINGS), (24, SOME_DAMPINGS))

#: A quick run: coarser in timestep, stiffness and damping.
QUICK_TIMESTEPS = (1e-4, 1e-3, 5e-3, 2e-2)
QUICK_STIFFNESSES = (1e-2, 1.0, 1e2, 1e4)
QUICK_DAMPINGS = (0.0, NOMINAL, 5.0)
QUICK_RATIOS = (0.5, 0.95, 1.2, 2.0)


def run(
    quick: bool = False, progress: Progress | None = None
) -> list[Row | rig.RigRow | front.FrontRow]:
    """Measure the maps, the rule and the extreme cases.

    Args:
        quick: Small maps of the coarsest models, and fewer extreme cases.
        progress: Called with (description, done, total), or None.

    Returns:
        Rows. Their case is "map", "rule" (what the timestep rule picks), "rule_asked" (the rule
        with a fixed integrator), "limit" (around the stability limit of the linearised chain), or
        the name of an extreme case, or one of the rig's `CASES`, of rows with further fields;
        and rows of the integrators' error against cost.
    """
    return run_jobs(list(_quick_jobs() if quick else _full_jobs()), progress)


def _full_jobs() -> Iterator[Job]:
    for n, dampings in CHAINS:
        yield from map_jobs(Family(CHAIN, n), dampings)
    for name, (n, dampings) in product(BEAMS, PIECES):
        yield from map_jobs(Family(name, n), dampings)
    yield from extremes.jobs(BEAMS)
    yield from rig.jobs()
    yield from front.jobs()


def _quick_jobs() -> Iterator[Job]:
    grid = QUICK_DAMPINGS, QUICK_TIMESTEPS, QUICK_STIFFNESSES, QUICK_RATIOS
    for family in (Family(CHAIN, 6), *(Family(name, 3) for name in BEAMS)):
        yield from map_jobs(family, *grid)
    yield from extremes.jobs(BEAMS, quick=True)
    yield from rig.jobs(quick=True)
    yield from front.jobs(quick=True)
