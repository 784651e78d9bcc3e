"""Plants by name: the MuJoCo chain, or a beam model in its place."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from softrobot_env.core.interfaces import PlantModel
from softrobot_env.core.registry import Registry, load
from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load

if TYPE_CHECKING:
    from .model import BeamModel

#: Coordinates of the tip that are measured of a planar robot.
PLANE = slice(0, 3, 2)

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
        options: Of the class for motion in the plane, in space without torsion where it can do
            without, and with it.
        strain, tolerance: See `plant.SteppedModel`.
        heads: Whether it takes the sections and discs that heads become.
    """

    model: str
    finer: int
    options: tuple[dict[str, Any], ...]
    strain: float = _STRAIN
    tolerance: float = 1e-5
    heads: bool = True


_BEAMS = Registry(
    "beam model",
    {
        "pcc": _Beam(
            "softrobot_env.beams.pcc:PCC",
            1,
            tuple({"axes": axes} for axes in ("planar", "spatial", "torsion")),
            strain=0.0,
            tolerance=1e-3,
        ),
        "cosserat": _Beam("softrobot_env.beams.cosserat:CosseratRod", 2, ({}, {}, {})),
        "ancf": _Beam(
            "softrobot_env.beams.ancf:ANCF",
            4,
            tuple({"dimension": dimension} for dimension in (2, 3, 3)),
            heads=False,
        ),
    },
)

#: Names of all plants: "pcc" is the thesis' own, lumped and of the robot's number of pieces.
PLANTS = (MUJOCO, *_BEAMS.registered())


@dataclass(frozen=True)
class BeamPlant:
    """Factory of a named beam model for the argument `plant` of environments.

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

    def __call__(
        self,
        robot: RobotParams,
        *,
        axes: slice = PLANE,
        bending: str = "planar",
        torsion: bool = False,
        actuation: str = "tension",
    ) -> PlantModel:
        """The model of a robot, see `interfaces.PlantFactory`.

        Raises:
            ValueError: A number of pieces that the model cannot have, or what the model lacks.
        """
        from .plant import SteppedModel

        beam = _BEAMS[self.name]
        if robot.head is not None and not beam.heads:
            takers = [name for name, each in _BEAMS.items() if each.heads]
            raise ValueError(
                f"robot {robot.name!r} has a head, which plant {self.name!r} has no sections for; "
                f"take {', '.join(takers)} or the MuJoCo chain"
            )
        way = 0 if bending == "planar" else 1 + torsion
        options = beam.options[way] | {"drive": actuation}
        return SteppedModel(
            robot,
            partial(_build, self, robot.head is not None, options),
            strain=beam.strain,
            axes=axes,
            bending=bending,
            step=self.step,
            tolerance=beam.tolerance if self.tolerance is None else self.tolerance,
        )


def _build(
    plant: BeamPlant,
    headed: bool,
    options: dict[str, Any],
    robot: RobotParams,
    loads: Sequence[Load],
) -> "BeamModel":
    """A plant's model of a robot, whose last section stands for a head or not, under loads."""
    beam = _BEAMS[plant.name]
    model, pieces = load(beam.model), plant.pieces
    if pieces is None:
        pieces = max(beam.finer * robot.pieces, model.fewest(robot))
    else:
        pieces += headed
    return model(robot, pieces, loads=loads, **options)
