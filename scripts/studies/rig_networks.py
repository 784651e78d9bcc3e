"""Quasi-static networks of the spatial rig: size, samples and cost (thesis Figs. 3.7 to 5.4).

And what friction of the tendons costs them, on the stand-in of `studies.truths.slow_rig`: one
piece, no servos, and of a camera nothing but its noise, visited without dither, so that of all
errors of a rig friction alone varies.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.evaluation.models.runs import best_of
from softrobot_env.identification import networks as rig_networks
from softrobot_env.identification.excitation import Excitation
from softrobot_env.identification.networks import DIRECTIONS, HIDDEN, TRAINING, VALIDATION
from softrobot_env.identification.visits import (
    POINTS,
    RigData,
    Split,
    collect,
    disk_points,
    split,
    visits_of,
)
from softrobot_env.learned.inference import CompiledInference
from softrobot_env.learned.plain_inference import PlainInference
from softrobot_env.learned.training import Validated, train_validated
from softrobot_env.rendering import figures
from softrobot_env.rendering.figures import BLUE, COLOURS, Axes, Figure
from softrobot_env.robots import RIG
from softrobot_env.thesis.rig.inverse import TOTAL
from softrobot_env.thesis.rig.parameters import record
from studies import lab
from studies.truths.slow_rig import RigStatics

#: Hidden layers and neurons of each of them, Figs. 3.7 and 5.3; in a quick run those of `_QUICK`.
LAYERS = (1, 2, 3, 4, 5)
NEURONS = (1, 2, 3, 4, 6, 8, 10, 16, 25, 50)

#: Samples in the training set, Figs. 3.8 and 5.4.
SAMPLES = (5, 10, 15, 20, 30, 40, 55, 80, 110, TRAINING, 200, 300, 450, 646)

#: Trainings per cell, of which the median counts, and those of a quick run.
TRAININGS, QUICK_TRAININGS = 10, 3

_QUICK = {"layers": (1, 2), "neurons": (2, 10), "samples": (20, TRAINING)}

#: Points measured in a quick run: those of 150 samples to train with.
_QUICK_POINTS = 215

#: Friction [N] of each tendon, and sums of the tensions [N] that remove the redundancy; None for
#: the least tensions.
FRICTIONS = (0.0, 0.05, 0.1, 0.3)
TOTALS = (TOTAL, None)

#: Of the twin, the order of a visit, the split of the data and the stand-in's camera.
_SEED = 0

#: Of the test set in one measurement, and measurements, of which the least counts: short ones, as
#: other programs disturb long ones.
_PASSES, _REPEATS, _QUICK_REPEATS = 20, 200, 20

#: Direction -> rms error [m], and computing times [s], in the thesis, secs. 3.2.4 and 5.1.2.
THESIS = {"forward": 0.77e-3, "inverse": 0.11e-3}
_THESIS_TIMES = {
    ("forward", "compiled"): 2.0e-6,
    ("inverse", "compiled"): 2.3e-6,
    ("forward", "plain"): 14.9e-6,
    ("inverse", "plain"): 14.9e-6,
}


@dataclass(frozen=True)
class Cell:
    """Trainings that differ in nothing but their seeds.

    Attributes:
        study: "size", "samples" or "friction".
        direction: One of `DIRECTIONS`.
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
class CellRow(Cell, lab.Record):
    """What the trainings of a cell have found; `samples` also where it is all of them.

    Attributes:
        e_rms, e_rms_least, e_rms_largest, e_max: [m], on the test set; medians but the two.
        e_rms_validation: [m], on the validation set, median.
        iterations, training_time: Of a training, medians; [1] and [s].
    """

    e_rms: float = lab.quantity("mm", ".3f", "rms")
    e_rms_least: float
    e_rms_largest: float
    e_max: float = lab.quantity("mm", ".2f", "max")
    e_rms_validation: float
    iterations: float = lab.quantity(form="g", label="steps")
    training_time: float = lab.quantity("s", ".2f", "training")


