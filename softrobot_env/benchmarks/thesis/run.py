"""Metrics and tables of chapter 2 of the thesis as data, with the audit's corrections."""

from softrobot_env.benchmarks.thesis.cosserat import drift_rows, influence_rows, weighting_rows
from softrobot_env.benchmarks.thesis.cost import evaluation_rows, self_weight_rows, total_rows
from softrobot_env.benchmarks.thesis.modes import bending_rows, torsional_rows
from softrobot_env.benchmarks.thesis.quadrature import HIGHEST, quadrature_rows
from softrobot_env.benchmarks.thesis.rows import MODELS, Row
from softrobot_env.benchmarks.thesis.spiral import Curve, curve, curve_rows, table_rows, time_rows
from softrobot_env.benchmarks.thesis.statics import centreline_rows, deflection_rows, torsion_rows
from softrobot_env.core.jobs import Job, Progress, run_jobs

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


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Compute all figures and tables.

    Args:
        quick: Fewer numbers of pieces, and only what is cheap of Tab. 2.2.
        progress: Called with (description, done, total), or None.

    Returns:
        Rows in the order of the figures.
    """
    rows: list[Row] = []
    return run_jobs([*_planar_jobs(quick, rows), *_spiral_jobs(quick)], progress, rows)


def _planar_jobs(quick: bool, rows: list[Row]) -> list[Job]:
    """Jobs of all but the spiral; `rows` are those of the jobs done before."""
    pieces = QUICK_PIECES if quick else PIECES
    orders = QUICK_ORDERS if quick else ORDERS
    return [
        ("Fig. 2.4 drift", lambda: drift_rows(_QUICK_DRIFT if quick else _DRIFT)),
        ("Fig. 2.5 weighting functions", weighting_rows),
        ("Fig. 2.6 influence of the weighting", influence_rows),
        ("Fig. 2.8, 2.9 quadrature", lambda: quadrature_rows(orders)),
        ("Fig. 2.11 deflection", lambda: deflection_rows(pieces)),
        ("Fig. 2.12 centrelines", centreline_rows),
        ("Fig. 2.13 bending frequencies", lambda: bending_rows(pieces)),
        ("Fig. 2.14 torsion", lambda: torsion_rows(pieces)),
        ("Fig. 2.15 torsional frequencies", lambda: torsional_rows(pieces)),
        ("Fig. 2.16 evaluation times", lambda: evaluation_rows(pieces)),
        ("Fig. 2.17, 2.18 evaluations", lambda: self_weight_rows(pieces)),
        ("Fig. 2.18 total times", lambda: total_rows(rows)),
    ]


def _spiral_jobs(quick: bool) -> list[Job]:
    sizes = QUICK_SPIRAL_PIECES if quick else SPIRAL_PIECES
    curves: list[Curve] = []

    def compute(model: str) -> list[Row]:
        curves.extend(curve(model, n) for n in sizes[model])
        return []

    jobs: list[Job] = [(f"Fig. 2.20 spiral, {m}", lambda m=m: compute(m)) for m in MODELS]
    jobs.append(("Fig. 2.20 to 2.22 spiral", lambda: curve_rows(curves)))
    for m in MODELS:
        jobs.append((f"Fig. 2.19 spiral times, {m}", lambda m=m: time_rows(m, sizes[m])))
        jobs.append((f"Tab. 2.2, 2.3 {m}", lambda m=m: table_rows(m, quick)))
    return jobs
