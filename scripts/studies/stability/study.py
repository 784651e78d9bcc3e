"""Which timesteps are safe: maps of stability, the timestep rule on them, and extreme cases.

A run is stable only if it stays finite and its tip stays within a stated bound of a refined run
of the same model (or of an independent truth). Everything else is a failure with its reason.
"""

from functools import partial

from studies.lab import Lab, Record, Study
from studies.stability import extremes, integrators, rig, shown
from studies.stability.map import ALL_DAMPINGS, NOMINAL, SOME_DAMPINGS, Family, map_rows
from studies.stability.runs import CHAIN, Job, Row

#: Beam models, see `studies.beams.make_beam`.
BEAMS = ("pcc", "cosserat", "ancf2d")

#: Models with pieces and damping ratios of their maps, of the chain and of the beams.
_SIZES = [(CHAIN, ((12, ALL_DAMPINGS), (6, SOME_DAMPINGS), (48, SOME_DAMPINGS)))]
_SIZES += [(name, ((6, ALL_DAMPINGS), (24, SOME_DAMPINGS))) for name in BEAMS]
MAPS = [(Family(name, n), dampings) for name, sizes in _SIZES for n, dampings in sizes]

#: Of a quick run: damping ratios, and timesteps, stiffnesses and shares of the limit of all maps.
_DAMPINGS = (0.0, NOMINAL, 5.0)
_QUICK = (1e-4, 1e-3, 5e-3, 2e-2), (1e-2, 1.0, 1e2, 1e4), (0.5, 0.95, 1.2, 2.0)
QUICK_MAPS = [(Family(CHAIN, 6), _DAMPINGS), *((Family(name, 3), _DAMPINGS) for name in BEAMS)]


def run(lab: Lab) -> list[Record]:
    """Rows of the maps, the rule, the extreme cases, the rig, and the integrators.

    The case of a row is "map", "rule" (what the timestep rule picks), "rule_asked" (the rule with
    a fixed integrator), "limit" (around the stability limit of the linearised chain), the name of
    an extreme case, or one of the rig's `CASES`, of rows with further fields.
    """
    quick = lab.quick
    maps, axes = (QUICK_MAPS, _QUICK) if quick else (MAPS, ())
    jobs: list[Job] = [
        (f"{each.model} {each.n}, damping {z:.2g}", partial(map_rows, each, z, *axes))
        for each, dampings in maps
        for z in dampings
    ]
    jobs += [*extremes.jobs(BEAMS, quick), *rig.jobs(quick), *integrators.jobs(quick)]
    return [row for found in lab.tasks(jobs) for row in found]


STUDY = Study(
    kinds=(Row, rig.RigRow, integrators.FrontRow),
    stages=run,
    tables=shown.TABLES,
    plots=shown.PLOTS,
    note="What the rule does on robots of all kinds: softrobot benchmark scenes",
    alone=True,
)