@dataclass(frozen=True)
class FrictionRow(CellRow):
    """Trainings with the data of one stand-in.

    Attributes:
        friction: [N] of each tendon.
        total: [N], one of `TOTALS`.
    """

    friction: float = lab.quantity("N", "g")
    total: float | None

    @property
    def tensions(self) -> str:
        """Their sum for people."""
        return "least" if self.total is None else f"{self.total:g} N"


@dataclass(frozen=True)
class InferenceRow(lab.Record):
    """Computing time of a network.

    Attributes:
        direction: One of `DIRECTIONS`.
        variant: "compiled", "plain" or "batch", which is compiled, all samples in one call.
        time: Per sample.
        study: "inference".
    """

    direction: str
    variant: str
    time: float = lab.quantity("µs", ".2f")
    study: str = "inference"


def run(bench: lab.Lab) -> list[Any]:
    """Train and time networks with the data of a twin, as its controllers get them, then friction.

    Rows of sizes and samples, of times, and of friction.
    """
    count, trainings = (_QUICK_POINTS, QUICK_TRAININGS) if bench.quick else (POINTS, TRAININGS)
    points = disk_points(count)
    bench.progress("visiting the points", 0, 1)
    visits = Excitation(kinds=("visits",), points=len(points), seed=_SEED)
    data = visits_of(record(_SEED, excitation=visits), RIG)
    parts = split(len(data.lengths), np.random.default_rng(_SEED))
    rows = measure_cells(bench, cells(bench.quick), data, parts)
    rows += inference_rows(data, parts, _QUICK_REPEATS if bench.quick else _REPEATS)
    pairs = list(product(TOTALS, FRICTIONS))
    measure = partial(friction_rows, points, trainings)
    return rows + bench.measure(pairs, measure, lambda pair: f"friction {pair[1]:g} N")


def cells(quick: bool = False) -> list[Cell]:
    """All cells; fewer with `quick`."""
    trainings = QUICK_TRAININGS if quick else TRAININGS
    layers, neurons, samples = _QUICK.values() if quick else (LAYERS, NEURONS, SAMPLES)
    used, found = (len(HIDDEN), HIDDEN[0]), []
    for direction in DIRECTIONS:
        sizes = product(layers, neurons)
        found += [Cell("size", direction, *size, None, trainings) for size in sizes]
        found += [Cell("samples", direction, *used, count, trainings) for count in samples]
    return found


def measure_cells(
    bench: lab.Lab, wanted: Sequence[Cell], data: RigData, parts: Split
) -> list[CellRow]:
    """Rows of cells in their order; those that take longest are begun first."""
    order = sorted(wanted, key=lambda cell: -cell.layers * cell.neurons)
    rows = bench.measure(order, partial(measure_cell, data=data, parts=parts))
    found = dict(zip(order, rows, strict=True))
    return [found[cell] for cell in wanted]


def measure_cell(cell: Cell, data: RigData, parts: Split) -> CellRow:
    """Train the networks of a cell."""
    every = rig_networks.direction_of(data, cell.direction)
    validation, test = every.take(parts.validation), every.take(parts.test)
    fits, times = [], []
    for seed in range(cell.trainings):
        began = perf_counter()
        fits.append(train(cell, data, parts, seed))
        times.append(perf_counter() - began)
    errors = [rig_networks.rms(fit.network, test) for fit in fits]
    counted = replace(cell, samples=cell.samples or len(parts.training))
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


def train(cell: Cell, data: RigData, parts: Split, seed: int) -> Validated:
    """One network; the seed draws its samples, where not all are used, and initial parameters."""
    every = rig_networks.direction_of(data, cell.direction)
    rng = np.random.default_rng(seed)
    training, validation = parts.training, parts.validation
    if cell.samples is not None:
        watched = max(1, round(cell.samples * VALIDATION / TRAINING))
        training = _some(training, cell.samples, rng)
        validation = _some(validation, min(watched, len(validation)), rng)
    samples = every.take(training)
    network = samples.new_network((cell.neurons,) * cell.layers, rng)
    return train_validated(network, samples, every.take(validation))


