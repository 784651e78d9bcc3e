"""What is identified of one rig, for its controllers; `identification` finds it.

A network z -> s of the statics (thesis sec. 5.1); two parameters of the rig in several pieces that
describe the same recording: the bending stiffness and how far the tendons are turned about the
axis; the damping that makes that model calm down as the rig does; and the backlash between commands
and tendons. A network knows the statics better than any model, but nothing of the dynamics.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, sin
from pathlib import Path

import numpy as np

from softrobot_env.core.records import NotNegative, Positive, check_fields
from softrobot_env.learned.network import Network, describe, load_for
from softrobot_env.learned.plain_inference import Inference, inference
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import find_artifact, train_command

#: Whose file it is; the one shipped is of twin 0.
_POLICY = "rig_nn"

#: Attribute -> name in the file.
_NUMBERS = {"stiffness": "stiffness", "turn": "turn", "damping": "damping", "backlash": "play"}


@dataclass(frozen=True)
class IdentifiedParameters:
    """What is known of one rig.

    Attributes:
        network: z (2,) [m] -> s (3,) [m], with a constant sum of tensions.
        stiffness: Bending stiffness over that of the nominal rig [1].
        turn: [rad], of the tendons about the axis.
        damping: Bending damping over that of the nominal rig [1].
        backlash: [m], by which a tendon lags behind its command whichever way that moves: half of
            the servo's backlash, and friction over the tendon's stiffness; mean of the tendons.
        twin: Seed of the twin that was identified, None if it was another rig.
    """

    network: Network
    stiffness: Positive
    turn: float
    damping: NotNegative
    backlash: float
    twin: int | None = None

    def __post_init__(self) -> None:
        check_fields(self, "identified parameters")

    @cached_property
    def statics(self) -> Inference:
        """The network, for real time."""
        return inference(self.network)

    def believed(self, robot: RobotParams) -> RobotParams:
        """The rig as it seems to be, to be modelled in several pieces."""
        return turned(robot, self.stiffness, self.turn, self.damping)

    def save(self, path: Path, robot: RobotParams, about: dict[str, object]) -> None:
        """Write an npz file, for the nominal robot, with more `about` it."""
        numbers = {name: getattr(self, own) for own, name in _NUMBERS.items()}
        twin = {} if self.twin is None else {"twin": self.twin}
        self.network.save(path, describe_rig(robot) | numbers | twin | about)

    @classmethod
    def load(cls, robot: RobotParams, path: str | Path | None = None) -> "IdentifiedParameters":
        """Read what `save` wrote.

        Args:
            robot: The nominal rig.
            path: The file; found unless given, see `artifacts.find_artifact`. The one shipped is of
                twin 0.

        Raises:
            FileNotFoundError: No such file.
            ValueError: It belongs to another robot, or lacks something.
        """
        path = find_artifact(robot, _POLICY) if path is None else Path(path)
        network, about = load_for(path, robot, _POLICY, describe_rig, (2, len(robot.tendons)))
        for name in (*_NUMBERS.values(), *({"twin"} & about.keys())):
            about.check_shape(name, ())
        twin = int(about["twin"]) if "twin" in about else None
        try:
            return cls(network, *(float(about[name]) for name in _NUMBERS.values()), twin)
        except ValueError as error:
            command = train_command(robot, _POLICY)
            raise ValueError(f"{path}: {error}; make it anew with `{command}`") from None


def read_identified(robot: RobotParams, path: str | Path | None = None) -> IdentifiedParameters:
    """See `IdentifiedParameters.load`."""
    return IdentifiedParameters.load(robot, path)


def describe_rig(robot: RobotParams) -> dict[str, np.ndarray]:
    """What the statics of a rig depend on, by name; without friction, a matter of the rig as built.

    Of a robot without a head, which has no such statics, the head is empty.
    """
    head, azimuth = robot.head, 2 * robot.stiff_azimuth
    return describe(robot) | {
        "gravity": np.array(robot.gravity),
        "tendon_stiffness": np.array([t.stiffness for t in robot.tendons]),
        "tendon_pretension": np.array([t.pretension for t in robot.tendons]),
        "head": np.array([] if head is None else [head.mass, head.centre, head.output]),
        "anisotropy": robot.anisotropy * np.array([cos(azimuth), sin(azimuth)]),
        "precurvature": np.array(robot.precurvature),
    }


def turned(
    robot: RobotParams, stiffness: float, turn: float, damping: float | None = None
) -> RobotParams:
    """A rig with other bending stiffness and damping, its tendons turned about the axis.

    Args:
        robot: The nominal rig.
        stiffness: Over that of `robot` [1].
        turn: [rad].
        damping: Over that of `robot` [1]; as the stiffness unless given.
    """
    share = 1.0 if damping is None else damping / stiffness
    return replace(
        robot,
        youngs_modulus=stiffness * robot.youngs_modulus,
        damping_time=share * robot.damping_time,
        tendons=tuple(tendon.turned(turn) for tendon in robot.tendons),
    )
