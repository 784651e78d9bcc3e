"""Figures and tables of chapter 2 of the thesis as data, with the audit's corrections."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from math import cos, pi, sin
from string import ascii_lowercase
from typing import Any

import numpy as np
from numba import njit
from numpy import ndarray
from rich.table import Table
from rich.text import Text
from scipy.integrate import BDF, OdeSolver, Radau
from scipy.interpolate import CubicSpline

from softrobot_env.beams import mechanics, signals
from softrobot_env.beams.ancf import ANCF
from softrobot_env.beams.cosserat import MOMENTS, CosseratRod
from softrobot_env.beams.model import BeamModel, IntegrationError, Motion
from softrobot_env.beams.numerics import quaternions
from softrobot_env.evaluation.models.runs import best_of
from softrobot_env.robots import CANTILEVER_STIFF, CANTILEVER_WEAK, RobotParams
from softrobot_env.robots.loads import Load
from studies.accuracy.cases import DURATION
from studies.accuracy.spiral import PERIOD, ROBOT, force, loads
from studies.beams import make_beam, mode_frequency, tip_twist, weightless
from studies.lab import Column, Job, Record, Study, number, pivot, select, table
from studies.thesis_pictures import pictures
from studies.truths import analytic
from studies.truths import thesis_values as values
from studies.truths.analytic import section, torsion_angle, torsion_frequency
from studies.truths.varying_beam import bending_frequencies

#: Models by name in the rows.
MODELS = ("pcc", "cosserat", "ancf")

#: Parameter sets of Tab. 2.1, under gravity.
SETS = {"weak": CANTILEVER_WEAK, "stiff": CANTILEVER_STIFF}

#: Poisson ratio of silicone; all else is computed for 0, where the models can be compared.
SILICONE = 0.49

#: Shear correction factor of the thesis' Cosserat rod.
SHEAR_COEFFICIENT = 0.75


@dataclass(frozen=True)
class Row(Record):
    """A point of a figure or a number of a table; names of quantities end in their unit.

    Attributes:
        figure: Of the thesis, such as "2.11" or "tab2.2".
        case, model: Curve or line that it belongs to.
        n: Pieces, if it has any.
        y_name, y: The quantity; None where it could not be computed, and the note then says why.
        x_name, x: Abscissa, None where it is n or there is none.
        thesis: The printed number, also where it is a misprint.
        audit: The number recomputed independently, or what a misprint has to mean
            (docs/thesis_audit.md).
        note: What has to be known.
    """

    figure: str
    case: str
    model: str
    n: int | None
    y_name: str
    y: float | None
    x_name: str | None = None
    x: float | None = None
    thesis: float | None = None
    audit: float | None = None
    note: str | None = None


def curve(
    where: tuple[str, str],
    model: str,
    robot: RobotParams,
    pieces: Sequence[int],
    y_name: str,
    measure: Callable[[BeamModel], float],
    **options: Any,
) -> list[Row]:
    """A number of a model with some numbers of pieces; `where` is figure and case."""
    return [
        Row(*where, model, n, y_name, measure(build(model, robot, n, **options))) for n in pieces
    ]


def printed(row: Row) -> Row:
    """The row with what the thesis prints, the audit recomputed, and is to be known of it."""
    found = values.known(row.figure, row.y_name, row.case, row.model, row.n, row.x)
    note = "; ".join(filter(None, (row.note, found.note))) or None
    audit = row.audit if found.audit is None else found.audit
    return replace(row, thesis=found.thesis, audit=audit, note=note)


def build(
    model: str, robot: RobotParams, n: int, *loads: Load, planar: bool = True, **options: Any
) -> BeamModel:
    """A model as the thesis sets it up, with n pieces.

    Args:
        model: One of `MODELS`. The Cosserat rod has its grid, xi_2, the moments as printed and
            kappa = 3/4; it is always spatial. ANCF's integrals are exact.
        robot: The robot.
        n: Number of pieces.
        *loads: Loads.
        planar: Whether to take the planar version of PCC and ANCF; else PCC has torsion.
        **options: Further options of the model's class, instead of those named.
    """
    if model == "cosserat":
        printed = {"grid": "thesis", "weighting": 2, "moments": "printed"}
        options = printed | {"shear_coefficient": SHEAR_COEFFICIENT} | options
    return make_beam(model, robot, n, loads, "planar" if planar else "torsion", **options)


# -------------------- self-weight and static torsion: Fig. 2.11, 2.12 and 2.14

#: Theory that each model converges to; a continuum bends and shears as a rod with k = 1.
CONVERGES_TO = {"pcc": "elastica", "cosserat": "exact_rod", "ancf": "exact_rod_k1"}

#: [N m] that the printed twist belongs to.
MOMENT = 0.01

_TIP, _FREQUENCY, _TO_THEORY = "tip_deflection_m", "frequency_Hz", "relative_to_euler_bernoulli"
_CURVE_POINTS, _CURVE_PIECES = 41, 5


def deflection(model: BeamModel) -> float:
    """Tip deflection [m] under gravity, positive downwards."""
    return float(-model.tip(model.equilibrium(check_stability=False))[0])


def _rows_by_pieces(
    figure: str,
    pieces: tuple[int, ...],
    y_name: str,
    measure: Callable[[BeamModel], float],
    theories: Callable[[str, RobotParams], dict[str, float]],
    note: str | None = None,
    **robots: RobotParams,
) -> list[Row]:
    """A number of all models, of ANCF with silicone's Poisson ratio, and of theories."""
    rows = []
    for name, robot in robots.items():
        for model in MODELS:
            rows += curve((figure, name), model, robot, pieces, y_name, measure)
        silicone = replace(robot, poisson_ratio=SILICONE)
        for plane in ("stress", "strain"):
            where = figure, f"{name}, nu = {SILICONE}, plane {plane}"
            found = curve(where, "ancf", silicone, pieces, y_name, measure, plane=plane)
            rows += [replace(row, note=note) for row in found]
        for theory, y in theories(name, robot).items():
            rows.append(Row(figure, name, theory, None, y_name, y))
    return rows


