"""Numbers of chapters 2 and 6 of the thesis, and those the audit recomputed; SI units.

Those of chapter 2 stand in thesis_chapter_2.csv: by figure, quantity, case, model, number of pieces
(any where there is none) and abscissa what the thesis prints, what the audit recomputed, and what
has to be known of it. What the audit found of chapter 6 stands in audit_chapter_6.csv.
"""

import csv
from pathlib import Path
from typing import NamedTuple

from softrobot_env.core.files import readable


class Known(NamedTuple):
    """What is known of a number."""

    thesis: float | None = None
    audit: float | None = None
    note: str = ""


def _number(text: str) -> float | None:
    return float(text) if text else None


def _lines(name: str) -> list[list[str]]:
    """Lines of a table beside this file, without their headings."""
    with readable(Path(__file__).with_name(name)).open(encoding="utf-8") as file:
        return list(csv.reader(file))[1:]


_KNOWN = {
    (*name, _number(n), _number(x)): Known(_number(thesis), _number(audit), note)
    for *name, n, x, thesis, audit, note in _lines("thesis_chapter_2.csv")
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

#: Smallest and largest figure of an independent recomputation with corrected equations (audit), by
#: task, step width [m] and controller; names and units are those of `ThesisFigure`. A steady-state
#: error of 1e-4 is an upper bound.
AUDIT: dict[tuple[str, float | None, str], dict[str, tuple[float, float]]] = {}
for _task, _width, _controller, _figure, _least, _most in _lines("audit_chapter_6.csv"):
    _found = AUDIT.setdefault((_task, _number(_width), _controller), {})
    _found[_figure] = float(_least), float(_most)