def _some(indices: ndarray, count: int, rng: np.random.Generator) -> ndarray:
    if count > len(indices):
        raise ValueError(f"{count} samples are wanted of a set of {len(indices)}")
    return rng.permutation(indices)[:count]


def friction_rows(
    points: ndarray, trainings: int, pair: tuple[float | None, float]
) -> list[FrictionRow]:
    """Rows of both directions, of one visit of points (n, 2) [m] with a total and a friction."""
    total, friction = pair
    rig = RigStatics(friction=friction, seed=_SEED)
    data = collect(RIG, rig, np.random.default_rng(_SEED), points, total)
    parts = split(len(points), np.random.default_rng(_SEED))
    rows = []
    for direction in DIRECTIONS:
        cell = Cell("friction", direction, len(HIDDEN), HIDDEN[0], TRAINING, trainings)
        found = measure_cell(cell, data, parts)
        rows.append(FrictionRow(**vars(found), friction=friction, total=total))
    return rows


def inference_rows(data: RigData, parts: Split, repeats: int) -> list[InferenceRow]:
    """Time per sample of the networks on the test set, the least of `repeats`."""
    rows = []
    for direction in DIRECTIONS:
        cell = Cell("samples", direction, len(HIDDEN), HIDDEN[0], TRAINING, 1)
        network = train(cell, data, parts, seed=0).network
        inputs = rig_networks.direction_of(data, direction).inputs[parts.test]
        compiled, plain, samples = CompiledInference(network), PlainInference(network), [*inputs]
        for variant, action in (
            ("compiled", lambda f=compiled, samples=samples: [f(sample) for sample in samples]),
            ("plain", lambda f=plain, samples=samples: [f(sample) for sample in samples]),
            ("batch", lambda f=compiled.batch, samples=inputs: f(samples)),
        ):
            time, _ = best_of(lambda act=action: [act() for _ in range(_PASSES)], repeats)
            rows.append(InferenceRow(direction, variant, time / (_PASSES * len(inputs))))
    return rows


# ---------------------------------------------------------------- tables

_ARROWS = {"forward": "s -> z", "inverse": "z -> s"}


def _range(rows: list[CellRow]) -> str:
    values = (rows[0].e_rms, rows[0].e_rms_least, rows[0].e_rms_largest)
    middle, least, largest = (lab.number(value, ".3f", "mm") for value in values)
    return f"{middle} ({least} to {largest})"


_ON_TEST = "rms error in mm on the test set, median"

TABLES = [
    lab.pivot(
        f"{{direction}}: {_ON_TEST}",
        ("neurons",),
        "layers",
        "e_rms",
        of=CellRow,
        where={"study": "size"},
        per=("direction",),
        heading=lambda n: f"{n} layer{'s' * (n > 1)}",
        headings=("neurons per layer",),
    ),
    lab.pivot(
        f"Samples in the training set: {_ON_TEST} (range)",
        ("samples",),
        "direction",
        _range,
        of=CellRow,
        where={"study": "samples"},
    ),
    lab.table(
        f"Networks of {TRAINING} samples, medians",
        lab.Column("network", lambda row: f"{row.direction}, {_ARROWS[row.direction]}"),
        "e_rms",
        lab.Column("thesis mm", lambda row: THESIS[row.direction], ".2f", "mm"),
        "e_max",
        "iterations",
        "training_time",
        of=CellRow,
        where={"study": "samples", "samples": TRAINING},
    ),
    lab.pivot(
        "Stand-in without dither: rms error in mm on the test set, median (range)",
        ("friction", "tensions"),
        "direction",
        _range,
        of=FrictionRow,
        headings=("friction N", "sum of tensions"),
    ),
    lab.table(
        "Computing time per sample",
        lab.Column("network", "direction"),
        lab.Column("how", "variant"),
        "time",
        lab.Column("thesis µs", lambda r: _THESIS_TIMES.get((r.direction, r.variant)), ".1f", "µs"),
        of=InferenceRow,
    ),
]

