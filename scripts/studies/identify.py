"""Identifications of rods of another model class and of twins, whose truths are unknown to them.

A twin of the rig is recorded slowly, as a user records, and is identified from what its camera saw.
Then the same law drives it three times round the triangle: by the robot that was found, by the twin
itself, and by the rig as everybody believes it to be. Zeros of the servos are corrected by what
each of them knows.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import exp, log
from time import perf_counter
from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from softrobot_env.control.registry import find_policy, make_policy
from softrobot_env.evaluation.metrics import approached_metrics
from softrobot_env.evaluation.runner import Case
from softrobot_env.evaluation.runner import run as run_case
from softrobot_env.identification.errors import size
from softrobot_env.identification.fit.path import identify
from softrobot_env.identification.fit.report import parameter_rows
from softrobot_env.robots import RIG, RobotParams
from softrobot_env.robots.actuation import with_balance
from softrobot_env.robots.twin import Twin, rig3d_twin
from softrobot_env.tasks import make_task
from softrobot_env.thesis.rig.parameters import identified, record
from studies import lab
from studies.truths.rubbing_rod import BELIEVED, drawn, recorded

# -------------------- twins

#: Seeds of the twins.
TWINS = (1, 2, 3, 4, 5)

#: Laws that need nothing but a robot, and periods [s] of a lap.
POLICIES, PERIODS = ("chain_dynamics_pi", "inverse_dynamics"), (5.0, 1.0)


@dataclass(frozen=True)
class TwinRow(lab.Record):
    """Laps of a twin.

    Attributes:
        kind: "twin".
        twin: Its seed.
        policy: The law.
        period: [s] of a lap.
        found, true, believed: [m], mean error by the robot that was identified, by the twin
            itself, and by the rig as its parameters say; None after a failure.
        ratio: Found over true.
        time: [s] that the identification took.
    """

    kind: str
    twin: int = lab.quantity("", "d")
    policy: str = lab.quantity("", "", "law")
    period: float = lab.quantity("s", "g", "lap")
    found: float | None = lab.quantity("mm", ".2f", "identified")
    true: float | None = lab.quantity("mm", ".2f", "known")
    believed: float | None = lab.quantity("mm", ".2f")
    ratio: float | None = lab.quantity("", ".2f")
    time: float


def driven(seed: int) -> list[TwinRow]:
    """Rows of a twin."""
    twin, began = rig3d_twin(seed), perf_counter()
    found = identified(record(twin, seed))
    taken = perf_counter() - began
    zeros = found.header.commands.zeros or (0.0,) * len(RIG.tendons)
    known = _known(twin)
    tendons = zip(twin.robot.tendons, known.tendons, strict=True)
    pulled = np.array([(t.pretension - k.pretension) / t.stiffness for t, k in tendons])
    offsets = np.array(twin.servo_offset)
    own = replace(found.robot, file=None), offsets - zeros
    rigs = own, (known, pulled), (RIG, offsets)
    rows = []
    for law in product(POLICIES, PERIODS):
        errors = [_lap_error(*law, robot, twin, left) for robot, left in rigs]
        ratio = None if None in errors[:2] else errors[0] / errors[1]
        rows.append(TwinRow("twin", seed, *law, *errors, ratio, taken))
    return rows


def _known(twin: Twin) -> RobotParams:
    """The twin's robot as an identification would write it, without any error."""
    drive = replace(RIG.drive, backlash=float(np.mean(twin.backlash)))
    return with_balance(replace(twin.robot, pieces=6, drive=drive))


def _lap_error(
    policy: str, period: float, robot: RobotParams, twin: Twin, offsets: np.ndarray
) -> float | None:
    """Mean error [m] of laps of a twin with servo offsets (3,) [m], by a law for a robot."""
    built = replace(twin, servo_offset=tuple(offsets.tolist()))
    case = Case(make_task("triangle", period=period), policy, scene={"twin": built})
    env = case.environment()
    delay = find_policy(policy).delay_options(twin.camera_delay)
    law = make_policy(policy, robot, env.control_period, **delay)
    rollout = run_case(case, env, law).rollout
    env.close()
    if rollout.failure is not None:
        return None
    return approached_metrics(rollout, case.task.trajectory).e_mean_tracking


# -------------------- rods of another model class

#: Repetitions, each with a truth of its own.
REPETITIONS, QUICK = 100, 1

_STAGES = ("frame", "statics", "dynamics")


@dataclass(frozen=True)
class FoundRow(lab.Record):
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


