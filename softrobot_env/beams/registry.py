"""Plants by name: the MuJoCo chain, or a beam model in its place."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from softrobot_env.interfaces import PlantModel
from softrobot_env.registries import Registry, load
from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load

if TYPE_CHECKING:
    from softrobot_env.beams.model import BeamModel

#: Name of the plant that environments have by default.
MUJOCO = "mujoco"

#: Largest axial strain an extensible model's episode may reach; full tension in all tendons of the
#: arm compresses it by a fifth.
_STRAIN = 0.5


@dataclass(frozen=True)
class _Beam:
    """How to build a model of some robot, the axial strain it can have, and its tolerance.

    Against a hundredth of the tolerance the arm's tip then errs by less than 0.02 mm on the swing
    task, and by 0.4 mm where the inputs jump by up to full scale every 50 ms.

    Attributes:
        model: Path of its class.
        finer: Its pieces for each of the robot's, unless a number is given.
        options: Of the class, for planar motion.
        strain, tolerance: See `plant.SteppedModel`.
    """

    model: str
    finer: int
    options: dict[str, Any]
    strain: float
    tolerance: float

    def build(self, robot: RobotParams, pieces: int | None, loads: Sequence[Load]) -> "BeamModel":
        """The model of a robot under some loads."""
        pieces = self.finer * robot.pieces if pieces is None else pieces
        return load(self.model)(robot, pieces, loads=loads, **self.options)


_BEAMS = Registry(
    "beam model",
    {
        "pcc": _Beam("softrobot_env.beams.pcc:PCC", 1, {"axes": "planar"}, 0.0, 1e-3),
        "cosserat": _Beam("softrobot_env.beams.cosserat:CosseratRod", 2, {}, _STRAIN, 1e-5),
        "ancf": _Beam("softrobot_env.beams.ancf:ANCF", 4, {"dimension": 2}, _STRAIN, 1e-5),
    },
)

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
        _BEAMS.find(self.name)

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
