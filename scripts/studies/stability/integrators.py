"""Error against cost of the integrators: the arm, its variations, the rig and a hanging trunk.

Random steps of all drives, as `scene.integration.probe` makes them, and the truth with a far
smaller accuracy.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from softrobot_env.rendering.figures import COLOURS, add_legend, add_title, new_figure
from softrobot_env.rendering.tables import Column, make_table
from softrobot_env.robots import ARM, RIG, RobotParams, Tendon
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import SceneConfig
from studies.lab import Record, select
from studies.stability.runs import Job

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A soft trunk that hangs.
TRUNK = RobotParams(
    "trunk",
    length=0.6,
    outer_radius=8e-3,
    inner_radius=0.0,
    youngs_modulus=3e5,
    density=1070.0,
    damping_time=0.02,
    pieces=6,
    gravity=(0.0, 0.0, 9.81),
    tendons=tuple(Tendon(f"side{k}", (x, 0.0), 0.6, 0, 1.0) for k, x in enumerate((8e-3, -8e-3))),
)

#: Scenes: name -> robot and options.
CASES: dict[str, tuple[RobotParams, dict[str, Any]]] = {
    "arm": (ARM, {}),
    "arm, damping x 0.1, E x 0.5": (ARM.vary(damping_time=0.1, youngs_modulus=0.5), {}),
    "rig": (RIG, {"actuation": "length", "bending": "spatial", "control_period": 0.02}),
    "trunk": (TRUNK, {}),
}

ACCURACIES = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5)  # of the length
TIMESTEPS = (2e-3, 1e-3, 5e-4, 2.5e-4, 1e-4)  # s
_TRUTH = "0.0003%"


@dataclass(frozen=True)
class FrontRow(Record):
    """One run.

    Attributes:
        case: Key of `CASES`.
        integrator: Its name.
        setting: Accuracy as a share of the length [1], or timestep [s].
        error: [m], largest distance of a link from the truth.
        evaluations: Of all forces in a control period.
        cost: [s], processor time of a control period.
    """

    case: str
    integrator: str
    setting: float
    error: float
    evaluations: float
    cost: float


def jobs(quick: bool = False) -> Iterator[Job]:
    """One job a case; a quick run has the first one only."""
    for case in list(CASES)[: 1 if quick else None]:
        yield (
            f"integrators, {case}",
            lambda c=case: _case(c),
        )


def _case(case: str) -> list[FrontRow]:
    # Compiled code takes time to load.
    from softrobot_env.scene.integration.probe import controls_of, motion

    robot, options = CASES[case]
    config = SceneConfig(robot, **options)
    controls = controls_of(build_scene(config), 0)
    truth, *_ = motion(build_scene(replace(config, accuracy=_TRUTH)), controls)

    def row(scene: Scene, setting: float) -> FrontRow:
        found, evaluations, cost = motion(scene, controls)
        error = float(np.linalg.norm(found - truth, axis=-1).max())
        return FrontRow(case, scene.timestep.integrator, setting, error, evaluations, cost)

    ours = [row(build_scene(replace(config, accuracy=f"{100 * a:g}%")), a) for a in ACCURACIES]
    return ours + [
        row(build_scene(replace(config, timestep=h, integrator=name)), h)
        for name in ("implicitfast", "discrete")
        for h in TIMESTEPS
    ]


def _gain(rows: list[FrontRow]) -> str:
    """How much less the first integrator errs for at most as many evaluations, as a message."""
    ours, *others = dict.fromkeys(row.integrator for row in rows)
    ratios = []
    for case in dict.fromkeys(row.case for row in rows):
        mine = select(rows, case=case)
        most = min(max(r.evaluations for r in select(mine, integrator=i)) for i in (ours, *others))
        cheap = [row for row in mine if row.evaluations <= most]
        best = {
            i: min((r.error for r in select(cheap, integrator=i)), default=None)
            for i in (ours, *others)
        }
        rest = [best[i] for i in others if best[i] is not None]
        if best[ours] and rest:
            ratios.append(min(rest) / best[ours])
    if not ratios:
        return "Integrators: error against cost"
    least = float(f"{min(ratios):.2g}")
    return f"At best, for no more forces, {ours} errs at least {least:g} times less than the others"


def figure(rows: list[FrontRow]) -> "Figure":
    """Error against evaluations of the forces, one panel a case."""
    cases = list(dict.fromkeys(row.case for row in rows))
    drawn, panels = new_figure(1, len(cases), (2.6 * len(cases), 3.6))
    for axes, case in zip(panels[0], cases, strict=True):
        names = dict.fromkeys(row.integrator for row in rows)
        for name, colour in zip(names, COLOURS, strict=False):
            mine = select(rows, case=case, integrator=name)
            points = [(row.evaluations, 1e3 * row.error) for row in mine]
            axes.loglog(*zip(*points, strict=True), "o-", color=colour, label=name, markersize=3)
        axes.set(title=case, xlabel="force evaluations")
    panels[0, 0].set_ylabel("error [mm]")
    add_title(drawn, _gain(rows), "Errors of links against forces computed, at several settings")
    add_legend(drawn, panels[0, 0])
    return drawn


def table(rows: list[FrontRow]) -> Table:
    """One line a run."""
    columns = (
        Column("", "case"),
        Column("integrator", "integrator"),
        Column("accuracy 1 or\ntimestep s", "setting", ".3g"),
        Column("error mm", "error", ".3g", "mm"),
        Column("evaluations", "evaluations", ".1f"),
        Column("µs per period", "cost", ".0f", "µs"),
    )
    return make_table("Integrators: error against cost", columns, rows)
