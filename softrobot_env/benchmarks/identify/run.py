"""Identifications of rods of another model class and of twins, whose truths nobody is told."""

from dataclasses import dataclass
from functools import partial
from math import exp, log
from time import perf_counter

from softrobot_env.benchmarks.identify.truth import BELIEVED, drawn, recorded
from softrobot_env.benchmarks.identify.twins import TwinRow, twin_jobs
from softrobot_env.benchmarks.records import Record
from softrobot_env.core.jobs import Job, Progress, run_in_processes
from softrobot_env.identification.fit.least_squares import size
from softrobot_env.identification.fit.path import identify
from softrobot_env.identification.fit.report import parameter_rows

#: Repetitions, each with a truth of its own.
REPETITIONS, QUICK = 100, 1

_STAGES = ("frame", "statics", "dynamics")


@dataclass(frozen=True)
class FoundRow(Record):
    """A parameter of a repetition.

    Attributes:
        repetition: Seed of truth and noise.
        kind: "modulus", "damping", "friction" or "delay".
        name: Of the parameter.
        true, found: Factor on what is believed [1], of friction and delay [N, s].
        low, high: 95 % interval.
        inside: Whether the truth is in it.
        error: Relative error; of the delay [s].
        rms: [m] of the static rows.
        time: [s] that the identification took.
    """

    repetition: int
    kind: str
    name: str
    true: float
    found: float
    low: float
    high: float
    inside: bool
    error: float
    rms: float
    time: float


Row = FoundRow | TwinRow


def run(quick: bool = False, show: Progress | None = None) -> list[Row]:
    """All repetitions, and twins of the rig, in processes; quickly one repetition alone."""
    count = QUICK if quick else REPETITIONS
    tasks: list[Job] = [(f"robot {seed}", partial(repetition, seed)) for seed in range(count)]
    if quick:
        return [row for _, work in tasks for row in work()]
    return [row for rows in run_in_processes([*twin_jobs(), *tasks], show) for row in rows]


def repetition(seed: int) -> list[FoundRow]:
    """What is found of one robot; its mass and its tendons' places are known."""
    truth = drawn(seed)
    recording = recorded(truth, seed)
    began = perf_counter()
    found = identify(recording, BELIEVED, _STAGES, known=("mass", "marker_offset"), validate=False)
    taken, rms = perf_counter() - began, size(found.fit.simulated.error)
    rows = {row.parameter: row for row in parameter_rows(found)}
    out = []
    for kind, name, true, start in (
        ("modulus", "youngs_modulus: section 1", truth.modulus, 1.0),
        ("damping", "damping_time: all", truth.damping, 1.0),
        *(
            ("friction", f"tendon_friction: {tendon.name}", truth.friction, tendon.friction)
            for tendon in found.robot.tendons
        ),
    ):
        row = rows[name]
        # Friction has no factor on what is believed: zero.
        begin = start / exp(row.value) if kind == "friction" else start
        value, low, high = (begin * exp(x) for x in (row.value, row.low, row.high))
        inside = row.low <= log(true / begin) <= row.high
        out.append(
            FoundRow(seed, kind, name, true, value, low, high, inside, value / true - 1, rms, taken)
        )
    late = rows["marker_delay: all"]
    inside = late.low <= truth.delay <= late.high
    error = late.value - truth.delay
    out.append(
        FoundRow(
            seed,
            "delay",
            "marker_delay: all",
            truth.delay,
            late.value,
            late.low,
            late.high,
            inside,
            error,
            rms,
            taken,
        )
    )
    return out
