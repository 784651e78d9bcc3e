"""Cells of the studies of the rig's quasi-static networks: what is trained, and its row."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from statistics import median
from time import perf_counter

import numpy as np

from softrobot_env.benchmarks.records import Record
from softrobot_env.identification import networks as rig_networks
from softrobot_env.identification.networks import DIRECTIONS, HIDDEN, TRAINING, VALIDATION
from softrobot_env.identification.visits import RigData, Split
from softrobot_env.learned import early_stopping
from softrobot_env.learned.early_stopping import Fit

#: Hidden layers and neurons of each of them, Figs. 3.7 and 5.3.
LAYERS = (1, 2, 3, 4, 5)
NEURONS = (1, 2, 3, 4, 6, 8, 10, 16, 25, 50)

#: Samples in the training set, Figs. 3.8 and 5.4.
SAMPLES = (5, 10, 15, 20, 30, 40, 55, 80, 110, TRAINING, 200, 300, 450, 646)

#: Trainings per cell, of which the median counts, and those of a quick run.
TRAININGS, QUICK_TRAININGS = 10, 3

_QUICK_LAYERS, _QUICK_NEURONS, _QUICK_SAMPLES = (1, 2), (2, 10), (20, TRAINING)


@dataclass(frozen=True)
class Case:
    """Trainings that differ in nothing but their seeds.

    Attributes:
        study: "size", "samples" or "friction".
        direction: One of `rig_networks.DIRECTIONS`.
        layers, neurons: Hidden layers, and neurons of each.
        samples: In the training set, with validation samples in proportion; None for all.
        trainings: Their number.
    """

    study: str
    direction: str
    layers: int
    neurons: int
    samples: int | None
    trainings: int

    @property
    def label(self) -> str:
        """For a progress bar."""
        what = f"{self.layers} x {self.neurons}"
        return f"{self.direction} {what}" + (f", {self.samples} samples" if self.samples else "")


@dataclass(frozen=True)
class CellRow(Case, Record):
    """What the trainings of a case have found.

    Attributes:
        samples: In the training set, also where it is all of them.
        e_rms, e_rms_least, e_rms_largest, e_max: [m], on the test set; medians but the two.
        e_rms_validation: [m], on the validation set, median.
        iterations, training_time: Of a training, medians; [1] and [s].
    """

    e_rms: float
    e_rms_least: float
    e_rms_largest: float
    e_max: float
    e_rms_validation: float
    iterations: float
    training_time: float


def cases(quick: bool = False) -> Iterator[Case]:
    """All cells; fewer with `quick`."""
    trainings = QUICK_TRAININGS if quick else TRAININGS
    for direction in DIRECTIONS:
        for layers in _QUICK_LAYERS if quick else LAYERS:
            for neurons in _QUICK_NEURONS if quick else NEURONS:
                yield Case("size", direction, layers, neurons, None, trainings)
        for samples in _QUICK_SAMPLES if quick else SAMPLES:
            yield Case("samples", direction, len(HIDDEN), HIDDEN[0], samples, trainings)


def run_case(case: Case, data: RigData, parts: Split) -> CellRow:
    """Train the networks of a cell."""
    every = rig_networks.direction_of(data, case.direction)
    validation, test = every.take(parts.validation), every.take(parts.test)
    fits, times = [], []
    for seed in range(case.trainings):
        began = perf_counter()
        fits.append(train(case, data, parts, seed))
        times.append(perf_counter() - began)
    errors = [rig_networks.rms(fit.network, test) for fit in fits]
    counted = replace(case, samples=case.samples or len(parts.training))
    return CellRow(
        **vars(counted),
        e_rms=median(errors),
        e_rms_least=min(errors),
        e_rms_largest=max(errors),
        e_max=median(float(rig_networks.distances(f.network, test).max()) for f in fits),
        e_rms_validation=median(rig_networks.rms(f.network, validation) for f in fits),
        iterations=median(fit.iterations for fit in fits),
        training_time=median(times),
    )


def train(case: Case, data: RigData, parts: Split, seed: int) -> Fit:
    """One network; the seed draws its samples, where not all are used, and initial parameters."""
    every = rig_networks.direction_of(data, case.direction)
    rng = np.random.default_rng(seed)
    training, validation = parts.training, parts.validation
    if case.samples is not None:
        watched = max(1, round(case.samples * VALIDATION / TRAINING))
        training = _draw(training, case.samples, rng)
        validation = _draw(validation, min(watched, len(validation)), rng)
    samples = every.take(training)
    network = samples.new_network((case.neurons,) * case.layers, rng)
    return early_stopping.train(network, samples, every.take(validation))


def _draw(indices: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    if count > len(indices):
        raise ValueError(f"{count} samples are wanted of a set of {len(indices)}")
    return rng.permutation(indices)[:count]
