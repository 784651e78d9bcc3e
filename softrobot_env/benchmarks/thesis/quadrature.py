"""Gauss-Legendre order of the ANCF element's volume integrals: Fig. 2.8 and 2.9."""

import numpy as np

from softrobot_env.beams.ancf import ANCF
from softrobot_env.benchmarks.beams import weightless
from softrobot_env.benchmarks.thesis import values
from softrobot_env.benchmarks.thesis.cost import force_time
from softrobot_env.benchmarks.thesis.rows import Row, build, make_row
from softrobot_env.robots import CANTILEVER_WEAK

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
        x = None if ours else ("order", name)
        case = name if ours else "legendre"
        time = force_time(model, motion.q[1:], motion.v[1:])
        thesis = values.ORDER_TIME if name == values.ORDER else None
        rows.append(make_row("2.9", case, "ancf", 1, _TIME, time, x, thesis=thesis))
        for reference in (HIGHEST, "exact"):
            if name == reference:
                continue
            error = np.sqrt(np.mean((sizes[name] / sizes[reference] - 1) ** 2))
            label = f"{case}, against {'exact' if reference == 'exact' else f'order {HIGHEST}'}"
            rows.append(make_row("2.8", label, "ancf", 1, _ERROR, error, x))
    return rows + _first_order_rows(rows)


def _element(quadrature: str | int) -> ANCF:
    return build("ancf", weightless(CANTILEVER_WEAK), 1, planar=False, quadrature=quadrature)


def _force_sizes(model: ANCF, q: np.ndarray) -> np.ndarray:
    """Norms (k,) of the elastic forces at coordinates (k, n)."""
    zero = np.zeros(model.n)
    return np.array([np.linalg.norm(model.residual(each, zero, zero)) for each in q])


def _first_order_rows(rows: list[Row]) -> list[Row]:
    """First order with an error below 1e-3, by reference."""
    out = []
    for case in (f"legendre, against order {HIGHEST}", "legendre, against exact"):
        good = [int(r.x) for r in rows if r.case == case and r.y < _LIMIT]
        first = min(good) if good else None
        note = None if good else "no order computed has an error below 1e-3"
        row = make_row(
            "2.8", case, "ancf", 1, "first_order_below_1e-3", first, thesis=values.ORDER, note=note
        )
        out.append(row)
    return out
