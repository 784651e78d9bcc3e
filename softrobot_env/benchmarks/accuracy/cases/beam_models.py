"""The beam models that take part in the accuracy benchmark."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from softrobot_env.beams.model import BeamModel
from softrobot_env.benchmarks.accuracy.rows import BENDING, CONTINUUM, SHEAR, Physics
from softrobot_env.benchmarks.beams import make_beam
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
        """The model of a robot; arguments as those of `make_beam`."""
        return make_beam(self.name, robot, pieces, loads, space, **options)


LUMPED = Contestant("pcc/lumped", BENDING, (3, 6, 12, 24), (2, 3, 5, 8), (3, 6, 12), True)
DISTRIBUTED = Contestant("pcc/distributed", BENDING, (3, 6, 12, 24), (2, 3, 5, 8), (3, 6, 12), True)
COSSERAT = Contestant("cosserat", SHEAR, (6, 12, 24, 48), (7, 14, 28), (6, 12, 24))
ANCF_BEAM = Contestant("ancf", CONTINUUM, (3, 6, 12, 24), (2, 4, 8), (3, 6, 12))

CONTESTANTS = (LUMPED, DISTRIBUTED, COSSERAT, ANCF_BEAM)