def deflection_rows(pieces: tuple[int, ...]) -> list[Row]:
    """Fig. 2.11 for some numbers of pieces, with the converged solutions."""
    note = "Poisson locking: the sections can only deform uniformly"
    what = _TIP, deflection, _deflections_by_theory, note
    rows = _rows_by_pieces("2.11", pieces, *what, **SETS)
    return rows + _threshold_rows(rows)


def _deflections_by_theory(name: str, robot: RobotParams) -> dict[str, float]:
    """Deflections [m] of beams; theories of small deflections hold for the stiff set only."""
    load = 9.81 * robot.mass_per_length
    rods = {"elastica": None, "exact_rod": SHEAR_COEFFICIENT, "exact_rod_k1": 1.0}
    found = {
        model: -analytic.bent_rod(robot.length, section(robot, k), (-load, 0.0)).tip[0]
        for model, k in rods.items()
    }
    if name == "stiff":
        beam = robot.length, robot.bending_stiffness
        shear = SHEAR_COEFFICIENT * robot.youngs_modulus / 2 * robot.area
        found["euler_bernoulli"] = analytic.euler_bernoulli_deflection(*beam, distributed=load)
        found["timoshenko"] = analytic.timoshenko_deflection(*beam, shear, distributed=load)
    return found


def _threshold_rows(rows: list[Row]) -> list[Row]:
    """Fewest pieces for a weak deflection within 5 % of what the model converges to; PCC's error
    for the stiff set with one piece."""
    found = {(r.case, r.model, r.n): r.y for r in rows}
    out = []
    for model, limit in CONVERGES_TO.items():
        mine = {r.n: r.y for r in select(rows, case="weak", model=model)}
        errors = {n: abs(y / found["weak", limit, None] - 1) for n, y in mine.items()}
        enough = [n for n in errors if all(errors[k] < 0.05 for k in errors if k >= n)]
        out.append(Row("2.11", "weak", model, None, "pieces_for_5_percent", min(enough)))
    error = found["stiff", "pcc", 1] / found["stiff", "euler_bernoulli", None] - 1
    return [*out, Row("2.11", "stiff", "pcc", 1, _TO_THEORY, error)]


def centreline_rows() -> list[Row]:
    """Fig. 2.12: centrelines of the weak set with five pieces."""
    rows = []
    for model in MODELS:
        beam = build(model, CANTILEVER_WEAK, _CURVE_PIECES)
        stations = np.linspace(0, beam.robot.length, _CURVE_POINTS)
        curve = "2.12", "weak", model, _CURVE_PIECES, "deflection_m"
        for y, _, along in beam.positions(beam.equilibrium(), stations):
            rows.append(Row(*curve, -y, "along_m", along))
    return rows


def torsion_rows(pieces: tuple[int, ...]) -> list[Row]:
    """Fig. 2.14 with the moment that its printed angle belongs to, 0.01 N m (audit)."""
    robot = weightless(CANTILEVER_WEAK)
    load = Load("twist", robot.length, moment=(0.0, 0.0, MOMENT))
    exact, curve = torsion_angle(robot, MOMENT), partial(Row, "2.14", y_name="twist_rad")
    rows = [
        curve("0.01 N m", "analytic", None, y=exact),
        curve("0.1 N m", "analytic", None, y=torsion_angle(robot, 10 * MOMENT)),
    ]
    for model, n in product(MODELS, pieces):
        beam = build(model, robot, n, load, planar=False)
        q = beam.equilibrium(np.ones(1), check_stability=False)
        rows.append(curve("tip", model, n, y=tip_twist(beam, q), audit=exact))
        if isinstance(beam, CosseratRod):
            audit = exact * (1 - 1 / (2 * n))
            last = {"y": 2 * np.arctan2(q[-1], q[-4]), "audit": audit, "note": _LAST}
            rows.append(curve("last section", model, n, **last))
    return rows


# -------------------- first bending and torsional frequencies: Fig. 2.13 and 2.15

_LAST = "as in the thesis: the angle of the last section, half a piece before the tip"

#: Number of pieces of the thesis' statements on Fig. 2.13.
_FINEST = 14


def bending_rows(pieces: tuple[int, ...]) -> list[Row]:
    """Fig. 2.13 for some numbers of pieces, 14 among them."""
    robots = {name: weightless(heavy) for name, heavy in SETS.items()}
    what = _FREQUENCY, mode_frequency, _frequencies_by_theory
    rows = _rows_by_pieces("2.13", pieces, *what, **robots)
    return rows + [row for name in SETS for row in _spread_rows(name, rows)]


