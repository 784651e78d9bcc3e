"""The beam models of the stability benchmark, by name."""

from collections.abc import Callable
from typing import Any

from softrobot_env.beams.model import BeamModel
from softrobot_env.robots import RobotParams


def _pcc(robot: RobotParams, pieces: int, **options: Any) -> BeamModel:
    from softrobot_env.beams.pcc import PCC

    return PCC(robot, pieces, axes="planar", **options)


def _cosserat(robot: RobotParams, pieces: int, **options: Any) -> BeamModel:
    from softrobot_env.beams.cosserat import CosseratRod

    return CosseratRod(robot, pieces, **options)


def _ancf(robot: RobotParams, pieces: int, **options: Any) -> BeamModel:
    from softrobot_env.beams.ancf import ANCF

    return ANCF(robot, pieces, dimension=2, **options)


_MAKERS: dict[str, Callable[..., BeamModel]] = {
    "pcc": _pcc,
    "cosserat": _cosserat,
    "ancf2d": _ancf,
}

#: Names of the models.
BEAMS = tuple(_MAKERS)


def make_beam(name: str, robot: RobotParams, pieces: int, **options: Any) -> BeamModel:
    """Build a beam model.

    Args:
        name: One of `BEAMS`.
        robot: The robot.
        pieces: Number of pieces.
        **options: loads and drive, as for any `BeamModel`.
    """
    return _MAKERS[name](robot, pieces, **options)