def repetition(seed: int) -> list[FoundRow]:
    """What is found of one robot; its mass and its tendons' places are known."""
    truth = drawn(seed)
    recording = recorded(truth, seed)
    began = perf_counter()
    found = identify(recording, BELIEVED, _STAGES, known=("mass", "marker_offset"), validate=False)
    taken, rms = perf_counter() - began, size(found.fit.simulated.error)
    rows = {row.parameter: row for row in parameter_rows(found)}

    def row(kind: str, name: str, true: float, start: float) -> FoundRow:
        """Values and interval are logarithms over the start, as friction's has no factor."""
        mine = rows[name]
        value, low, high = (start * exp(x) for x in (mine.value, mine.low, mine.high))
        found = value, low, high, mine.low <= log(true / start) <= mine.high, value / true - 1
        return FoundRow(seed, kind, name, true, *found, rms, taken)

    out = [row("modulus", "youngs_modulus: section 1", truth.modulus, 1.0)]
    out.append(row("damping", "damping_time: all", truth.damping, 1.0))
    for tendon in found.robot.tendons:
        name = f"tendon_friction: {tendon.name}"
        start = tendon.friction / exp(rows[name].value)
        out.append(row("friction", name, truth.friction, start))
    late, true = rows["marker_delay: all"], truth.delay
    span = late.value, late.low, late.high, late.low <= true <= late.high, late.value - true
    return [*out, FoundRow(seed, "delay", "marker_delay: all", true, *span, rms, taken)]


# -------------------- tables

#: Kind -> largest relative error that is asked for; of the delay none is.
GOALS = {"modulus": 0.02, "damping": 0.05, "friction": 0.2}

#: Share of repetitions whose interval has to hold the truth; and largest error of laps after an
#: identification, over that of the same law that knows the twin.
COVERAGE, RATIO = 0.9, 1.3


def _error(join: Callable[[Any], float], of: Callable[[float], float] = abs) -> Callable:
    def said(rows: list[FoundRow]) -> str:
        unit = "%" if rows[0].kind in GOALS else "ms"
        return f"{lab.number(join([of(row.error) for row in rows]), '.1f', unit)} {unit}"

    return said


def _within(rows: list[FoundRow]) -> float | None:
    """Share of errors within what is asked."""
    goal = GOALS.get(rows[0].kind)
    return None if goal is None else float(np.mean([abs(row.error) <= goal for row in rows]))


def _inside(rows: list[FoundRow]) -> float:
    return float(np.mean([row.inside for row in rows]))


def _met(rows: list[FoundRow]) -> Text:
    within = _within(rows)
    return lab.verdict(None if within is None else within == 1 and _inside(rows) >= COVERAGE)


def _laps(rows: Sequence[lab.Record]) -> list[Table]:
    """Laps of twins; judged is the best law of each way of knowing the twin."""
    best = [
        min(mine, key=lambda row: np.inf if row.true is None else row.true)
        for mine in lab.groups(lab.of_kind(rows, TwinRow), "twin", "period").values()
    ]

    def met(row: TwinRow) -> str | Text:
        judged = row in best and row.ratio is not None
        return lab.verdict(row.ratio <= RATIO) if judged else ""

    return lab.table(
        "Twins of which nothing was known",
        *("twin", "policy", "period", "found", "true", "believed", "ratio"),
        lab.Column("met", met, ">"),
        of=TwinRow,
        caption="mean error of triangles; ratio: of the robot identified over the twin itself "
        f"known; met: at most {RATIO:g} by the law that is best for the twin known",
    )(rows)


def cases(quick: bool = False, count: int | None = None) -> list[tuple[str, int]]:
    """Twins, and as many rods as are wanted."""
    count = (QUICK if quick else REPETITIONS) if count is None else count
    twins = () if quick else TWINS
    return [*(("twin", k) for k in twins), *(("robot", k) for k in range(count))]


STUDY = lab.Study(
    kinds=(FoundRow, TwinRow),
    cases=cases,
    options=("count",),
    measure=lambda case: {"robot": repetition, "twin": driven}[case[0]](case[1]),
    tables=[
        lab.pivot(
            "Cosserat rods, identified",
            ("kind",),
            {
                "n": len,
                "mean": _error(np.mean, float),
                "median": _error(np.median),
                "largest": _error(max),
                "asked %": lambda rows: lab.number(GOALS.get(rows[0].kind), ".1f", "%"),
                "within it %": lambda rows: lab.number(_within(rows), ".1f", "%"),
                "in 95 %": lambda rows: lab.number(_inside(rows), ".1f", "%"),
                "met": _met,
            },
            of=FoundRow,
            headings=("parameter",),
        ),
        _laps,
    ],
    note="mean: of the error; median, largest: of its size; in 95 %: truths within the stated "
    "interval; met: all within what is asked, and the truth in at least "
    f"{100 * COVERAGE:.0f} % of the intervals",
)