def _frequencies_by_theory(_: str, robot: RobotParams) -> dict[str, float]:
    beam = robot.length, robot.bending_stiffness, robot.mass_per_length
    return {
        "euler_bernoulli": analytic.euler_bernoulli_frequency(*beam),
        "timoshenko": bending_frequencies(robot, 1, SHEAR_COEFFICIENT)[0],
    }


def _spread_rows(name: str, rows: list[Row]) -> list[Row]:
    """Distances of the models with 14 pieces from each other and from Euler-Bernoulli."""
    mine = {(r.model, r.n): r.y for r in rows if r.case == name}
    finest = {model: mine[model, _FINEST] for model in MODELS}
    spread = (max(finest.values()) - min(finest.values())) / min(finest.values())
    theory = mine["euler_bernoulli", None]
    found = {model: y / theory - 1 for model, y in finest.items()}
    distances = [Row("2.13", name, m, _FINEST, _TO_THEORY, y) for m, y in found.items()]
    return [Row("2.13", name, "all", _FINEST, "spread_of_models", spread), *distances]


def torsional_rows(pieces: tuple[int, ...]) -> list[Row]:
    """Fig. 2.15 of the weak set for both Poisson ratios."""
    rows = []
    for ratio in (0.0, SILICONE):
        robot = replace(weightless(CANTILEVER_WEAK), poisson_ratio=ratio)
        case, twisting = f"nu = {ratio:g}", partial(mode_frequency, torsion=True)
        rows.append(Row("2.15", case, "analytic", None, _FREQUENCY, torsion_frequency(robot)))
        for model in MODELS:
            about = ("2.15", case), model, robot, pieces, _FREQUENCY, twisting
            rows += curve(*about, planar=False)
    rod = {r.n: r.y for r in rows if (r.case, r.model) == ("nu = 0", "cosserat")}
    line = "2.15", "nu = 0, printed (2.44)", "cosserat", max(rod), _FREQUENCY
    return [*rows, Row(*line, 4 * rod[max(rod)])]


# -------------------- the Cosserat rod: Fig. 2.4 (drift), 2.5 and 2.6 (weighting functions)

WEIGHTINGS = (1, 2, 3, 4, 5)

#: Relative and absolute tolerances of Fig. 2.4: those of sec. 2.5, and a hundredth of them.
TOLERANCES = ((1e-3, 1e-6), (1e-5, 1e-8))

_PIECES = 5

_BIN = 0.1  # s


def weighting_rows() -> list[Row]:
    """Fig. 2.5: xi_1 to xi_5 over theta, half the angle between sections."""
    rows = []
    for kind, degrees in product(WEIGHTINGS, range(0, 90, 3)):
        theta = degrees * pi / 180
        value, _ = quaternions.weighting(kind, (cos(theta), sin(theta), 0.0, 0.0))
        line = "2.5", f"xi_{kind}", "cosserat", None, "weighting"
        rows.append(Row(*line, value, "theta_rad", theta))
    return rows


def influence_rows() -> list[Row]:
    """Fig. 2.6: deflection by weighting, with printed and with conservative moments."""
    rows, found = [], {}
    for moments, n, kind in product(MOMENTS, (3, 5), WEIGHTINGS):
        rod = build("cosserat", CANTILEVER_WEAK, n, weighting=kind, moments=moments)
        found[moments, n, kind] = y = deflection(rod)
        rows.append(Row("2.6", moments, "cosserat", n, _TIP, y, "weighting", kind))
    for moments, n in product(("printed", "conservative"), (3, 5)):
        all_ = [found[moments, n, kind] for kind in WEIGHTINGS]
        rows.append(Row("2.6", moments, "cosserat", n, "spread_m", max(all_) - min(all_)))
    for kind in (1, 2):
        change = found["printed", 3, kind] - found["printed", 5, kind]
        curve = "2.6", f"printed, xi_{kind}", "cosserat", None, "change_from_3_to_5_pieces_m"
        rows.append(Row(*curve, change))
    return rows


def drift_rows(duration: float) -> list[Row]:
    """Fig. 2.4 up to a time [s]: violation of the quaternions' norm, the largest of every 0.1 s.

    Without projection it accumulates. With it, it is what a single step adds before projecting.
    Radau is an implicit one-step method, so that its state can be projected after every step;
    BDF is the relative of ode15s.
    """
    rows = []
    for tolerances in TOLERANCES:
        for solver, projected in ((BDF, False), (Radau, False), (Radau, True)):
            case = f"{solver.__name__}, {'' if projected else 'not '}projected, {tolerances[0]:g}"
            times, drifts = _drift(solver, tolerances, projected, duration)
            curve = "2.4", case, "cosserat", _PIECES
            for start in np.arange(0, duration - _BIN / 2, _BIN):
                inside = (times > start) & (times <= start + _BIN)
                if inside.any():
                    worst, x = drifts[inside].max(), ("time_s", start + _BIN)
                    rows.append(Row(*curve, "norm_violation", worst, *x))
            note = "before projecting" if projected else None
            rows.append(Row(*curve, "largest_norm_violation", drifts.max(), note=note))
    return rows


