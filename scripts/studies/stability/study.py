"""Which timesteps and integrators hold: maps of robots of all kinds, and extreme cases.

A run is good only if its tip stays within a stated bound of a refined run of the same model, or of
an independent truth; see `evaluation.models.runs.Verdict`. The maps are those of any robot's own
(`softrobot benchmark stability --robot my.toml`).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

from softrobot_env.evaluation.models import stability
from softrobot_env.evaluation.models.runs import WRONG_SHARE, Verdict
from softrobot_env.rendering.figures import Figure
from softrobot_env.rendering.models import stability_map
from softrobot_env.robots import ARM, RIG, find_robot
from studies.lab import Column, Job, Record, Study, groups, lines, of_kind, pivot, select, table
from studies.stability import extremes, integrators
from studies.stability.extremes import ExtremeRow
from studies.stability.integrators import FrontRow, gain

#: Robots of the maps, the thesis' first; a quick run has the first.
ROBOTS = (ARM.name, RIG.name, "planar_finger", "silicone_rod", "hanging_trunk")


@dataclass(frozen=True, kw_only=True)
class MapRow(stability.StabilityRow, Record):
    """A run of a robot that is stiffened, damped, cut into pieces or driven harder."""

    robot: str

    @property
    def step(self) -> str:
        """The timestep for people [ms]."""
        return "by rule" if self.case == "rule" else f"{1e3 * self.timestep:.3g}"


def map_rows(name: str, quick: bool) -> list[MapRow]:
    """The map of a robot."""
    found = stability.measure(find_robot(name), quick)
    return [MapRow(robot=name, **vars(row)) for row in found]


def jobs(quick: bool) -> Iterator[Job]:
    """Maps, extreme cases, and integrators."""
    for name in ROBOTS[: 1 if quick else None]:
        yield f"map of {name}", partial(map_rows, name, quick)
    yield from extremes.jobs(quick)
    yield from integrators.jobs(quick)


# ---------------------------------------------------------------- tables and pictures


def _lost(rows: list[MapRow]) -> str:
    """Share of the runs that failed or came out wrong, and of those that kept silent about it."""
    lost = [r for r in rows if r.verdict == Verdict.REPORTED or (r.share or 0) > WRONG_SHARE]
    silent = len(select(lost, verdict=Verdict.WRONG))
    return f"{len(lost)} / {silent}" if silent else f"{len(lost) or '-'}"


def maps(rows: list[Record]) -> dict[str, Figure]:
    """Maps of the thesis' robots."""
    found = groups(of_kind(rows, MapRow), "robot")
    stems = {ARM.name: "{}", RIG.name: "{}_rig"}
    return {stems[name]: stability_map(found[(name,)], name) for name in stems if (name,) in found}


STUDY = Study(
    kinds=(MapRow, ExtremeRow, FrontRow),
    jobs=jobs,
    tables=(
        pivot(
            "Varied robots as the package runs them by itself: verdicts",
            *(("robot",), "verdict", len),
            of=MapRow,
            where={"case": "own"},
        ),
        pivot(
            "{robot} by timestep in ms: runs that diverged or are off by more than 5 % / of these "
            "without a word",
            ("integrator",),
            "step",
            _lost,
            of=MapRow,
            where=lambda row: row.case != "own",
            per=("robot",),
        ),
        pivot("Extreme cases: error of the tip in mm", ("case",), "run", "error", of=ExtremeRow),
        table(
            "Extreme cases that fail",
            *("case", "run", "bound", Column("why", lambda row: row.why or row.verdict)),
            of=ExtremeRow,
            where=lambda row: row.verdict != Verdict.ACCURATE,
            caption="ANCF's own warnings are off: what it errs by is what is measured",
        ),
        table(
            "Integrators: error against cost",
            *(
                Column("", "case"),
                Column("integrator", form=">"),
                "setting",
                "error",
                "evaluations",
                "cost",
            ),
            of=FrontRow,
        ),
    ),
    plots={
        "{}": maps,
        "{}_integrators": lines(
            *("evaluations", "error", "integrator"),
            title=gain,
            subject="Errors of links against forces computed, at several settings",
            panel="case",
            of=FrontRow,
            log="xy",
            columns=4,
            size=(2.6, 2.6),
            legend=True,
        ),
    },
    note="What the package does on random robots: softrobot benchmark scenes",
    alone=True,
)
