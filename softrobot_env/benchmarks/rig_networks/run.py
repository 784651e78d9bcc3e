"""Quasi-static networks of the spatial rig: size, samples and cost (thesis Figs. 3.7 to 5.4).

And, on a stand-in, what friction of the tendons costs them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from softrobot_env.benchmarks.records import Record
from softrobot_env.benchmarks.rig_networks.cases import (
    QUICK_TRAININGS,
    TRAININGS,
    Case,
    CellRow,
    cases,
    run_case,
    train,
)
from softrobot_env.benchmarks.rig_networks.friction import friction_rows
from softrobot_env.benchmarks.timing import best_of
from softrobot_env.core.jobs import Progress, quiet, run_in_processes
from softrobot_env.identification.excitation import Excitation
from softrobot_env.identification.networks import DIRECTIONS, HIDDEN, TRAINING, direction_of
from softrobot_env.identification.parameters import record
from softrobot_env.identification.visits import (
    POINTS,
    RigData,
    Split,
    disk_points,
    visits_of,
)
from softrobot_env.identification.visits import split as split_data
from softrobot_env.learned.inference import CompiledInference
from softrobot_env.learned.plain_inference import PlainInference
from softrobot_env.robots import RIG

#: Points measured in a quick run: those of 150 samples to train with.
_QUICK_POINTS = 215

#: Seed of the twin of `run_on_twin`.
_TWIN = 0

#: Of the order of the visit and the split of the data.
_SEED = 0

#: Of the test set in one measurement, and measurements, of which the least counts: short ones, as
#: other programs disturb long ones.
_PASSES, _REPEATS, _QUICK_REPEATS = 20, 200, 20


@dataclass(frozen=True)
class InferenceRow(Record):
    """Computing time of a network.

    Attributes:
        direction: One of `DIRECTIONS`.
        variant: "compiled", "plain" or "batch", which is compiled, all samples in one call.
        time: [s] per sample.
        study: "inference".
    """

    direction: str
    variant: str
    time: float
    study: str = "inference"


Row = CellRow | InferenceRow


def run_on_twin(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """`run` with the data of a twin, as its controllers get them, then `friction_rows`.

    Args:
        quick: Fewer points, sizes and trainings.
        progress: Called with (description, done, total), or None.
    """
    show, count = progress or quiet, len(_points(quick))
    show("visiting the points", 0, 1)
    visits = Excitation(kinds=("visits",), points=count, seed=_SEED)
    rows = run(visits_of(record(_TWIN, excitation=visits), RIG), quick, progress)
    trainings = QUICK_TRAININGS if quick else TRAININGS
    return rows + friction_rows(_points(quick), trainings, show)


def run(
    data: RigData,
    quick: bool = False,
    progress: Progress | None = None,
    processes: int | None = None,
) -> list[Row]:
    """Train all networks and time them.

    Args:
        data: Of a rig, measured with a constant sum of tensions.
        quick: Fewer points, sizes and trainings.
        progress: Called with (description, done, total), or None.
        processes: Trainings at a time; one per core unless given.

    Returns:
        Rows of the trainings, then those of the times.
    """
    parts = split_data(len(data.lengths), np.random.default_rng(_SEED))
    rows = run_cases(list(cases(quick)), data, parts, progress or quiet, processes)
    return rows + inference_rows(data, parts, _QUICK_REPEATS if quick else _REPEATS)


def _points(quick: bool) -> np.ndarray:
    return disk_points(_QUICK_POINTS if quick else POINTS)


def run_cases(
    wanted: Sequence[Case],
    data: RigData,
    parts: Split,
    progress: Progress,
    processes: int | None = None,
) -> list[CellRow]:
    """Rows of cells in their order, trained in `processes` processes."""
    longest_first = sorted(wanted, key=lambda case: -case.layers * case.neurons)
    tasks = [(case.label, partial(run_case, case, data, parts)) for case in longest_first]
    found = dict(zip(longest_first, run_in_processes(tasks, progress, processes), strict=True))
    return [found[case] for case in wanted]


def inference_rows(data: RigData, parts: Split, repeats: int) -> list[InferenceRow]:
    """Time per sample of the networks on the test set, the best of `repeats`."""
    rows = []
    for direction in DIRECTIONS:
        case = Case("samples", direction, len(HIDDEN), HIDDEN[0], TRAINING, 1)
        network = train(case, data, parts, seed=0).network
        inputs = direction_of(data, direction).inputs[parts.test]
        compiled, plain = CompiledInference(network), PlainInference(network)
        for variant, action in (
            ("compiled", lambda f=compiled, samples=list(inputs): _each(f, samples)),
            ("plain", lambda f=plain, samples=list(inputs): _each(f, samples)),
            ("batch", lambda f=compiled.batch, samples=inputs: f(samples)),
        ):
            time, _ = best_of(lambda act=action: [act() for _ in range(_PASSES)], repeats)
            rows.append(InferenceRow(direction, variant, time / (_PASSES * len(inputs))))
    return rows


def _each(network: CompiledInference | PlainInference, samples: list[np.ndarray]) -> None:
    for sample in samples:
        network(sample)
