"""Details of the Cosserat rod: Fig. 2.4 (drift), 2.5 and 2.6 (weighting functions)."""

from math import cos, pi, sin

import numpy as np
from scipy.integrate import BDF, OdeSolver, Radau

from softrobot_env.beams.cosserat import MOMENTS
from softrobot_env.beams.numerics import quaternions
from softrobot_env.benchmarks.thesis import values
from softrobot_env.benchmarks.thesis.rows import Row, build, make_row
from softrobot_env.benchmarks.thesis.statics import deflection
from softrobot_env.robots import CANTILEVER_WEAK

WEIGHTINGS = (1, 2, 3, 4, 5)

#: Relative and absolute tolerances of Fig. 2.4: those of sec. 2.5, and a hundredth of them.
TOLERANCES = ((1e-3, 1e-6), (1e-5, 1e-8))

_PIECES = 5

_BIN = 0.1  # s

_PROJECTED, _FREE = "projected", "not projected"


def weighting_rows() -> list[Row]:
    """Fig. 2.5: xi_1 to xi_5 over theta, half the angle between sections."""
    rows = []
    for kind in WEIGHTINGS:
        for degrees in range(0, 90, 3):
            theta = degrees * pi / 180
            value, _ = quaternions.weighting(kind, (cos(theta), sin(theta), 0.0, 0.0))
            x = ("theta_rad", theta)
            rows.append(make_row("2.5", f"xi_{kind}", "cosserat", None, "weighting", value, x))
    return rows


def influence_rows() -> list[Row]:
    """Fig. 2.6: deflection by weighting, with printed and with conservative moments."""
    rows, found = [], {}
    for moments in MOMENTS:
        for n in values.WEIGHTINGS:
            for kind in WEIGHTINGS:
                rod = build("cosserat", CANTILEVER_WEAK, n, weighting=kind, moments=moments)
                found[moments, n, kind] = y = deflection(rod)
                audit = values.WEIGHTINGS[n][kind - 1] if moments == "printed" else None
                curve, x = ("2.6", moments, "cosserat", n), ("weighting", kind)
                rows.append(make_row(*curve, "tip_deflection_m", y, x, audit=audit))
    spreads = {"printed": values.SPREAD_PRINTED, "conservative": values.SPREAD_CONSERVATIVE}
    for moments, audit in spreads.items():
        for n, expected in audit.items():
            all_ = [found[moments, n, kind] for kind in WEIGHTINGS]
            thesis = values.SPREAD_THESIS[n] if moments == "printed" else None
            quantity, known = ("spread_m", max(all_) - min(all_)), {"thesis": thesis}
            rows.append(make_row("2.6", moments, "cosserat", n, *quantity, **known, audit=expected))
    for kind, expected in values.REFINEMENT.items():
        change = found["printed", 3, kind] - found["printed", 5, kind]
        curve = "2.6", f"printed, xi_{kind}", "cosserat", None
        known = {"thesis": values.REFINEMENT_THESIS, "audit": expected}
        rows.append(make_row(*curve, "change_from_3_to_5_pieces_m", change, **known))
    return rows


def drift_rows(duration: float) -> list[Row]:
    """Fig. 2.4 up to a time [s]: violation of the quaternions' norm, the largest of every 0.1 s.

    Without projection it accumulates. With it, it is what a single step adds before projecting.
    Radau is an implicit one-step method, so that its state can be projected after every step;
    BDF is the relative of ode15s.
    """
    rows = []
    for tolerances, thesis in zip(TOLERANCES, values.DRIFT, strict=True):
        for solver, projected in ((BDF, False), (Radau, False), (Radau, True)):
            case = f"{solver.__name__}, {_PROJECTED if projected else _FREE}, {tolerances[0]:g}"
            times, drifts = _drift(solver, tolerances, projected, duration)
            curve = "2.4", case, "cosserat", _PIECES
            for start in np.arange(0, duration - _BIN / 2, _BIN):
                inside = (times > start) & (times <= start + _BIN)
                if inside.any():
                    worst, x = drifts[inside].max(), ("time_s", start + _BIN)
                    rows.append(make_row(*curve, "norm_violation", worst, x))
            known = {"thesis": thesis, "note": "before projecting"} if projected else {}
            rows.append(make_row(*curve, "largest_norm_violation", drifts.max(), **known))
    return rows


def _drift(
    solver: type[OdeSolver], tolerances: tuple[float, float], projected: bool, duration: float
) -> tuple[np.ndarray, np.ndarray]:
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


def project(y: np.ndarray) -> np.ndarray:
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
