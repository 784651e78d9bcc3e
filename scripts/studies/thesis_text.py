"""Numbers in the thesis' text that no other study measures, for `docs/results/thesis_status.md`."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from statistics import median

import numpy as np
from numpy import ndarray

from softrobot_env.evaluation import runner
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.identification.networks import DIRECTIONS, HIDDEN, TRAINING, direction_of
from softrobot_env.identification.networks import distances as errors_of
from softrobot_env.identification.visits import POINTS, collect, disk_points, split
from softrobot_env.robots import RIG
from softrobot_env.robots.twin import FRICTION
from softrobot_env.tasks import make_task
from softrobot_env.thesis.rig.inverse import TOTAL
from softrobot_env.thesis.rig.servo_constraints import ServoConstraints
from studies import lab, rig_networks
from studies.policies import PCC
from studies.truths.rig_piece import plan
from studies.truths.slow_rig import RigStatics
from studies.truths.thesis_values import CONTROLLERS


@dataclass(frozen=True)
class Row(lab.Record):
    """A number of the text.

    Attributes:
        place: Section of the thesis.
        quantity: What it is.
        value: In SI units.
        thesis: The printed number.
        unit: Shown.
    """

    place: str
    quantity: str
    value: float
    thesis: float | None = None
    unit: str = ""


# -------------------- networks of the rig, secs. 3.2.4 and 5.1.2

#: Direction -> section, printed standard deviation and largest error [m].
_PRINTED = {"forward": ("3.2.4", 0.86e-3, 9.3e-3), "inverse": ("5.1.2", 0.13e-3, 1.4e-3)}


def network_rows(trainings: int) -> list[Row]:
    """How errors of the networks scatter, medians, on the stand-in with a twin's friction."""
    rig, rng = RigStatics(friction=FRICTION, seed=0), np.random.default_rng(0)
    data = collect(RIG, rig, rng, disk_points(POINTS), TOTAL)
    parts, rows = split(POINTS, np.random.default_rng(0)), []
    for direction in DIRECTIONS:
        place, deviation, largest = _PRINTED[direction]
        cell = rig_networks.Cell("samples", direction, len(HIDDEN), HIDDEN[0], TRAINING, trainings)
        test = direction_of(data, direction).take(parts.test)
        found = [rig_networks.train(cell, data, parts, seed).network for seed in range(trainings)]
        errors = [errors_of(network, test) for network in found]
        spread = median(float(error.std()) for error in errors)
        most = median(float(error.max()) for error in errors)
        rows.append(Row(place, f"{direction}: standard deviation", spread, deviation, "mm"))
        rows.append(Row(place, f"{direction}: largest error", most, largest, "mm"))
    return rows


# -------------------- forces on the triangle, sec. 5.4.2


def share_rows() -> list[Row]:
    """Share of inertia and damping in the mean force of the inverse dynamics on slow laps."""
    path, servo = make_task("triangle", period=5.0).trajectory, ServoConstraints(RIG)
    time = np.arange(path.approach, path.end_time, 0.02)
    moving = plan(servo, path.position(time), path.velocity(time), path.acceleration(time))
    still = np.zeros((len(time), 3))
    resting = plan(servo, path.position(time), still, still)

    def mean(force: ndarray) -> float:
        return float(np.linalg.norm(force, axis=1).mean())

    effective = mean(moving.reduced - moving.static) / mean(moving.reduced)
    each = np.abs(moving.tension - resting.tension).mean() / moving.tension.mean()
    return [
        Row("5.4.2", "dynamic share of the effective force", effective, 0.016, "%"),
        Row("5.4.2", "dynamic share of the tensions", float(each), 0.016, "%"),
    ]


# -------------------- the arm, sec. 6.6.2

#: [s] of "a longer simulation time", the last of which counts, and between compared instants.
_LONG, _LAST, _APART = 60.0, 1.0, 0.01


def _swing(policy: str, task: str = "swing", duration: float | None = None) -> Rollout:
    return runner.run(runner.Case(make_task(task), policy, plant=PCC, duration=duration)).rollout


def rest_rows() -> list[Row]:
    """Errors that `qs_nn` keeps at rest."""
    rows = []
    for task, thesis in (("swing", 1.7e-3), ("lshape", 5.47e-3)):
        rollout = _swing("qs_nn", task, _LONG)
        error = float(rollout.error[rollout.time > rollout.time[-1] - _LAST].mean())
        rows.append(Row("6.6.2", f"qs_nn: error that is left, {task}", error, thesis, "mm"))
    return rows


def force_rows() -> list[Row]:
    """Largest difference between the controllers' forces of a tendon pair on the swing."""
    forces = [_forces(_swing(policy)) for policy in CONTROLLERS]
    most = max(float(np.abs(one - other).max()) for one, other in combinations(forces, 2))
    return [Row("6.6.2", "largest difference of forces, swing", most, 29.0, "N")]


def _forces(rollout: Rollout) -> ndarray:
    """Forces (n, 3) [N] of the pairs, positive upwards, held from decision to decision."""
    instants = np.arange(_APART, rollout.time[-1], _APART)
    held = rollout.tendon_tension[np.searchsorted(rollout.time, instants)]
    return held[:, 0::2] - held[:, 1::2]


# -------------------- the study


def jobs(quick: bool) -> Iterable[lab.Job]:
    """All numbers, in the order of the thesis."""
    trainings = rig_networks.QUICK_TRAININGS if quick else rig_networks.TRAININGS
    named: dict[str, Callable[[], list[Row]]] = {
        "networks": partial(network_rows, trainings),
        "dynamic share": share_rows,
        "errors at rest": rest_rows,
        "forces": force_rows,
    }
    return named.items()


STUDY = lab.Study(
    kinds=(Row,),
    jobs=jobs,
    tables=[
        lab.table(
            "Numbers in the thesis' text",
            *("place", "quantity"),
            lab.Column("thesis", lambda row: lab.number(row.thesis, ".3g", row.unit), ">"),
            lab.Column("ours", lambda row: lab.number(row.value, ".3g", row.unit), ">"),
            "unit",
        )
    ],
    note="Networks: medians of trainings with 150 samples of the stand-in of rig_networks with the "
    "friction of a twin. A standard deviation of errors cannot exceed their RMS, which the thesis "
    "prints as 0.77 and 0.11 mm: its two numbers do not fit together. The arm is the PCC model.",
)
