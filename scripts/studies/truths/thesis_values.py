"""Numbers of chapters 2 and 6 of the thesis, and those the audit recomputed; SI units.

Those of chapter 2 stand in thesis_chapter_2.csv: by figure, quantity, case, model, number of pieces
(any where there is none) and abscissa what the thesis prints, what the audit recomputed, and what
has to be known of it.
"""

import csv
from pathlib import Path
from typing import NamedTuple


class Known(NamedTuple):
    """What is known of a number."""

    thesis: float | None = None
    audit: float | None = None
    note: str = ""


def _number(text: str) -> float | None:
    return float(text) if text else None


with Path(__file__).with_name("thesis_chapter_2.csv").open(encoding="utf-8") as _file:
    _KNOWN = {
        (*name, _number(n), _number(x)): Known(_number(thesis), _number(audit), note)
        for *name, n, x, thesis, audit, note in list(csv.reader(_file))[1:]
    }


def known(
    figure: str, quantity: str, case: str, model: str, n: int | None = None, x: float | None = None
) -> Known:
    """What is known of a number of chapter 2."""
    name = figure, quantity, case, model
    return _KNOWN.get((*name, n, x)) or _KNOWN.get((*name, None, x)) or Known()


#: First order of Gauss-Legendre integration with an error below 1e-3, and its time [s].
ORDER, ORDER_TIME = 8, 0.23e-3

#: Bounds of the mean distance [m] to the mean of the models: of the finest, and of the chosen.
FINEST_BOUND, CHOSEN_BOUND = 0.9e-3, 2e-3

#: Pieces that the thesis chooses for Tab. 2.2 and 2.3.
CHOSEN = {"pcc": 2, "cosserat": 7, "ancf": 2}

#: Accuracies [m] of Tab. 2.2: of the adaptive solvers, and of implicit Euler (audit: metres).
ADAPTIVE_ACCURACY, EULER_ACCURACIES = 0.9e-3, (10e-3, 1e-3, 0.1e-3)

#: Steps [s] of implicit Euler with PCC in Tab. 2.3. The first does not divide 3 s, so that its
#: errors hold for another last step than equal ones.
EULER_STEPS = (0.16, 0.024, 0.002)

#: Tab. 2.2: computation times [s] of ode15s, ode45, and of implicit Euler by accuracy.
TIMES = {
    model: [v.thesis for k, v in _KNOWN.items() if (k[1], k[3]) == ("computation_time_s", model)]
    for model in CHOSEN
}

#: The thesis' name of a controller by that of our policy.
CONTROLLERS = {"qs_nn": "quasi-static", "lqi": "LQI", "mpc": "MPC"}

#: What sec. 6.6.3 says of the swing with a factor [1] on Young's modulus of the plant.
ROBUSTNESS = {
    "quasi-static": {0.5: "lost", 0.75: "lost", 1.25: "as nominal", 1.5: "as nominal"},
    "LQI": {0.5: "robust", 0.75: "robust", 1.25: "robust", 1.5: "robust"},
    "MPC": {0.5: "fails", 0.75: "z too small", 1.25: "z too large", 1.5: "z too large"},
}

#: Step width [m] and controller -> ranges of rise and settling time [s] and of the overshoot, and
#: of the steady-state error where it was told, by an independent recomputation with corrected
#: equations (audit).
_AUDIT_STEPS = {
    (0.05, "quasi-static"): ((0.24, 0.24), (5.6, 12.0), (0.61, 0.69), (0.001, 0.016)),
    (0.05, "LQI"): ((0.080, 0.096), (0.69, 0.76), (0.31, 0.35), (1e-4, 1e-4)),
    (0.05, "MPC"): ((0.09, 0.09), (0.85, 0.85), (0.28, 0.28), (1e-4, 1e-4)),
    (0.1, "quasi-static"): ((0.24, 0.24), (5.2, 14.0), (0.59, 0.67)),
    (0.1, "LQI"): ((0.081, 0.081), (0.68, 0.68), (0.30, 0.30)),
    (0.1, "MPC"): ((0.09, 0.09), (1.02, 1.02), (0.29, 0.29)),
    (0.2, "quasi-static"): ((0.24, 0.24), (5.0, 20.0), (0.52, 0.63)),
    (0.2, "LQI"): ((0.082, 0.082), (0.65, 0.65), (0.27, 0.27)),
    (0.2, "MPC"): ((0.09, 0.09), (1.01, 1.01), (0.29, 0.29)),
}
_STEP_METRICS = ("rise_time", "settling_time", "overshoot", "steady_state_error")

#: Smallest and largest figure of the audit, by task, step width [m] and controller; names and units
#: are those of `ThesisFigure`. A steady-state error of 1e-4 is an upper bound.
AUDIT: dict[tuple[str, float | None, str], dict[str, tuple[float, float]]] = {
    **{
        ("step", *case): dict(zip(_STEP_METRICS, ranges, strict=False))
        for case, ranges in _AUDIT_STEPS.items()
    },
    ("swing", None, "quasi-static"): {"e_max": (14e-3, 18e-3), "e_motion": (5e-3, 5e-3)},
    ("swing", None, "LQI"): {"e_max": (5.9e-3, 6.7e-3), "e_motion": (0.3e-3, 0.4e-3)},
    ("swing", None, "MPC"): {"e_max": (12.8e-3, 12.8e-3), "e_motion": (8.9e-3, 8.9e-3)},
    ("lshape", None, "quasi-static"): {"e_max": (22e-3, 28e-3)},
    ("lshape", None, "LQI"): {"e_max": (1.9e-3, 2.1e-3)},
    ("lshape", None, "MPC"): {"e_max": (2.6e-3, 2.6e-3)},
}
