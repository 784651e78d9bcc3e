"""What evaluations of the equations of motion cost, and how many it takes: Fig. 2.16 to 2.18."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numba import njit

from softrobot_env.beams import mechanics
from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.model import BeamModel, Motion
from softrobot_env.benchmarks.records import select
from softrobot_env.benchmarks.thesis import values
from softrobot_env.benchmarks.thesis.cosserat import project
from softrobot_env.benchmarks.thesis.rows import MODELS, Row, build, make_row
from softrobot_env.benchmarks.timing import best_of
from softrobot_env.robots import CANTILEVER_WEAK

#: Integrator of each model, in place of ode45 and ode15s, and their relative tolerance (sec. 2.5).
METHODS = {"pcc": "dormand_prince", "cosserat": "sdirk4", "ancf": "sdirk4"}
TOLERANCE = 1e-3

_DURATION = 5.0  # s
_STATES = 200
_SHORTEST = 0.02  # s, of a timed loop
_REPEATS = 5


# Not cached: the cache's stamp covers the sources in beams/ only.
@njit
def _accelerations(model, q, v, u, out, rounds):  # noqa: ANN001, ANN202
    """Evaluate the right-hand side in all states (k, n), some rounds."""
    for _ in range(rounds):
        for k in range(len(q)):
            mechanics.acceleration(model, q[k], v[k], u, out)


@njit
def _residuals(model, q, v, u, out, rounds):  # noqa: ANN001, ANN202
    """Evaluate the residual at zero acceleration in all states (k, n), some rounds."""
    zero = np.zeros(q.shape[1])
    for _ in range(rounds):
        for k in range(len(q)):
            mechanics.residual(model, q[k], v[k], zero, u, out)


def evaluation_time(model: BeamModel) -> float:
    """Time [s] of one evaluation of the accelerations, in a compiled loop over random states."""
    q, v = random_states(model, _STATES)
    return _time(_accelerations, model, q, v)


def force_time(model: BeamModel, q: np.ndarray, v: np.ndarray) -> float:
    """Time [s] of one evaluation of the forces in states (k, n), in a compiled loop."""
    return _time(_residuals, model, np.ascontiguousarray(q), np.ascontiguousarray(v))


def _time(loop: Callable[..., None], model: BeamModel, q: np.ndarray, v: np.ndarray) -> float:
    """Shortest time [s] per state of some loops, each long enough for the clock."""
    arguments = model.data, q, v, np.zeros(model.n_inputs), np.empty(model.n)
    rounds = 1
    loop(*arguments, rounds)
    while True:
        best, _ = best_of(partial(loop, *arguments, rounds), _REPEATS)
        if best > _SHORTEST / _REPEATS:
            return best / (rounds * len(q))
        rounds *= 4


def random_states(model: BeamModel, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Random coordinates and velocities (count, n); quaternions have norm 1, their rates fit."""
    rng = np.random.default_rng(seed)
    change = model.data.scale * rng.uniform(-0.3, 0.3, (count, model.n))
    q, v = model.rest() + change, model.data.scale * rng.uniform(-1, 1, (count, model.n))
    if isinstance(model, CosseratRod):
        parts = np.split(project(np.hstack([q, v])), 2, axis=1)
        q, v = map(np.ascontiguousarray, parts)
    return q, v


def evaluations(model: BeamModel, motion: Motion) -> int:
    """Evaluations of the equations of motion of a simulation, with those for Newton's matrices.

    A matrix takes one evaluation more than there are columns that cannot share one
    (`mechanics.iteration_matrix`).
    """
    data = model.data
    columns = min(data.n, (2 * data.reach + 1) * data.block)
    return motion.residuals + motion.matrices * (columns + 1)


def evaluation_rows(pieces: tuple[int, ...]) -> list[Row]:
    """Fig. 2.16: time per evaluation over the number of pieces, planar PCC and ANCF."""
    rows = []
    for model in MODELS:
        for n in pieces:
            time = evaluation_time(build(model, CANTILEVER_WEAK, n))
            rows.append(make_row("2.16", "compiled", model, n, "evaluation_time_s", time))
    for n in pieces:
        beam = build("ancf", CANTILEVER_WEAK, n, quadrature=values.ORDER)
        case = f"compiled, order {values.ORDER}"
        rows.append(make_row("2.16", case, "ancf", n, "evaluation_time_s", evaluation_time(beam)))
    return rows


def self_weight_rows(pieces: tuple[int, ...]) -> list[Row]:
    """Fig. 2.17 and the measured time of the same 5 s of the weak set's oscillation."""
    rows = []
    for model in MODELS:
        method = METHODS[model]
        for n in pieces:
            beam = build(model, CANTILEVER_WEAK, n)
            simulate = partial(beam.simulate, _DURATION, method=method, tolerance=TOLERANCE)
            motion = simulate()
            time, _ = best_of(simulate, 3)
            number = evaluations(beam, motion)
            rows += [
                make_row("2.17", method, model, n, "evaluations", number),
                make_row("2.18", f"{method}, measured", model, n, "computation_time_s", time),
            ]
    return rows


def total_rows(rows: list[Row]) -> list[Row]:
    """Fig. 2.18 from the rows of Fig. 2.16 and 2.17, and statements that the thesis draws."""
    single = {(r.model, r.n): r.y for r in select(rows, figure="2.16", case="compiled")}
    number = {(r.model, r.n): r.y for r in select(rows, figure="2.17")}
    out = []
    for (model, n), count in number.items():
        total = count * single[model, n]
        out.append(make_row("2.18", "product", model, n, "computation_time_s", total))
    return out + _statement_rows(number, out)


def _statement_rows(number: dict[tuple[str, int], float], totals: list[Row]) -> list[Row]:
    fast = [r.n for r in totals if r.model == "ancf" and r.y < _DURATION]
    sizes = sorted({n for _, n in number})
    more = [n for n in sizes if number["pcc", n] > number["ancf", n]]
    note = None if more else f"never up to {sizes[-1]} pieces"
    known = {"thesis": values.REALTIME_ANCF, "note": f"out of up to {sizes[-1]} pieces"}
    most = "most_pieces_in_real_time", max(fast, default=0)
    fewest = "fewest_pieces_with_more_than_ancf", min(more, default=None)
    crossing = {"thesis": values.PCC_NEEDS_MORE + 1, "note": note}
    return [
        make_row("2.18", "product", "ancf", None, *most, **known),
        make_row("2.17", "evaluations", "pcc", None, *fewest, **crossing),
    ]
