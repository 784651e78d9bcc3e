"""Which timesteps are safe: maps of stability, the timestep rule on them, and extreme cases.

A run is stable only if it stays finite and its tip stays within a stated bound of a refined run
of the same model (or of an independent truth). Everything else is a failure with its reason.
"""

from collections.abc import Iterator
from itertools import product

from studies.lab import Lab, Record, Study
from studies.stability import extremes, integrators, rig, shown
from studies.stability.map import ALL_DAMPINGS, NOMINAL, SOME_DAMPINGS, Family
from studies.stability.map import jobs as map_jobs
from studies.stability.runs import CHAIN, Job, Row

#: Beam models, see `studies.beams.make_beam`.
BEAMS = ("pcc", "cosserat", "ancf2d")

#: Hinges of the chain and pieces of the beams, with the damping ratios of their maps.
CHAINS = ((12, ALL_DAMPINGS), (6, SOME_DAMPINGS), (48, SOME_DAMPINGS))
PIECES = ((6, ALL_DAMPINGS), (24, SOME_DAMPINGS))

#: A quick run: coarser in timestep, stiffness and damping.
QUICK_TIMESTEPS = (1e-4, 1e-3, 5e-3, 2e-2)
QUICK_STIFFNESSES = (1e-2, 1.0, 1e2, 1e4)
QUICK_DAMPINGS = (0.0, NOMINAL, 5.0)
QUICK_RATIOS = (0.5, 0.95, 1.2, 2.0)


def run(lab: Lab) -> list[Record]:
    """Rows of the maps, the rule, the extreme cases, the rig, and the integrators.

    The case of a row is "map", "rule" (what the timestep rule picks), "rule_asked" (the rule with
    a fixed integrator), "limit" (around the stability limit of the linearised chain), the name of
    an extreme case, or one of the rig's `CASES`, of rows with further fields.
    """
    jobs = list(_quick_jobs() if lab.quick else _full_jobs())
    return [row for found in lab.tasks(jobs) for row in found]


def _full_jobs() -> Iterator[Job]:
    for n, dampings in CHAINS:
        yield from map_jobs(Family(CHAIN, n), dampings)
    for name, (n, dampings) in product(BEAMS, PIECES):
        yield from map_jobs(Family(name, n), dampings)
    yield from extremes.jobs(BEAMS)
    yield from rig.jobs()
    yield from integrators.jobs()


def _quick_jobs() -> Iterator[Job]:
    grid = QUICK_DAMPINGS, QUICK_TIMESTEPS, QUICK_STIFFNESSES, QUICK_RATIOS
    for family in (Family(CHAIN, 6), *(Family(name, 3) for name in BEAMS)):
        yield from map_jobs(family, *grid)
    yield from extremes.jobs(BEAMS, quick=True)
    yield from rig.jobs(quick=True)
    yield from integrators.jobs(quick=True)


STUDY = Study(
    kinds=(Row, rig.RigRow, integrators.FrontRow),
    stages=run,
    tables=shown.TABLES,
    plots=shown.PLOTS,
    note="What the rule does on robots of all kinds: softrobot benchmark scenes",
    alone=True,
)
