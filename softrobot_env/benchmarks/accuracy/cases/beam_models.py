"""The beam models that take part in the accuracy benchmark."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any

import numpy as np

from softrobot_env.beams.model import BeamModel
from softrobot_env.benchmarks.accuracy.rows import BENDING, CONTINUUM, SHEAR, Physics
from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load


@dataclass(frozen=True)
class Contestant:
    """A beam model with its options.

    Attributes:
        name: Name in the report.
        physics: What it converges to.
        sizes: Numbers of pieces in the static cases, coarse to fine.
        spiral: Numbers of pieces in the spiral; the first is the thesis' own.
        step: Numbers of pieces in the tension step.
        explicit: Whether explicit integrators are worth a try.
    """

    name: str
    physics: Physics
    sizes: tuple[int, ...]
    spiral: tuple[int, ...]
    step: tuple[int, ...]
    explicit: bool = False

    def build(
        self,
        robot: RobotParams,
        pieces: int,
        loads: Sequence[Load] = (),
        space: str = "planar",
        **options: Any,
    ) -> BeamModel:
        """The model of a robot.

        Args:
            robot: The robot.
            pieces: Number of pieces.
            loads: Loads.
            space: "planar", "spatial" or "torsion": the cheapest version that can do this
                motion is taken.
            **options: Further options of the model.
        """
        kind, _, option = self.name.partition("/")
        if kind == "pcc":
            from softrobot_env.beams.pcc import PCC

            return PCC(robot, pieces, axes=space, inertia=option, loads=loads, **options)
        if kind == "cosserat":
            from softrobot_env.beams.cosserat import CosseratRod

            return CosseratRod(robot, pieces, loads=loads, **options)
        return _ancf(robot, pieces, loads, space, **options)


def _ancf(
    robot: RobotParams, pieces: int, loads: Sequence[Load], space: str, **options: Any
) -> BeamModel:
    from softrobot_env.beams.ancf import ANCF

    dimension = 2 if space == "planar" else 3

    return ANCF(robot, pieces, dimension=dimension, loads=loads, **options)


LUMPED = Contestant("pcc/lumped", BENDING, (3, 6, 12, 24), (2, 3, 5, 8), (3, 6, 12), True)
DISTRIBUTED = Contestant("pcc/distributed", BENDING, (3, 6, 12, 24), (2, 3, 5, 8), (3, 6, 12), True)
COSSERAT = Contestant("cosserat", SHEAR, (6, 12, 24, 48), (7, 14, 28), (6, 12, 24))
ANCF_BEAM = Contestant("ancf", CONTINUUM, (3, 6, 12, 24), (2, 4, 8), (3, 6, 12))


def contestants() -> tuple[Contestant, ...]:
    """The models that are there."""
    found = find_spec("softrobot_env.beams.ancf.model") is not None
    return (LUMPED, DISTRIBUTED, COSSERAT, *((ANCF_BEAM,) if found else ()))


def tip_twist(model: BeamModel, q: np.ndarray) -> float:
    """Angle [rad] the tip's section is turned about the z axis at q (n,)."""
    radius = model.robot.outer_radius
    tips = np.full(2, model.robot.length)
    center, rim = model.positions(q, tips, np.array([[0.0, 0.0], [radius, 0.0]]))
    arm = rim - center
    return float(np.arctan2(arm[1], arm[0]))
