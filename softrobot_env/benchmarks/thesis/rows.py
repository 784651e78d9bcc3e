"""Rows of the thesis benchmark, and the beam models as chapter 2 uses them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from softrobot_env.beams.model import BeamModel
from softrobot_env.benchmarks.beams import make_beam
from softrobot_env.benchmarks.records import Record
from softrobot_env.robots import CANTILEVER_STIFF, CANTILEVER_WEAK, RobotParams
from softrobot_env.robots.loads import Load

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
        x_name, x: Abscissa, None where it is n or there is none.
        y_name, y: The quantity; None where it could not be computed, and the note then says why.
        thesis: The printed number.
        audit: The number recomputed independently.
        note: What has to be known.
    """

    figure: str
    case: str
    model: str
    n: int | None
    x_name: str | None
    x: float | None
    y_name: str
    y: float | None
    thesis: float | None = None
    audit: float | None = None
    note: str | None = None


def make_row(
    figure: str,
    case: str,
    model: str,
    n: int | None,
    y_name: str,
    y: float | None,
    x: tuple[str, float] | None = None,
    **others: Any,
) -> Row:
    """A row; x is its name and value, `others` are thesis, audit and note."""
    x_name, x_value = (None, None) if x is None else (x[0], float(x[1]))
    y_value = None if y is None else float(y)
    return Row(figure, case, model, n, x_name, x_value, y_name, y_value, **others)


def build(
    model: str,
    robot: RobotParams,
    n: int,
    loads: Sequence[Load] = (),
    planar: bool = True,
    **options: Any,
) -> BeamModel:
    """A model as the thesis sets it up, with n pieces.

    Args:
        model: One of `MODELS`. The Cosserat rod has its grid, xi_2, the moments as printed and
            kappa = 3/4; it is always spatial. ANCF's integrals are exact.
        robot: The robot.
        n: Number of pieces.
        loads: Loads.
        planar: Whether to take the planar version of PCC and ANCF; else PCC has torsion.
        **options: Further options of the model's class, instead of those named.
    """
    if model == "cosserat":
        printed = {"grid": "thesis", "weighting": 2, "moments": "printed"}
        printed["shear_coefficient"] = SHEAR_COEFFICIENT
        options = printed | options
    return make_beam(model, robot, n, loads, "planar" if planar else "torsion", **options)