def _drift(
    solver: type[OdeSolver], tolerances: tuple[float, float], projected: bool, duration: float
) -> tuple[ndarray, ndarray]:
    """Ends (k,) [s] of the steps, and the norm's violation (k,) there (before projecting)."""
    rod = build("cosserat", CANTILEVER_WEAK, _PIECES)
    derivative, n = rod.first_order(np.empty(0)), rod.n
    relative, absolute = tolerances
    start = np.concatenate(rod.start())
    stepper = solver(derivative, 0.0, start, duration, rtol=relative, atol=absolute)
    times, drifts = [], []
    while stepper.status == "running":
        message = stepper.step()
        if stepper.status == "failed":
            raise RuntimeError(f"{solver.__name__} failed at {stepper.t:.3g} s: {message}")
        times.append(stepper.t)
        drifts.append(rod.constraint_drift(stepper.y[:n]))
        if projected:
            stepper.y = project(stepper.y)
            stepper.f = derivative(stepper.t, stepper.y)
    return np.array(times), np.array(drifts)


def project(y: ndarray) -> ndarray:
    """States (..., 2 n) with unit quaternions, and their rates normal to them: (2.47), (2.48).

    The rates are projected with the normalised quaternions; with others, as printed, some of the
    drift would remain (audit).
    """
    out = y.copy()
    parts = out.reshape(*y.shape[:-1], 2, -1, 7)[..., 3:]
    q, v = parts[..., 0, :, :], parts[..., 1, :, :]
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    v -= np.sum(q * v, axis=-1, keepdims=True) * q
    return out


# -------------------- Gauss-Legendre order of the ANCF element's volume integrals: Fig. 2.8 and 2.9

#: Order of the thesis' reference solution.
HIGHEST = 20

_DURATION, _PERIOD = 5.0, 0.05  # s
_ERROR, _TIME = "relative_rms_error", "evaluation_time_s"
_LIMIT = 1e-3


def quadrature_rows(orders: tuple[int, ...]) -> list[Row]:
    """Fig. 2.8 and 2.9 for some orders, the highest one among them, and for our exact rules.

    The element oscillates under its weight; at every instant the elastic forces of all rules are
    compared. Errors are (2.72), relative to order 20 (case "order 20") and to the exact integral.
    A time is that of the residual, which adds damping and the constant mass matrix.
    """
    motion = build("ancf", CANTILEVER_WEAK, 1, planar=False).simulate(_DURATION, samples=_PERIOD)
    rules = {order: _element(order) for order in orders}
    rules |= {name: _element(name) for name in ("exact", "chebyshev")}
    sizes = {name: _force_sizes(model, motion.q[1:]) for name, model in rules.items()}
    rows = []
    for name, model in rules.items():
        ours = isinstance(name, str)
        x = () if ours else ("order", name)
        case = name if ours else "legendre"
        time = force_time(model, motion.q[1:], motion.v[1:])
        rows.append(Row("2.9", case, "ancf", 1, _TIME, time, *x))
        for reference in (HIGHEST, "exact"):
            if name == reference:
                continue
            error = np.sqrt(np.mean((sizes[name] / sizes[reference] - 1) ** 2))
            label = f"{case}, against {'exact' if reference == 'exact' else f'order {HIGHEST}'}"
            rows.append(Row("2.8", label, "ancf", 1, _ERROR, error, *x))
    return rows + _first_order_rows(rows)


def _element(quadrature: str | int) -> ANCF:
    return build("ancf", weightless(CANTILEVER_WEAK), 1, planar=False, quadrature=quadrature)


def _force_sizes(model: ANCF, q: ndarray) -> ndarray:
    """Norms (k,) of the elastic forces at coordinates (k, n)."""
    zero = np.zeros(model.n)
    return np.array([np.linalg.norm(model.residual(each, zero, zero)) for each in q])


def _first_order_rows(rows: list[Row]) -> list[Row]:
    """First order with an error below 1e-3, by reference."""
    out = []
    for case in (f"legendre, against order {HIGHEST}", "legendre, against exact"):
        first = min((int(r.x) for r in rows if r.case == case and r.y < _LIMIT), default=None)
        note = "no order computed has an error below 1e-3" if first is None else None
        out.append(Row("2.8", case, "ancf", 1, "first_order_below_1e-3", first, note=note))
    return out


# -------------------- what evaluations cost, and how many it takes: Fig. 2.16 to 2.18

#: Integrator of each model, in place of ode45 and ode15s, and their relative tolerance (sec. 2.5).
METHODS = {"pcc": "dormand_prince", "cosserat": "sdirk4", "ancf": "sdirk4"}
TOLERANCE = 1e-3

_COMPUTED = "computation_time_s"
_STATES = 200
_SHORTEST = 0.02  # s, of a timed loop
_LOOPS = 5


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


def force_time(model: BeamModel, q: ndarray, v: ndarray) -> float:
    """Time [s] of one evaluation of the forces in states (k, n), in a compiled loop."""
    return _time(_residuals, model, np.ascontiguousarray(q), np.ascontiguousarray(v))


def _time(loop: Callable[..., None], model: BeamModel, q: ndarray, v: ndarray) -> float:
    """Shortest time [s] per state of some loops, each long enough for the clock."""
    arguments = model.data, q, v, np.zeros(model.n_inputs), np.empty(model.n)
    rounds = 1
    loop(*arguments, rounds)
    while True:
        best, _ = best_of(partial(loop, *arguments, rounds), _LOOPS)
        if best > _SHORTEST / _LOOPS:
            return best / (rounds * len(q))
        rounds *= 4


