"""Whether the intervals of an identification hold a recording of the same robot that was kept back.

Twins with friction whose servos and camera drift, see `truths.drifting_twin`: nothing was chosen by
what was kept back.
"""

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from softrobot_env.identification.errors import size
from softrobot_env.identification.fit.path import identify, placed
from softrobot_env.identification.replay import replay
from softrobot_env.robots import find_robot
from studies import lab
from studies.truths.drifting_twin import recorded

#: Robots of which twins drift, and how many of forty.
ROBOTS = {"silicone_rod": 16, "rig": 16, "ftdcr_v4": 8}

#: Seed of the first twin of each; those before were used to find the method.
FIRST = 300

#: Mean share of the rows kept back that their 95 % intervals have to hold.
HELD = (0.90, 0.98)

_STAGES = ("frame", "tendons", "geometry", "statics")


@dataclass(frozen=True)
class KeptRow(lab.Record):
    """A recording of a drifting twin that an identification did not see.

    Attributes:
        robot, twin: Name, and the seed of the twin.
        fitted, left_out, kept: [m], RMS of the rows that were fitted, of their blocks when they
            were left out, and of those kept back, by the chain of what was found.
        width: [m], mean half width of the intervals of the rows kept back.
        held: Share of these that the intervals hold.
        beyond: Share that is farther from what was identified than was tested.
        time: [s] that the identification took.
    """

    robot: str
    twin: int = lab.quantity("", "d")
    fitted: float = lab.quantity("mm", ".2f")
    left_out: float = lab.quantity("mm", ".2f", "left out")
    kept: float = lab.quantity("mm", ".2f", "kept back")
    width: float = lab.quantity("mm", ".2f", "interval")
    held: float = lab.quantity("%", ".0f", "it holds")
    beyond: float = lab.quantity("%", ".0f", "untested")
    time: float = lab.quantity("s", ".0f")


def measure(case: tuple[str, int]) -> KeptRow:
    """Whether the intervals hold of a twin."""
    name, seed = case
    robot = find_robot(name)
    recording, later = recorded(robot, seed)
    began = perf_counter()
    found = identify(recording, robot, _STAGES)
    taken = perf_counter() - began
    later = placed(later, found.header)
    seen, prediction = replay(later, found.robot), found.prediction
    controls = later.controls(found.robot)
    radius = prediction.radius(controls, later.begins)
    known = np.isfinite(seen.distance)
    errors = found.fit.simulated.error, found.validation.error, seen.error
    return KeptRow(
        name,
        seed,
        *(size(error) for error in errors),
        float(radius.mean()),
        float(np.mean((seen.distance <= radius)[known])),
        float(np.mean(prediction.away(controls) > prediction.tested)),
        taken,
    )


def cases(quick: bool = False, count: int | None = None) -> list[tuple[str, int]]:
    """Robots and seeds of twins, the robots in turn, so that fewer are of all of them."""
    count = (1 if quick else sum(ROBOTS.values())) if count is None else count
    ranked = [((k + 0.5) / twins, name, k) for name, twins in ROBOTS.items() for k in range(twins)]
    return [(name, FIRST + k) for _, name, k in sorted(ranked)[:count]]


def _held(rows: list[KeptRow]) -> float:
    return float(np.mean([row.held for row in rows]))


def _verdict(rows: list[KeptRow]) -> lab.Text:
    share = _held(rows)
    text = f"95 % intervals hold {lab.number(share, '.1f', '%')} % of the rows kept back; asked: "
    ends = " to ".join(lab.number(end, ".0f", "%") for end in HELD)
    return lab.Text(f"{text}{ends} %: ") + lab.verdict(HELD[0] <= share <= HELD[1])


STUDY = lab.Study(
    kinds=(KeptRow,),
    cases=cases,
    measure=measure,
    options=("count",),
    tables=[
        lab.table(
            "Recordings kept back, of twins with friction that drift",
            *("robot", "twin", "fitted", "left_out", "kept", "width", "held", "beyond", "time"),
        ),
        _verdict,
    ],
    note="left out: blocks of the recording when they were left out of the fit; interval: mean "
    "half width; untested: rows farther from the commands identified than any left out",
)