# ---------------------------------------------------------------- picture

_TITLES = {"forward": "tip from tendon lengths", "inverse": "tendon lengths from the tip"}
_WHAT = {"forward": "in the tip", "inverse": "in tendon lengths"}

#: Samples [1] and error [m] that the thesis tells besides, secs. 3.2.3 and 5.1.1: 1 mm, and 1 % of
#: 30 mm.
_QUOTED = {"forward": (80, 1e-3), "inverse": (55, 0.3e-3)}


def picture(rows: list[Any]) -> Figure:
    """A line of panels per direction, error over neurons and over samples."""
    found = [row for row in lab.of_kind(rows, CellRow) if row.study in ("size", "samples")]
    directions = lab.groups(found, "direction")
    figure, axes = figures.new_figure(len(directions), 2, (9.5, 1.0 + 3.3 * len(directions)))
    for (left, right), ((direction,), mine) in zip(axes, directions.items(), strict=True):
        _sizes(left, lab.select(mine, study="size"))
        _samples(right, lab.select(mine, study="samples"), direction)
        left.axhline(1e3 * THESIS[direction], **figures.REFERENCE | {"label": "thesis"})
        left.set_ylabel(f"rms error [mm]\n{_TITLES[direction]}")
        for axis in (left, right):
            axis.set(xscale="log", yscale="log")
            figures.plain_ticks(axis, "xy")
    axes[-1, 0].set_xlabel("neurons per layer")
    axes[-1, 1].set_xlabel("samples in the training set")
    used = lab.select(found, study="samples", samples=TRAINING)
    quoted = [f"{1e3 * row.e_rms:.2g} mm {_WHAT[row.direction]}" for row in used]
    message = f"With {TRAINING} samples networks err by {' and '.join(quoted)}"
    figures.add_title(figure, message, "Quasi-static networks of the rig on the test set")
    shown = [h for axis in axes[0] for h in axis.get_legend_handles_labels()[0]]
    figures.add_legend(
        figure, [handle for handle in shown if not handle.get_label().startswith("_")]
    )
    return figure


def _sizes(axis: Axes, rows: list[CellRow]) -> None:
    """Medians, a curve per number of layers."""
    for (layers,), mine in sorted(lab.groups(rows, "layers").items()):
        x, y = zip(*sorted((row.neurons, 1e3 * row.e_rms) for row in mine), strict=True)
        label, colour = f"{layers} layer{'s' * (layers > 1)}", COLOURS[layers % len(COLOURS)]
        axis.plot(x, y, "o-", color=colour, label=label, markersize=4, linewidth=1.2)


def _samples(axis: Axes, rows: list[CellRow], direction: str) -> None:
    """Median and range of the trainings, with what the thesis tells."""
    rows = sorted(rows, key=lambda row: row.samples)
    x = [row.samples for row in rows]
    least, middle, largest = (
        [1e3 * getattr(row, name) for row in rows]
        for name in ("e_rms_least", "e_rms", "e_rms_largest")
    )
    axis.fill_between(x, least, largest, color=BLUE, alpha=0.2, lw=0)
    axis.plot(x, middle, "o-", color=BLUE, markersize=4, lw=1.2, label="median and range")
    marks = (
        (TRAINING, 1e3 * THESIS[direction]),
        (_QUOTED[direction][0], 1e3 * _QUOTED[direction][1]),
    )
    mark = {"color": "black", "markersize": 8, "zorder": 5, "label": "thesis, by samples"}
    axis.plot(*zip(*marks, strict=True), "x", linestyle="none", **mark)


STUDY = lab.Study(
    kinds=(CellRow, InferenceRow, FrictionRow), stages=run, tables=TABLES, plots={"{}": picture}
)