def random_states(model: BeamModel, count: int, seed: int = 0) -> tuple[ndarray, ndarray]:
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
    """Fig. 2.16, time per evaluation over the number of pieces, planar PCC and ANCF; 2.17, how many
    the weak set's oscillation of 5 s takes; 2.18, their product and the measured time."""
    measured = CANTILEVER_WEAK, pieces, "evaluation_time_s", evaluation_time
    rows = [row for m in MODELS for row in curve(("2.16", "compiled"), m, *measured)]
    single = {(r.model, r.n): r.y for r in rows}
    where = "2.16", f"compiled, order {values.ORDER}"
    rows += curve(where, "ancf", *measured, quadrature=values.ORDER)
    number, products = {}, []
    for (model, method), n in product(METHODS.items(), pieces):
        beam = build(model, CANTILEVER_WEAK, n)
        simulate = partial(beam.simulate, _DURATION, method=method, tolerance=TOLERANCE)
        number[model, n] = evaluations(beam, simulate())
        time, _ = best_of(simulate, 3)
        total = number[model, n] * single[model, n]
        rows.append(Row("2.17", method, model, n, "evaluations", number[model, n]))
        rows.append(Row("2.18", f"{method}, measured", model, n, _COMPUTED, time))
        products.append(Row("2.18", "product", model, n, _COMPUTED, total))
    more = [n for n in pieces if number["pcc", n] > number["ancf", n]]
    note = None if more else f"never up to {pieces[-1]} pieces"
    fewest = "fewest_pieces_with_more_than_ancf", min(more, default=None)
    crossing = Row("2.17", "evaluations", "pcc", None, *fewest, note=note)
    return [*rows, *products, _real_time(products, _DURATION), crossing]


def _real_time(rows: list[Row], duration: float) -> Row:
    """Most pieces with which ANCF takes less than the time [s] that it simulates."""
    mine = select(rows, model="ancf")
    fast, note = [r.n for r in mine if r.y < duration], f"out of up to {mine[-1].n} pieces"
    line = mine[0].figure, mine[0].case, "ancf", None, "most_pieces_in_real_time"
    return Row(*line, max(fast, default=0), note=note)


# -------------------- the spiral under a turning force (2.79): Fig. 2.19 to 2.22, Tab. 2.2, 2.3

_SHOWN = 4  # of the compared instants, between those in the rows
_ACCURATE = 1e-6  # tolerance of curves
_REFERENCE = 1e-9  # tolerance of references of Tab. 2.2
_REPEATS = 3
_DENSE = 1501  # instants of references of Tab. 2.2

#: Tolerances tried for the adaptive solvers of Tab. 2.2, from loose to strict.
_TOLERANCES = tuple(10.0 ** (-k / 2) for k in range(2, 15))
_MOST_STEPS = 400_000  # of an explicit solver

_OWN = "distance to the model's own converged motion"
_BETWEEN = f"{_OWN}, the tip moving straight from step to step"
_FIRST = "ours starts with a thousandth of the motion"


def spiral_model(model: str, n: int) -> BeamModel:
    """Spatial model of the stiff set, without gravity (audit), with forces on its tip."""
    return build(model, ROBOT, n, *loads(), planar=False)


def distances(tip: ndarray, other: ndarray) -> tuple[float, float]:
    """Mean and largest distance [m] between two tips (k, 3) [m]."""
    distance = np.linalg.norm(tip - other, axis=1)
    return float(distance.mean()), float(distance.max())


def _simulate(beam: BeamModel, samples: Any = PERIOD, **options: Any) -> Motion:
    return beam.simulate(DURATION, _signal(), samples=samples, **options)


def _signal() -> signals.Signal:
    return signals.smooth(force, DURATION)


def curve_rows(sizes: dict[str, tuple[int, ...]]) -> list[Row]:
    """Fig. 2.20 to 2.22, the finest motion of each model making up the mean of the three."""
    tips = {}
    for model in MODELS:
        for n in sizes[model]:
            beam = spiral_model(model, n)
            tips[model, n] = beam.tip(_simulate(beam, tolerance=_ACCURATE).q)
    mean, rows = np.mean([tips[model, max(sizes[model])] for model in MODELS], axis=0), []
    for key, tip in tips.items():
        far = zip(("mean_distance_m", "largest_distance_m"), distances(tip, mean), strict=True)
        rows += [Row("2.20", "spiral", *key, *found) for found in far]
        sizes_ = [("largest_radius_m", np.max(np.linalg.norm(tip[:, :2], axis=1)))]
        sizes_ += [(f"last_tip_{axis}_m", y) for axis, y in zip("xyz", tip[-1], strict=True)]
        own = [printed(Row("2.22", "spiral", *key, *found)) for found in sizes_]
        rows += [row for row in own if row.audit is not None]
    shown = {key: tip for key, tip in tips.items() if key[1] == values.CHOSEN[key[0]]}
    for key, tip in (shown | {("mean of models", None): mean}).items():
        for k in range(0, len(tip), _SHOWN):
            x, y, _ = tip[k]
            rows.append(Row("2.21", "spiral", *key, "tip_x_m", x, "time_s", k * PERIOD))
            rows.append(Row("2.22", "spiral", *key, "tip_y_m", y, "tip_x_m", x))
    return rows


