"""First bending and torsional frequencies over the number of pieces: Fig. 2.13 and 2.15."""

from dataclasses import replace

from softrobot_env.benchmarks.beams import mode_frequency, weightless
from softrobot_env.benchmarks.thesis import values
from softrobot_env.benchmarks.thesis.rows import (
    MODELS,
    SETS,
    SHEAR_COEFFICIENT,
    SILICONE,
    Row,
    build,
    make_row,
)
from softrobot_env.benchmarks.thesis.statics import LOCKED
from softrobot_env.robots import CANTILEVER_WEAK, RobotParams
from studies.truths.analytic import euler_bernoulli_frequency
from studies.truths.shearable_rod import bending_frequency, torsion_frequency

_FREQUENCY = "frequency_Hz"

#: Number of pieces of the thesis' statements on Fig. 2.13.
_FINEST = 14

_BOUND = "the thesis gives an upper bound"
_REAL = "shear and rotary inertia, which Euler-Bernoulli leaves out, are real (audit)"
_PRINTED_FACTOR = (
    "the factor 4 of (2.44) instead of 1/4 makes rotary accelerations 16 times too large and "
    "torsional frequencies 4 times too high; it may be why the thesis' rod does not converge"
)


def bending_rows(pieces: tuple[int, ...]) -> list[Row]:
    """Fig. 2.13 for some numbers of pieces, 14 among them."""
    rows = []
    for name, heavy in SETS.items():
        robot = weightless(heavy)
        rows += _theory_rows(name, robot)
        for model in MODELS:
            audit = values.FREQUENCY[name, model]
            for n in pieces:
                found = mode_frequency(build(model, robot, n))
                rows.append(make_row("2.13", name, model, n, _FREQUENCY, found, audit=audit.get(n)))
        silicone = replace(robot, poisson_ratio=SILICONE)
        for plane, case in LOCKED.items():
            for n in pieces:
                found = mode_frequency(build("ancf", silicone, n, plane=plane))
                rows.append(make_row("2.13", f"{name}, {case}", "ancf", n, _FREQUENCY, found))
    return rows + [row for name in SETS for row in _statement_rows(name, rows)]


def _theory_rows(name: str, robot: RobotParams) -> list[Row]:
    beam = robot.length, robot.bending_stiffness, robot.mass_per_length
    found = {
        "euler_bernoulli": euler_bernoulli_frequency(*beam),
        "timoshenko": bending_frequency(robot, SHEAR_COEFFICIENT),
    }
    audit = values.FREQUENCY_THEORY
    return [
        make_row("2.13", name, model, None, _FREQUENCY, y, audit=audit[name, model])
        for model, y in found.items()
    ]


def _statement_rows(name: str, rows: list[Row]) -> list[Row]:
    """Distances of the models with 14 pieces from each other and from Euler-Bernoulli."""
    mine = {(r.model, r.n): r.y for r in rows if r.case == name}
    theory = mine["euler_bernoulli", None]
    finest = {model: mine[model, _FINEST] for model in MODELS}
    spread = (max(finest.values()) - min(finest.values())) / min(finest.values())
    known = {"audit": 0.008 if name == "weak" else None, "note": _BOUND}
    known |= {"thesis": values.MODEL_SPREAD}
    out = [make_row("2.13", name, "all", _FINEST, "spread_of_models", spread, **known)]
    for model, found in finest.items():
        audit = values.THEORY_DISTANCE_AUDIT.get((name, model))
        known = {"thesis": values.THEORY_DISTANCE, "audit": audit, "note": f"{_BOUND}; {_REAL}"}
        quantity = "relative_to_euler_bernoulli", found / theory - 1
        out.append(make_row("2.13", name, model, _FINEST, *quantity, **known))
    return out


def torsional_rows(pieces: tuple[int, ...]) -> list[Row]:
    """Fig. 2.15 of the weak set for both Poisson ratios."""
    rows = []
    for ratio, audit in values.TORSION_FREQUENCY.items():
        robot = replace(weightless(CANTILEVER_WEAK), poisson_ratio=ratio)
        case = f"nu = {ratio:g}"
        exact = torsion_frequency(robot)
        rows.append(make_row("2.15", case, "analytic", None, _FREQUENCY, exact, audit=audit))
        for model in MODELS:
            for n in pieces:
                found = mode_frequency(build(model, robot, n, planar=False), torsion=True)
                lumped = ratio == 0 and model != "ancf"
                known = values.TORSION_FREQUENCY_LUMPED.get(n) if lumped else None
                rows.append(make_row("2.15", case, model, n, _FREQUENCY, found, audit=known))
    rod = {r.n: r.y for r in rows if (r.case, r.model) == ("nu = 0", "cosserat")}
    finest = max(rod)
    known = {"audit": values.TORSION_FREQUENCY_PRINTED, "note": _PRINTED_FACTOR}
    curve = "2.15", "nu = 0, printed (2.44)", "cosserat", finest
    return [*rows, make_row(*curve, _FREQUENCY, 4 * rod[finest], **known)]
