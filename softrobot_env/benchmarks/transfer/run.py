"""Every policy on plants, robots and twins that it was not tuned on."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.benchmarks.laps import (
    HOLD,
    LapsRow,
    RefusedRow,
    laps_case,
    refusal,
    run_laps,
)
from softrobot_env.benchmarks.laws.rows import Prepared, prepare
from softrobot_env.benchmarks.records import of_kind, one
from softrobot_env.benchmarks.transfer.trainings import (
    NETWORKS,
    OTHER,
    Trained,
    train_network,
    tune_tables,
)
from softrobot_env.benchmarks.transfer.worlds import PLANT, World, worlds
from softrobot_env.core.jobs import Job, Progress, run_in_processes
from softrobot_env.evaluation.runner import Case
from softrobot_env.robots import ARM, RIG, find_robot
from softrobot_env.tasks import Task

#: The path, and its laps per second over the first frequency.
TASK, FREQUENCY = "figure_eight", 0.3

#: The thesis' robots, and of the others one in the plane, one driven by length, and one of two
#: sections.
ROBOTS = (ARM.name, RIG.name, "planar_finger", "silicone_rod", "hanging_trunk")

#: The plant on which wild motions take minutes, and the error on the chain, over the length, that
#: keeps a policy from it.
_SLOW, _LOST = "ancf", 0.1
_LEFT_OUT = (
    f"it misses the path by over {100 * _LOST:g} % of the length on the chain, and wild motions "
    "take minutes on this plant"
)

#: An episode, and the fields of its row that it does not tell.
_Told = tuple[Case, dict[str, object]]

_QUICK_ROBOTS, _QUICK_WORLDS = ("planar_finger",), ("mujoco", "pcc", "E x 0.75")


@dataclass(frozen=True, kw_only=True)
class TransferRow(LapsRow):
    """An episode in some world.

    Attributes:
        tuned_on: The plant of the policy's tuning or training.
        trained_here: Whether that was done for this study, with less data than what is shipped.
        world, group: See `World`.
        ratio: Mean error over that on the plant it was tuned on [1]; None where there is none.
    """

    tuned_on: str
    trained_here: bool
    world: str
    group: str
    ratio: float | None = None

    @property
    def label(self) -> str:
        """The policy for people, with what it was trained on for this study."""
        return f"{self.policy} of {self.tuned_on}" if self.trained_here else self.policy


Row = TransferRow | RefusedRow


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Run all policies in all worlds.

    Args:
        quick: One robot in few worlds, no training.
        progress: Called with (description, done, total), or None.

    Returns:
        What is refused, and the episodes.
    """
    robots = _QUICK_ROBOTS if quick else ROBOTS
    with TemporaryDirectory() as folder:
        jobs = [
            (
                f"training and path of {name}",
                partial(prepare, name, (TASK,), (FREQUENCY,), Path(folder)),
            )
            for name in robots
        ]
        known = dict(zip(robots, run_in_processes(jobs, progress), strict=True))
        trained, others = ([], []) if quick else _trained(Path(folder), progress)
        cases = [
            case
            for name, prepared in known.items()
            for world in worlds(find_robot(name))
            if not quick or world.name in _QUICK_WORLDS
            for case in _cases(prepared, world, [made for made in trained if made.robot == name])
        ]
        slow = [(case, own) for case, own in cases if case.plant == _SLOW]
        rest = [(case, own) for case, own in cases if case.plant != _SLOW]
        rows = run_in_processes([_job(*each) for each in rest], progress)
        slow, left_out = _able(slow, of_kind(rows, TransferRow))
        rows += [*left_out, *run_in_processes([_job(*each) for each in slow], progress)]
    order = {world.name: k for name in robots for k, world in enumerate(worlds(find_robot(name)))}
    found = sorted(
        of_kind(rows, TransferRow), key=lambda r: (robots.index(r.robot), order[r.world])
    )
    refused = [row for p in known.values() for row in of_kind(p.rows, RefusedRow)]
    refused += [*others, *of_kind(rows, RefusedRow)]
    told = [replace(row, reason=row.reason.replace(f"{folder}/", "")) for row in refused]
    return [*told, *(_with_ratio(row, found) for row in found)]


def _trained(folder: Path, progress: Progress | None) -> tuple[list[Trained], list[RefusedRow]]:
    """What is trained for this study, and what cannot be."""
    jobs: list[Job] = [
        (f"tables of {name} on {OTHER}", partial(tune_tables, name, folder))
        for name in reversed(ROBOTS)  # the slowest first
    ]
    count = len(jobs)
    jobs += [
        (f"training {policy} on {plant}", partial(train_network, policy, plant, folder))
        for policy, (_, plants) in NETWORKS.items()
        for plant in plants
    ]
    found = run_in_processes(jobs, progress)
    made = [*(one for some in found[:count] for one in some), *found[count:]]
    return of_kind(made, Trained), of_kind(made, RefusedRow)


def _cases(prepared: Prepared, world: World, trained: list[Trained]) -> list[_Told]:
    """Episodes of all policies in a world."""
    told, out = {"world": world.name, "group": world.group}, []
    for task in prepared.tasks:
        for policy in prepared.policies:
            if policy != HOLD:
                own = told | {"tuned_on": MUJOCO, "trained_here": False}
                out.append((_case(task, policy, **world.case), own))
        for made in trained:
            own = told | {"tuned_on": made.plant, "trained_here": True}
            case = _case(task, made.policy, given={made.option: made.file}, **world.case)
            out.append((case, own))
    return out


def _able(slow: list[_Told], rows: list[TransferRow]) -> tuple[list[_Told], list[RefusedRow]]:
    """The episodes on the slow plant of policies that follow the path on the chain, and others."""
    able, left_out = [], []
    for case, own in slow:
        same = {name: own[name] for name in ("tuned_on", "trained_here")}
        name = case.task.robot.name
        home = one(rows, robot=name, policy=case.policy, world=MUJOCO, **same)
        if home is not None and home.share_mean is not None and home.share_mean < _LOST:
            able.append((case, own))
        else:
            label = f"{case.policy} of {own['tuned_on']}" if own["trained_here"] else case.policy
            left_out.append(refusal(name, label, _SLOW, _LEFT_OUT))
    return able, left_out


def _case(task: Task, policy: str, **more: Any) -> Case:
    """An episode that ends a lap earlier than those of the study of laws: some plants are slow."""
    run = task.trajectory
    lap = 2 * np.pi / run.rate
    return laps_case(task, policy, duration=run.end_time - run.ramp - lap, **more)


def _job(case: Case, own: dict[str, object]) -> Job:
    return f"{own['world']}, {case.label}", partial(run_laps, case, TransferRow, **own)


def _with_ratio(row: TransferRow, rows: list[TransferRow]) -> TransferRow:
    """A row with its error over that of the same policy on its own plant."""
    same = {"robot": row.robot, "label": row.label, "task": row.task}
    own = one(rows, **same, group=PLANT, world=row.tuned_on)
    if own is None or not own.lap_mean or row.lap_mean is None:
        return row
    return replace(row, ratio=row.lap_mean / own.lap_mean)
