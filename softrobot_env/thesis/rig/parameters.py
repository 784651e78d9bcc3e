"""Twins of the rig, recorded and identified for its controllers."""

from dataclasses import dataclass, replace
from functools import cached_property
from math import cos, degrees, sin
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import ProgressCallback
from softrobot_env.core.records import NotNegative, Positive, Record
from softrobot_env.envs.recording import RecordEpisodes
from softrobot_env.identification.excitation import Excitation, excite, plan, resting_task
from softrobot_env.identification.fit.path import Identification, identify
from softrobot_env.identification.visits import Visiting
from softrobot_env.learned.network import Network, describe, load_for
from softrobot_env.learned.plain_inference import Inference, inference
from softrobot_env.recordings import Recording
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import find_artifact, train_command
from softrobot_env.robots.twin import Twin
from softrobot_env.training.request import Metrics, Quantity, TrainingRequest, quantity_mm

from ..envs import RigEnv
from ..robots import RIG
from .inverse import PIECES_SOFTER
from .servo_constraints import ServoConstraints

#: Whose file it is; the one shipped is of twin 0.
_POLICY = "rig_nn"

#: Attribute -> name in the file.
_NUMBERS = {"stiffness": "stiffness", "turn": "turn", "damping": "damping", "backlash": "play"}


@dataclass(frozen=True)
class IdentifiedParameters(Record, what="identified parameters"):
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
        about.check_shapes(dict.fromkeys((*_NUMBERS.values(), *({"twin"} & about.keys())), ()))
        twin = int(about["twin"]) if "twin" in about else None
        try:
            return cls(network, *(float(about[name]) for name in _NUMBERS.values()), twin)
        except ValueError as error:
            command = train_command(robot, _POLICY)
            raise ValueError(f"{path}: {error}; make it anew with `{command}`") from None


def read_identified(robot: RobotParams, path: str | Path | None = None) -> IdentifiedParameters:
    """See `IdentifiedParameters.load`."""
    return IdentifiedParameters.load(robot, path)


def describe_rig(robot: RobotParams) -> dict[str, ndarray]:
    """What the statics of a rig depend on, by name; without friction, a matter of the rig as built.

    Of a robot without a head, which has no such statics, the head is empty.
    """
    head, azimuth = robot.head, 2 * robot.stiff_azimuth
    return describe(robot) | {
        "gravity": np.array(robot.gravity),
        "tendon_stiffness": robot.of_tendons("stiffness"),
        "tendon_pretension": robot.of_tendons("pretension"),
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


#: What tells all of a rig, slowly; tendons that rub creep in long rests.
EXCITATION = Excitation(kinds=("pulls", "steps", "visits"), speed=0.05, rest=0.4)

#: The camera stands in the robot's frame, and nothing of the tip is out of place.
STAGES = ("tendons", "geometry", "statics", "dynamics", "network")

#: [s], of the commands to the servos and of the pictures.
PERIOD = 0.02


def record(
    twin: Twin | int | None,
    seed: int = 0,
    excitation: Excitation = EXCITATION,
    show: ProgressCallback | None = None,
) -> Recording:
    """Excite a twin as a real rig is, by its servos and its camera.

    Args:
        twin: See `RigEnv`.
        seed: Of the camera's noise.
        excitation: What to do.
        show: Shows how far it is, or None.

    Raises:
        RuntimeError: It could not be recorded to the end.
    """
    planned = plan(RIG, excitation, PERIOD)
    task = resting_task(RIG, planned.duration, "xy")
    env = RecordEpisodes(RigEnv(task, twin=twin, control_period=PERIOD, observe="all"))
    progress = None if show is None else lambda step: show("recording", step, len(planned.actions))
    stopped = excite(env, planned, excitation, seed, progress=progress)
    if stopped is not None:
        raise RuntimeError(f"the recording of a twin ended {stopped}")
    return env.recording


def identified(recording: Recording, seed: int = 0, **options: Any) -> Identification:
    """The rig that a recording tells; `seed` is of its networks, for more `options` see there."""
    return identify(recording, RIG, STAGES, validate=False, seed=seed, **options)


def parameters_of(found: Identification, twin: int | None = None) -> IdentifiedParameters:
    """What controllers of the rig know of one that was identified with its networks.

    Lengths that are commanded tell stiffness, damping and friction over the mass, which is taken
    as that of the nominal rig.

    Args:
        found: Of the rig.
        twin: Seed of the twin, None if it has none.

    Raises:
        ValueError: It was identified without visits.
    """
    if found.networks is None:
        raise ValueError("controllers of the rig need a rig that visited points: --kinds visits")
    robot, nominal = found.robot, found.believed
    beam = robot.youngs_modulus / nominal.youngs_modulus * nominal.head.mass / robot.head.mass
    turns = [
        np.angle(complex(*tendon.offset) / complex(*was.offset))
        for tendon, was in zip(robot.tendons, nominal.tendons, strict=True)
    ]
    lag = robot.drive.backlash / 2 + np.mean([t.friction / t.stiffness for t in robot.tendons])
    return IdentifiedParameters(
        network=found.networks.inverse,
        stiffness=PIECES_SOFTER * beam,
        turn=float(np.mean(turns)),
        damping=beam * robot.damping_time / nominal.damping_time,
        backlash=float(lag),
        twin=twin,
    )


def nominal_lengths(robot: RobotParams, points: ndarray, total: float | None = None) -> ndarray:
    """Lengths (n, 3) [m] that hold the output of a rig at points (n, 2) [m].

    Args:
        robot: The rig.
        points: Where its output is to be.
        total: Sum of the tensions [N] that chooses one of the many solutions, as in thesis sec.
            5.1. Unless given it is the least tensions that respect the pretension, S_red; these
            have kinks where another tendon becomes the loosest, which smooth networks round off.

    Raises:
        OutOfReachError: A point is out of reach.
        ValueError: The robot is no rig with three elastic tendons, or the sum is too small.
    """
    points = np.ascontiguousarray(points, float)
    servo, still = ServoConstraints(robot), np.zeros_like(points)
    y, _, _, reduced, _ = servo.motion(points, still, still)
    tension = servo.tendons.tension(reduced, total)
    return servo.tendons.pulled(tension, servo.curvature(y))


def train(request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Identified parameters of a twin, for the rig's controllers (thesis sec. 5.1)."""

    twin = request.settings.get("twin", 0)
    found = identified(record(twin, request.seed, show=show), request.seed, show=show)
    rig, errors = parameters_of(found, twin), found.networks.errors
    rig.save(request.path, RIG, {"seed": request.seed})
    return [
        ("twin", str(twin)),
        ("rms error, lengths of outputs", quantity_mm(errors["inverse"])),
        ("rms error, outputs of lengths", quantity_mm(errors["forward"])),
        ("bending stiffness over nominal", Quantity(rig.stiffness, ".3f")),
        ("bending damping over nominal", Quantity(rig.damping, ".3f")),
        ("turn of the tendons", f"{degrees(rig.turn):.2f} deg"),
        ("backlash of the tendons", quantity_mm(rig.backlash)),
    ]


#: What is known of rigs that visit points.
VISITING = Visiting(nominal_lengths, parameters_of)
