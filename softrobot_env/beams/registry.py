"""Plants by name: the MuJoCo chain, or a beam model in its place."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from softrobot_env.interfaces import PlantModel
from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load

if TYPE_CHECKING:
    from softrobot_env.beams.model import BeamModel

#: Name of the plant that environments have by default.
MUJOCO = "mujoco"

#: Largest axial strain an extensible model's episode may reach; full tension in all tendons of the
#: arm compresses it by a fifth.
_STRAIN = 0.5


def _pcc(robot: RobotParams, pieces: int | None, loads: Sequence[Load]) -> "BeamModel":
    from softrobot_env.beams.pcc import PCC

    return PCC(robot, pieces, axes="planar", loads=loads)


def _cosserat(robot: RobotParams, pieces: int | None, loads: Sequence[Load]) -> "BeamModel":
    from softrobot_env.beams.cosserat import CosseratRod

    return CosseratRod(robot, 2 * robot.pieces if pieces is None else pieces, loads=loads)


def _ancf(robot: RobotParams, pieces: int | None, loads: Sequence[Load]) -> "BeamModel":
    from softrobot_env.beams.ancf import ANCF

    pieces = 4 * robot.pieces if pieces is None else pieces
    return ANCF(robot, pieces, dimension=2, loads=loads)


@dataclass(frozen=True)
class _Beam:
    """How to build a model of some robot, the axial strain it can have, and its tolerance.

    Against a hundredth of the tolerance the arm's tip then errs by less than 0.02 mm on the swing
    task, and by 0.4 mm where the inputs jump by up to full scale every 50 ms.
    """

    build: Callable[[RobotParams, int | None, Sequence[Load]], "BeamModel"]
    strain: float
    tolerance: float


_BEAMS = {
    "pcc": _Beam(_pcc, 0.0, 1e-3),
    "cosserat": _Beam(_cosserat, _STRAIN, 1e-5),
    "ancf": _Beam(_ancf, _STRAIN, 1e-5),
}

#: Names of all plants: "pcc" is the thesis' own, lumped and of the robot's number of pieces.
PLANTS = (MUJOCO, *_BEAMS)


@dataclass(frozen=True)
class BeamPlant:
    """Factory of a named beam model for `TrackingEnv(plant=...)`.

    Attributes:
        name: One of `PLANTS`, except the MuJoCo chain.
        pieces: Pieces of the model; the model's own choice unless given.
        step: [s], fixed step of the integration instead of an adaptive one.
        tolerance: Error of a step, relative to the size of a large motion; the model's own unless
            given.
    """

    name: str
    pieces: int | None = None
    step: float | None = None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if self.name not in _BEAMS:
            raise ValueError(f"unknown beam model {self.name!r}; choose from {', '.join(_BEAMS)}")

    def __call__(self, robot: RobotParams) -> PlantModel:
        """The model of a robot.

        Raises:
            ValueError: A number of pieces that the model cannot have.
        """
        from softrobot_env.beams.plant import SteppedModel

        beam = _BEAMS[self.name]
        return SteppedModel(
            robot,
            self._build,
            strain=beam.strain,
            step=self.step,
            tolerance=beam.tolerance if self.tolerance is None else self.tolerance,
        )

    def _build(self, robot: RobotParams, loads: Sequence[Load]) -> "BeamModel":
        return _BEAMS[self.name].build(robot, self.pieces, loads)
