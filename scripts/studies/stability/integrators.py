"""Error against cost of the integrators: the arm, its variations, the rig and a hanging trunk.

Random steps of all drives, as `scene.integration.probe` makes them, and the truth with a far
smaller accuracy.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from softrobot_env.robots import ARM, RIG, RobotParams, Tendon
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from studies.lab import Job, Record, groups, quantity, select

#: A soft trunk that hangs.
_SIDES = tuple(Tendon(f"side{k}", (x, 0.0), 0.6, 0, 1.0) for k, x in enumerate((8e-3, -8e-3)))
_HANGING = {"gravity": (0.0, 0.0, 9.81), "tendons": _SIDES}
TRUNK = RobotParams("trunk", 0.6, 8e-3, 0.0, 3e5, 1070.0, 0.02, 6, **_HANGING)

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
    setting: float = quantity("", ".3g", "accuracy 1 or\ntimestep s")
    error: float = quantity("mm", ".3g")
    evaluations: float = quantity("", ".1f")
    cost: float = quantity("µs", ".0f", "a period")


def jobs(quick: bool = False) -> Iterator[Job]:
    """One job a case; a quick run has the first one only."""
    for case in list(CASES)[: 1 if quick else None]:
        yield f"integrators, {case}", partial(_case, case)


def _case(case: str) -> list[FrontRow]:
    # Compiled code takes time to load.
    from softrobot_env.scene.integration.probe import controls_of, motion

    robot, options = CASES[case]
    config = SceneConfig(robot, **options)
    controls = controls_of(build_scene(config), 0)
    truth, *_ = motion(build_scene(replace(config, accuracy=_TRUTH)), controls)
    settings = [(a, {"accuracy": f"{100 * a:g}%"}) for a in ACCURACIES]
    for name in ("implicitfast", "discrete"):
        settings += [(h, {"timestep": h, "integrator": name}) for h in TIMESTEPS]
    rows = []
    for setting, given in settings:
        scene = build_scene(replace(config, **given))
        found, evaluations, cost = motion(scene, controls)
        error = float(np.linalg.norm(found - truth, axis=-1).max())
        rows.append(FrontRow(case, scene.timestep.integrator, setting, error, evaluations, cost))
    return rows


def gain(rows: list[FrontRow]) -> str:
    """How much less the first integrator errs for at most as many evaluations, as a message."""
    (ours,), *_ = groups(rows, "integrator")
    ratios = []
    for mine in groups(rows, "case").values():
        runs = select(mine, integrator=ours)
        most = max(row.evaluations for row in runs)
        rivals = [r.error for r in mine if r.integrator != ours and r.evaluations <= most]
        if rivals:
            ratios.append(min(rivals) / min(row.error for row in runs))
    return (
        f"For as many forces, {ours} errs at least {float(f'{min(ratios):.2g}'):g} times less than "
        "the others at best"
    )
