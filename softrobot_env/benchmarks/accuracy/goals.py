"""Goals for the cost of a simulation, and whether a run of the benchmark met them."""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from softrobot_env.beams.model import Motion, State
from softrobot_env.benchmarks.accuracy.cases import pyelastica_rod, spiral
from softrobot_env.benchmarks.accuracy.cases.beam_models import COSSERAT, LUMPED
from softrobot_env.benchmarks.accuracy.rows import Row
from softrobot_env.benchmarks.records import select
from softrobot_env.benchmarks.timing import best_of

#: Errors in time [m]: our own, and the thesis' (Tab. 2.2, whose unit is m according to the audit).
_FINE, _THESIS = 1e-6, 0.9e-3

#: Model, pieces and run time [s] of the spiral.
_SPIRALS = (("pcc/lumped", 2, 0.020), ("cosserat", 7, 0.100), ("ancf", 2, 1.0))

_STEPS, _STEP = 500, 1e-5  # s, below the stability limit of 20 pieces


def rows(found: list[Row], quick: bool = False) -> list[Row]:
    """Goals and what rows of the benchmark say about them; limits of a speed-up are lower ones."""
    return [*_spirals(found), *_right_hand_side(quick), *_chain(found), *_speed_up(found)]


def _spirals(found: list[Row]) -> Iterator[Row]:
    for model, n, bound in _SPIRALS:
        mine = select(found, case=spiral.CASE, model=model, n=n)
        for error in (_FINE, _THESIS):
            good = (row for row in mine if row.e_time is not None and row.e_time <= error)
            best = _fastest(good)
            if best is not None:
                case = f"3 s spiral, error in time <= {1e3 * error:g} mm: time [s]"
                yield goal(case, best, best.wall_time, most=bound)


def _right_hand_side(quick: bool) -> Iterator[Row]:
    times = {n: right_hand_side_time(n, 3 if quick else 20) for n in (5, 20)}
    few, many = (Row("goal", "", LUMPED.name, n) for n in times)
    yield goal("right-hand side in 3-D: time [s]", few, times[5], most=10e-6)
    growth = times[20] / times[5]
    yield goal("its growth from 5 to 20 pieces: factor", many, growth, most=(20 / 5) ** 2)


def right_hand_side_time(pieces: int, repeats: int) -> float:
    """Time [s] per acceleration of the spatial PCC model in the spiral, all of rk4 included."""
    model = LUMPED.build(spiral.ROBOT, pieces, spiral.loads(), "spatial")
    start = State(np.full(model.n, 1 / model.robot.length), np.zeros(model.n))  # bent
    inputs = np.array([1.0, -2.0])

    def simulate() -> Motion:
        return model.simulate(_STEPS * _STEP, inputs, start, method="rk4", step=_STEP)

    simulate()  # compiles
    time, motion = best_of(simulate, repeats)
    return time / motion.residuals


def _chain(found: list[Row]) -> Iterator[Row]:
    chains = (r for r in select(found, case=spiral.CASE, kind="dynamic") if r.is_chain)
    best = _fastest(row for row in chains if row.e_mean < 1e-4)
    if best is not None:
        speed = spiral.DURATION / best.wall_time
        yield goal("spiral, mean error < 0.1 mm: times real time", best, speed, least=300.0)


def _speed_up(found: list[Row]) -> Iterator[Row]:
    """The fastest run of at most the same error, for each of PyElastica's: chain and rod.

    The goal is the chain's; the rod, which has PyElastica's physics, stands beside it.
    """
    runs = select(found, case=pyelastica_rod.CASE, kind="dynamic")
    for theirs in select(runs, model=pyelastica_rod.NAME):
        for model in (pyelastica_rod.CHAIN, COSSERAT.name):
            best = _fastest(r for r in select(runs, model=model) if r.e_max <= theirs.e_max)
            if best is not None:
                ratio = theirs.wall_time / best.wall_time
                case = f"undamped spiral, error of PyElastica {theirs.n} or less: times faster"
                row = goal(case, best, ratio, least=30.0)
                checked = model == pyelastica_rod.CHAIN
                yield row if checked else replace(row, limit=None, met=None)


def _fastest(found: Iterable[Row]) -> Row | None:
    return min(found, key=lambda row: row.wall_time, default=None)


def goal(
    case: str, best: Row, value: float, *, most: float | None = None, least: float | None = None
) -> Row:
    """What the best row has to do with a goal, which has one of two bounds."""
    met = value >= least if most is None else value <= most
    bound = {"limit": least if most is None else most, "met": met}
    left_out = dict.fromkeys(("step_time", "reference", "e_relative"))
    return replace(best, kind="goal", case=case, value=value, **bound, **left_out)