# ---------------------------------------------------------------- Fig. 2.19


def time_rows(model: str, pieces: tuple[int, ...]) -> list[Row]:
    """Fig. 2.19: computation times at the thesis' relative tolerance, solver included."""
    method, rows = METHODS[model], []
    for n in pieces:
        time, _ = _timed(spiral_model(model, n), method=method, tolerance=TOLERANCE)
        rows.append(Row("2.19", method, model, n, _COMPUTED, time))
    return [*rows, _real_time(rows, DURATION)] if model == "ancf" else rows


def _timed(beam: BeamModel, repeats: int = _REPEATS, **options: Any) -> tuple[float, Motion]:
    """Shortest computation time [s] of some simulations, and the motion; compiled before."""
    simulate = partial(beam.simulate, DURATION, _signal(), **options)
    simulate()
    return best_of(simulate, repeats)


# ---------------------------------------------------------------- Tab. 2.2 and 2.3


class _Contest:
    """A model of Tab. 2.2 and its converged motion."""

    def __init__(self, model: str) -> None:
        self.model, self.n = model, values.CHOSEN[model]
        self.beam = spiral_model(model, self.n)
        self._dense = np.linspace(0.0, DURATION, _DENSE)
        motion = _simulate(self.beam, self._dense, tolerance=_REFERENCE)
        self._reference = CubicSpline(self._dense, self.beam.tip(motion.q))

    def rows(self, figure: str, case: str, note: str | None = None, **found: Any) -> list[Row]:
        """Rows of one line of the tables."""
        return [Row(figure, case, self.model, self.n, *y, note=note) for y in found.items()]

    def errors(self, step: float | None = None, **options: Any) -> tuple[float, float]:
        """Mean and largest distance [m] at the samples or steps; infinite if it fails."""
        times, tip = self._tips(step, **options)
        return distances(tip, self._reference(times))

    def errors_between(self, step: float, **options: Any) -> tuple[float, float]:
        """The same over the whole motion, the tip moving straight from step to step."""
        times, tip = self._tips(step, **options)
        straight = np.stack([np.interp(self._dense, times, x) for x in tip.T], axis=1)
        return distances(straight, self._reference(self._dense))

    def _tips(self, step: float | None, **options: Any) -> tuple[ndarray, ndarray]:
        """Times (k,) [s] and tips (k, 3) [m]; nowhere, so to speak, if the simulation fails."""
        count = 300 if step is None else round(DURATION / step)
        times = np.linspace(0.0, DURATION, count + 1)
        try:
            motion = _simulate(self.beam, times, step=step, **options)
        except IntegrationError:
            return times, np.full((count + 1, 3), np.inf)
        return times, self.beam.tip(motion.q)

    def loosest_tolerance(self, method: str, accuracy: float) -> float | None:
        """First of the tolerances whose mean error is below an accuracy [m]."""
        options = {"method": method, "max_steps": _MOST_STEPS}
        good = (t for t in _TOLERANCES if self.errors(tolerance=t, **options)[0] <= accuracy)
        return next(good, None)

    def fewest_steps(self, method: str, accuracy: float) -> int:
        """Number of steps of a fixed-step method with a mean error [m] below an accuracy."""

        def good(steps: int) -> bool:
            return self.errors_between(method=method, step=DURATION / steps)[0] <= accuracy

        low, high = 4, 8
        while not good(high):
            low, high = high, 2 * high
        # To one percent: finer distinctions do not change what the step says.
        while high - low > max(1, high // 100):
            middle = (low + high) // 2
            low, high = (low, middle) if good(middle) else (middle, high)
        return high


def table_rows(model: str, quick: bool = False) -> list[Row]:
    """Tab. 2.2 and 2.3 of one model; errors are means over the motion.

    Args:
        model: One of `MODELS`.
        quick: Without the strictest accuracy of implicit Euler and without the explicit solver of
            the stiff models.
    """
    contest = _Contest(model)
    methods = ("sdirk4", "dormand_prince")[: 1 + (model == "pcc" or not quick)]
    rows = [row for method in methods for row in _adaptive_rows(contest, method)]
    for accuracy in values.EULER_ACCURACIES[: 2 if quick else 3]:
        steps = contest.fewest_steps("implicit_euler", accuracy)
        case, step = f"implicit_euler, {1e3 * accuracy:g} mm", DURATION / steps
        time, _ = _timed(contest.beam, method="implicit_euler", step=step)
        mean, worst = contest.errors_between(method="implicit_euler", step=step)
        rows += contest.rows("tab2.2", case, computation_time_s=time)
        rows += contest.rows("tab2.2", case, _BETWEEN, mean_error_m=mean, largest_error_m=worst)
        rows += contest.rows("tab2.3", case, step_s=step)
    return rows + _printed_step_rows(contest) if model == "pcc" else rows


def _adaptive_rows(contest: _Contest, method: str) -> list[Row]:
    accuracy = values.ADAPTIVE_ACCURACY
    case = f"{method}, {1e3 * accuracy:g} mm"
    tolerance = contest.loosest_tolerance(method, accuracy)
    if tolerance is None:
        note = f"no tolerance reached the accuracy within {_MOST_STEPS} steps"
        return contest.rows("tab2.2", case, note, computation_time_s=None)
    options = {"method": method, "tolerance": tolerance, "max_steps": _MOST_STEPS}
    time, motion = _timed(contest.beam, **options)
    mean, worst = contest.errors(**options)
    note = f"tolerance {tolerance:.1g}, {motion.steps} steps"
    steps = {"smallest_step_s": motion.smallest_step, "largest_step_s": motion.largest_step}
    return [
        *contest.rows("tab2.2", case, note, computation_time_s=time),
        *contest.rows("tab2.2", case, _OWN, mean_error_m=mean, largest_error_m=worst),
        *contest.rows("tab2.3", case, _FIRST, **steps),
    ]


def _printed_step_rows(contest: _Contest) -> list[Row]:
    """Errors of implicit Euler at the printed steps, which show that Tab. 2.2 is in metres."""
    rows = []
    for step in values.EULER_STEPS:
        case, options = f"implicit_euler, {step:g} s", {"method": "implicit_euler", "step": step}
        mean, worst = contest.errors(**options)
        found = {"mean_error_m": mean, "largest_error_m": worst}
        rows += contest.rows("tab2.2", case, f"{_OWN} at the steps", **found)
        between, _ = contest.errors_between(**options)
        rows += contest.rows("tab2.2", case, _BETWEEN, mean_error_between_m=between)
    return rows


# -------------------- the study

#: Numbers of pieces, and orders of integration of an ANCF element.
PIECES, QUICK_PIECES = tuple(range(1, 21)), (1, 2, 3, 4, 5, 8, 14)
ORDERS, QUICK_ORDERS = tuple(range(1, HIGHEST + 1)), (1, 2, 3, 4, 6, 7, 8, HIGHEST)

#: Numbers of pieces of the spiral; the finest of each model make up the reference.
SPIRAL_PIECES = {
    "pcc": (1, 2, 3, 4, 5),
    "cosserat": (1, 2, 3, 4, 5, 7, 10, 14, 20),
    "ancf": (1, 2, 3, 4, 5, 8, 12, 20),
}
QUICK_SPIRAL_PIECES = {"pcc": (1, 2, 5), "cosserat": (2, 7, 20), "ancf": (1, 2, 4, 8)}

#: [s] of the motion that Fig. 2.4 shows.
_DRIFT, _QUICK_DRIFT = 5.0, 1.0


def jobs(quick: bool) -> list[Job]:
    """All figures and tables, in order; quickly fewer pieces, and what is cheap of Tab. 2.2."""
    pieces, orders = (QUICK_PIECES, QUICK_ORDERS) if quick else (PIECES, ORDERS)
    sizes = QUICK_SPIRAL_PIECES if quick else SPIRAL_PIECES
    found = [
        ("Fig. 2.4 drift", partial(drift_rows, _QUICK_DRIFT if quick else _DRIFT)),
        ("Fig. 2.5 weighting functions", weighting_rows),
        ("Fig. 2.6 influence of the weighting", influence_rows),
        ("Fig. 2.8, 2.9 quadrature", partial(quadrature_rows, orders)),
        ("Fig. 2.11 deflection", partial(deflection_rows, pieces)),
        ("Fig. 2.12 centrelines", centreline_rows),
        ("Fig. 2.13 bending frequencies", partial(bending_rows, pieces)),
        ("Fig. 2.14 torsion", partial(torsion_rows, pieces)),
        ("Fig. 2.15 torsional frequencies", partial(torsional_rows, pieces)),
        ("Fig. 2.16 to 2.18 evaluations", partial(evaluation_rows, pieces)),
        ("Fig. 2.20 to 2.22 spiral", partial(curve_rows, sizes)),
    ]
    for model in MODELS:
        found.append((f"Fig. 2.19 spiral times, {model}", partial(time_rows, model, sizes[model])))
        found.append((f"Tab. 2.2, 2.3 {model}", partial(table_rows, model, quick)))
    return found


#: A quantity, or the end of its name -> unit and format; others are counted.
_UNITS = {
    "relative_to_euler_bernoulli": ("%", ".2f"),
    "spread_of_models": ("%", ".2f"),
    "largest_norm_violation": ("1e-6", ".3f"),
    "_m": ("mm", ".4g"),
    "_rad": ("mrad", ".2f"),
    "_Hz": ("Hz", ".3f"),
    "_s": ("µs", ".1f"),
}

#: Of these the thesis prints upper bounds.
_BOUNDS = ("spread_of_models", "relative_to_euler_bernoulli", "mean_distance_m")
_BOUNDS += ("largest_distance_m",)

_NAMES = {"pcc": "PCC", "cosserat": "Cosserat", "ancf": "ANCF"}
_SOLVERS = ("tab2.2", "tab2.3")


def _quantity(name: str) -> tuple[str, str, str]:
    """A quantity for people, its unit and format."""
    end = next((end for end in _UNITS if name.endswith(end)), "")
    what = name.removesuffix(end) or name
    return what.replace("_", " "), *_UNITS.get(end, ("", ".0f"))


def _place(row: Row) -> tuple[bool, int]:
    """Sorts figures, then tables, by number."""
    chapter, number = row.figure.split(".")
    return chapter.startswith("tab"), int(number)


def _is_printed_step(row: Row) -> bool:
    return row.figure == "tab2.2" and row.case.endswith(" s")


def _printed(rows: list[Row]) -> list[Table]:
    """All numbers that the thesis prints or that its equations give, except those of solvers."""
    shown = [row for row in sorted(rows, key=_place) if _is_shown(row)]
    reasons = _reasons(shown)
    make = table(
        "Numbers of chapter 2: as printed, as the audit expects them, and ours",
        Column("figure", lambda row: f"{row.figure} {reasons.get(_reason(row), '')}".strip()),
        *("case", Column("model", _model_name)),
        Column("what", lambda row: " ".join(_quantity(row.y_name)[:2]).strip()),
        Column("printed", _bound, ">"),
        Column("audit", lambda row: _shown(row, row.audit), ">"),
        Column("ours", lambda row: _shown(row, row.y), ">"),
    )
    return [_explained(made, reasons) for made in make(shown)]


def _is_shown(row: Row) -> bool:
    if _is_printed_step(row):
        return True
    return row.figure not in _SOLVERS and (row.thesis is not None or bool(_reason(row)))


def _reason(row: Row) -> str:
    """Why a printed number is not the right one."""
    return values.known(row.figure, row.y_name, row.case, row.model, row.n, row.x).note


def _reasons(rows: Iterable[Row]) -> dict[str, str]:
    """Reasons of rows, and the letter of each."""
    found = dict.fromkeys(filter(None, map(_reason, rows)))
    return dict(zip(found, ascii_lowercase, strict=False))


def _explained(made: Table, reasons: dict[str, str]) -> Table:
    """A table with its reasons below."""
    lines = [f"{letter}: {reason}" for reason, letter in reasons.items()]
    about = "audit: recomputed independently, or what a misprint means (docs/thesis_audit.md)"
    made.caption, made.caption_justify = Text("\n".join([about, *lines])), "left"
    return made


def _model_name(row: Row) -> str:
    name = _NAMES.get(row.model, row.model.replace("_", " "))
    return name if row.n is None else f"{name} {row.n}"


def _shown(row: Row, value: float | None) -> str:
    _, unit, form = _quantity(row.y_name)
    return number(value, form, unit)


def _bound(row: Row) -> str:
    below = row.y_name in _BOUNDS and row.thesis is not None and row.thesis > 0
    return "< " * below + _shown(row, row.thesis)


def _off(row: Row) -> float:
    return abs(row.y / row.audit - 1)


def _worst(rows: list[Row]) -> Row:
    """The row farthest from the audit."""
    return max(rows, key=_off)


def _deviations(rows: list[Row]) -> Iterable[Table]:
    """Largest relative deviations from the audit where the thesis prints nothing."""
    make = pivot(
        "Further numbers of the audit, and how far we are off at most",
        ("figure", "y_name"),
        {
            "numbers": len,
            "largest deviation %": lambda mine: number(_off(_worst(mine)), ".2f", "%"),
            "where": lambda mine: f"{_model_name(_worst(mine))}, {_worst(mine).case}",
        },
        where=lambda row: row.audit and row.thesis is None and not _is_printed_step(row),
        headings=("figure", "what"),
        show=lambda name: _quantity(name)[0],
    )
    return make(row for row in sorted(rows, key=_place) if row.y is not None)


#: Tables of solvers -> headings and quantities of their columns.
_SOLVER_COLUMNS = {
    "tab2.2": {"time ms": ("computation_time_s",), "error mm": ("mean_error_m",)},
    "tab2.3": {"steps ms": ("step_s", "smallest_step_s", "largest_step_s")},
}


def _solvers(rows: list[Row]) -> Iterable[Table]:
    """Tab. 2.2 and 2.3: ours, as printed, and what a misprint has to mean."""
    known = [row for row in rows if row.model in MODELS and not _is_printed_step(row)]
    known.sort(key=lambda row: MODELS.index(row.model))
    for figure, quantities in _SOLVER_COLUMNS.items():
        mine = [row for row in known if row.figure == figure]
        columns = {}
        for heading, names in quantities.items():
            columns[heading] = partial(_range, names, "y")
            columns[f"{heading}: printed"] = partial(_range, names, "thesis")
            if any(row.audit for row in mine if row.y_name in names):
                columns[f"{heading}: corrected"] = partial(_range, names, "audit")
        make = pivot(
            f"Tab. {figure[3:]}, spiral of 3 s: ours, as printed, and corrected",
            ("model", "n", "case"),
            columns,
            headings=("model", "n", "solver, accuracy"),
            show=lambda name: _NAMES.get(name, name),
        )
        yield from (_explained(made, _reasons(mine)) for made in make(mine))


def _range(names: tuple[str, ...], which: str, rows: list[Row]) -> str:
    """Numbers of some quantities, times 1000; a range for two, nothing where there are none."""
    found = [getattr(row, which) for row in rows if row.y_name in names]
    if which != "y" and None in found:
        return ""
    return " - ".join(map(_short, found))


def _short(value: float | None) -> str:
    if value is None:
        return "failed"
    scaled = 1e3 * value
    return f"{scaled:.0f}" if scaled >= 100 else f"{scaled:.2g}"


STUDY = Study(
    kinds=(Row,),
    jobs=jobs,
    derive=lambda rows: [printed(row) for row in rows],
    tables=[_printed, _deviations, _solvers],
    plots={"{}": pictures},
    alone=True,
)
