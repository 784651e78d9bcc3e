"""Quasi-static networks of the spatial rig: size, samples and cost (thesis Figs. 3.7 to 5.4)."""

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context

import numpy as np

from softrobot_env.benchmarks.jobs import Progress, Row
from softrobot_env.benchmarks.rig_networks_cases import Case, cases, run_case, train
from softrobot_env.benchmarks.timing import best_of
from softrobot_env.control.rig_inverse import TOTAL
from softrobot_env.learned.inference import CompiledInference, PlainInference
from softrobot_env.robots import RIG
from softrobot_env.training.rig_data import POINTS, Measure, RigData, Split, collect, disk_points
from softrobot_env.training.rig_data import split as split_data
from softrobot_env.training.rig_networks import DIRECTIONS, HIDDEN, TRAINING, direction_of
from softrobot_env.training.rig_statics import RigStatics
from softrobot_env.training.rig_twin_data import measure as measure_twin

#: Points measured in a quick run: those of 150 samples to train with.
_QUICK_POINTS = 215

#: Seed of the twin of `run_on_twin`.
_TWIN = 0

#: Of the order of the visit and the split of the data.
_SEED = 0

_PASSES, _QUICK_PASSES, _REPEATS = 200, 20, 5

#: Libraries that read them take one thread per process: small matrices gain nothing from more.
_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


def run(
    quick: bool = False,
    progress: Progress | None = None,
    measure: Measure | None = None,
    processes: int | None = None,
    total: float | None = None,
) -> list[Row]:
    """Measure the rig, train all networks and time them.

    Args:
        quick: Fewer points, sizes and trainings.
        progress: Called with (description, done, total), or None.
        measure: Gives the data; `RigStatics`, with friction and noise, unless given.
        processes: Trainings at a time; one per core unless given.
        total: Sum of the tensions [N] that removes the redundancy, see
            `rig_data.nominal_lengths`; the least tensions unless given.

    Returns:
        Rows of `rig_networks_cases.run_case`, then rows of study "inference": direction, variant
        ("compiled", "plain", "batch": compiled, all samples in one call) and time [s] per sample.
    """
    show = progress or (lambda text, done, total: None)
    show("visiting the points", 0, 1)
    points = disk_points(_QUICK_POINTS if quick else POINTS)
    data = collect(RIG, measure or RigStatics(), np.random.default_rng(_SEED), points, total)
    parts = split_data(len(points), np.random.default_rng(_SEED))
    rows = run_cases(list(cases(quick)), data, parts, show, processes)
    return rows + inference_rows(data, parts, _QUICK_PASSES if quick else _PASSES)


def run_on_twin(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """`run` with the data of a twin, as its controllers get them: a constant sum of tensions."""
    return run(quick, progress, partial(measure_twin, _TWIN), total=TOTAL)


def run_cases(
    wanted: Sequence[Case],
    data: RigData,
    parts: Split,
    progress: Progress,
    processes: int | None = None,
) -> list[Row]:
    """Rows of cells in their order, trained in `processes` processes."""
    longest_first = sorted(wanted, key=lambda case: -case.layers * case.neurons)
    with _one_thread_each():
        pool = ProcessPoolExecutor(processes or os.cpu_count(), mp_context=get_context("spawn"))
        try:
            running = {pool.submit(run_case, case, data, parts): case for case in longest_first}
            _watch(running, progress)
            found = {case: future.result() for future, case in running.items()}
        finally:
            pool.shutdown(cancel_futures=True)
    return [found[case] for case in wanted]


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes that are started meanwhile use one thread for linear algebra."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _watch(running: dict[Future, Case], progress: Progress) -> None:
    """Tell what is done, and raise the first error."""
    for done, future in enumerate(as_completed(running), start=1):
        future.result()
        progress(running[future].label, done, len(running))


def inference_rows(data: RigData, parts: Split, passes: int) -> list[Row]:
    """Time per sample of the networks on the test set, the best of some repeats of `passes`."""
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
            time, _ = best_of(lambda act=action: [act() for _ in range(passes)], _REPEATS)
            seconds = time / (passes * len(inputs))
            row = {"study": "inference", "direction": direction, "variant": variant}
            rows.append(row | {"time": seconds})
    return rows


def _each(network: CompiledInference | PlainInference, samples: list[np.ndarray]) -> None:
    for sample in samples:
        network(sample)
