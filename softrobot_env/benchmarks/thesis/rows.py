"""Rows of the thesis benchmark, and the beam models as chapter 2 uses them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from softrobot_env.beams.ancf import ANCF
from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.model import BeamModel
from softrobot_env.beams.pcc import PCC
from softrobot_env.robots import CANTILEVER_STIFF, CANTILEVER_WEAK, RobotParams
from softrobot_env.robots.loads import Load

Row = dict[str, Any]

#: Fields of every row; see `benchmarks.thesis_figures.run`.
FIELDS = (
    "figure",
    "case",
    "model",
    "n",
    "x_name",
    "x",
    "y_name",
    "y",
    "thesis",
    "audit",
    "note",
)

#: Models by name in the rows.
MODELS = ("pcc", "cosserat", "ancf")

#: Parameter sets of Tab. 2.1, under gravity.
SETS = {"weak": CANTILEVER_WEAK, "stiff": CANTILEVER_STIFF}

#: Poisson ratio of silicone; all else is computed for 0, where the models can be compared.
SILICONE = 0.49

#: Shear correction factor of the thesis' Cosserat rod.
SHEAR_COEFFICIENT = 0.75


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
    """A row; x is its name and value, `others` are thesis, audit and note.

    Raises:
        ValueError: A field that rows do not have.
    """
    unknown = others.keys() - {"thesis", "audit", "note"}
    if unknown:
        raise ValueError(f"unknown fields {sorted(unknown)}")
    x_name, x_value = (None, None) if x is None else x
    values = {"figure": figure, "case": case, "model": model, "n": n, "x_name": x_name}
    values |= {"x": None if x_value is None else float(x_value), "y_name": y_name}
    values |= {"y": None if y is None else float(y)}
    return dict.fromkeys(FIELDS) | values | others


def weightless(robot: RobotParams) -> RobotParams:
    """The same robot without gravity."""
    return replace(robot, gravity=(0.0, 0.0, 0.0))


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
        model: One of `MODELS`. The Cosserat rod has xi_2, the moments as printed and
            kappa = 3/4; it is always spatial. ANCF's integrals are exact.
        robot: The robot.
        n: Number of pieces.
        loads: Loads.
        planar: Whether to take the planar version of PCC and ANCF; else PCC has torsion.
        **options: Further options of the model's class, instead of those named.
    """
    if model == "pcc":
        options = {"axes": "planar" if planar else "torsion"} | options
        return PCC(robot, n, loads=loads, **options)
    if model == "cosserat":
        printed = {"weighting": 2, "moments": "printed", "shear_coefficient": SHEAR_COEFFICIENT}
        return CosseratRod(robot, n, loads=loads, **(printed | options))
    return ANCF(robot, n, loads=loads, **({"dimension": 2 if planar else 3} | options))
