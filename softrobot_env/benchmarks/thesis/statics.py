"""Deflection under self-weight and static torsion: Fig. 2.11, 2.12 and 2.14."""

from dataclasses import replace

import numpy as np

from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.model import BeamModel
from softrobot_env.benchmarks.beams import tip_twist, weightless
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
from softrobot_env.robots import CANTILEVER_WEAK, RobotParams
from softrobot_env.robots.loads import Load
from studies.truths.analytic import (
    bent_rod,
    euler_bernoulli_deflection,
    timoshenko_deflection,
)
from studies.truths.shearable_rod import section, torsion_angle

#: Cases of ANCF with the Poisson ratio of silicone, by law of the plane.
LOCKED = {plane: f"nu = {SILICONE}, plane {plane}" for plane in ("stress", "strain")}

#: Theory that each model converges to; a continuum bends and shears as a rod with k = 1.
CONVERGES_TO = {"pcc": "elastica", "cosserat": "exact_rod", "ancf": "exact_rod_k1"}

#: [N m] that the printed twist belongs to.
MOMENT = 0.01

_TIP = "tip_deflection_m"
_CURVE_POINTS = 41
_CURVE_PIECES = 5
_MOMENT = "the printed moment of 0.1 N m does not give the printed angle"
_LAST = "as in the thesis: the angle of the last section, half a piece before the tip"
_LOCKING = "Poisson locking: the sections can only deform uniformly"


def deflection(model: BeamModel) -> float:
    """Tip deflection [m] under gravity, positive downwards."""
    return float(-model.tip(model.equilibrium(check_stability=False))[0])


def deflection_rows(pieces: tuple[int, ...]) -> list[Row]:
    """Fig. 2.11 for some numbers of pieces, with the converged solutions."""
    rows = []
    for name, robot in SETS.items():
        for model in MODELS:
            audit = values.DEFLECTION[name, model]
            for n in pieces:
                found = deflection(build(model, robot, n))
                rows.append(make_row("2.11", name, model, n, _TIP, found, audit=audit.get(n)))
        rows += _locked_rows(name, robot, pieces)
        rows += _theory_rows(name, robot)
    return rows + _threshold_rows(rows)


def _locked_rows(name: str, robot: RobotParams, pieces: tuple[int, ...]) -> list[Row]:
    silicone = replace(robot, poisson_ratio=SILICONE)
    rows = []
    for plane, case in LOCKED.items():
        for n in pieces:
            found = deflection(build("ancf", silicone, n, plane=plane))
            known = (name, n) == ("stiff", 20)
            audit = values.LOCKED_DEFLECTION[plane] if known else None
            label = f"{name}, {case}"
            rows.append(make_row("2.11", label, "ancf", n, _TIP, found, audit=audit, note=_LOCKING))
    return rows


def _theory_rows(name: str, robot: RobotParams) -> list[Row]:
    """Lines of the beam theories; those for small deflections hold for the stiff set only."""
    load = 9.81 * robot.mass_per_length
    shear = SHEAR_COEFFICIENT * robot.youngs_modulus / 2 * robot.area
    rods = {"elastica": None, "exact_rod": SHEAR_COEFFICIENT, "exact_rod_k1": 1.0}
    found = {
        model: -bent_rod(robot.length, section(robot, k), (-load, 0.0)).tip[0]
        for model, k in rods.items()
    }
    if name == "stiff":
        beam = robot.length, robot.bending_stiffness
        found |= {
            "euler_bernoulli": euler_bernoulli_deflection(*beam, distributed=load),
            "timoshenko": timoshenko_deflection(*beam, shear, distributed=load),
        }
    audit = values.DEFLECTION_THEORY
    return [
        make_row("2.11", name, model, None, _TIP, y, audit=audit[name, model])
        for model, y in found.items()
    ]


def _threshold_rows(rows: list[Row]) -> list[Row]:
    """Fewest pieces for a weak deflection within 5 % of what the model converges to; PCC's error
    for the stiff set with one piece."""
    found = {(r.case, r.model, r.n): r.y for r in rows}
    out = []
    for model, limit in CONVERGES_TO.items():
        converged = found["weak", limit, None]
        errors = {
            n: abs(y / converged - 1) for (c, m, n), y in found.items() if (c, m) == ("weak", model)
        }
        enough = [n for n in errors if all(errors[k] < 0.05 for k in errors if k >= n)]
        thesis = values.PIECES_FOR_5_PERCENT[model]
        printed = {"thesis": thesis, "audit": thesis}
        name = "pieces_for_5_percent"
        out.append(make_row("2.11", "weak", model, None, name, min(enough), **printed))
    error = found["stiff", "pcc", 1] / found["stiff", "euler_bernoulli", None] - 1
    printed = {"thesis": -0.005, "audit": values.ONE_PIECE_ERROR}
    name = "relative_to_euler_bernoulli"
    return [*out, make_row("2.11", "stiff", "pcc", 1, name, error, **printed)]


def centreline_rows() -> list[Row]:
    """Fig. 2.12: centrelines of the weak set with five pieces."""
    rows = []
    for model in MODELS:
        beam = build(model, CANTILEVER_WEAK, _CURVE_PIECES)
        stations = np.linspace(0, beam.robot.length, _CURVE_POINTS)
        for y, _, along in beam.positions(beam.equilibrium(), stations):
            curve = "2.12", "weak", model, _CURVE_PIECES
            rows.append(make_row(*curve, "deflection_m", -y, ("along_m", along)))
    return rows


def torsion_rows(pieces: tuple[int, ...]) -> list[Row]:
    """Fig. 2.14 with the moment that its printed angle belongs to, 0.01 N m (audit)."""
    robot = weightless(CANTILEVER_WEAK)
    load = Load("twist", robot.length, moment=(0.0, 0.0, MOMENT))
    exact = torsion_angle(robot, MOMENT)
    tenfold, thesis = torsion_angle(robot, 10 * MOMENT), {"thesis": values.TWIST}
    printed = thesis | {"audit": values.TWIST_AS_PRINTED, "note": _MOMENT}
    rows = [
        _twist_row("0.01 N m", "analytic", None, exact, **thesis, audit=values.TWIST),
        _twist_row("0.1 N m", "analytic", None, tenfold, **printed),
    ]
    for model in MODELS:
        for n in pieces:
            beam = build(model, robot, n, (load,), planar=False)
            q = beam.equilibrium(np.ones(1), check_stability=False)
            rows.append(_twist_row("tip", model, n, tip_twist(beam, q), audit=exact))
            if isinstance(beam, CosseratRod):
                angle = 2 * np.arctan2(q[-1], q[-4])
                known = {"audit": exact * (1 - 1 / (2 * n)), "note": _LAST}
                rows.append(_twist_row("last section", model, n, angle, **known))
    return rows


def _twist_row(case: str, model: str, n: int | None, angle: float, **others: object) -> Row:
    return make_row("2.14", case, model, n, "twist_rad", angle, **others)
