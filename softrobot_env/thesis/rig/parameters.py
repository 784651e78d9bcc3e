"""Twins of the rig, recorded and identified for its controllers."""

from math import degrees
from typing import Any

import numpy as np

from softrobot_env.core.interfaces import ProgressCallback
from softrobot_env.envs.recording import RecordEpisodes
from softrobot_env.identification.excitation import Excitation, excite, plan, resting_task
from softrobot_env.identification.fit.path import Identification, identify
from softrobot_env.identification.visits import Visiting
from softrobot_env.recordings import Recording
from softrobot_env.robots import RobotParams
from softrobot_env.robots.twin import Twin
from softrobot_env.thesis.envs import RigEnv
from softrobot_env.thesis.rig.identified import IdentifiedParameters
from softrobot_env.thesis.rig.inverse import PIECES_SOFTER
from softrobot_env.thesis.rig.servo_constraints import ServoConstraints
from softrobot_env.thesis.robots import RIG
from softrobot_env.training.registry import quantity_mm
from softrobot_env.training.request import Metrics, Quantity, TrainingRequest

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
        show: Told how far it is, or None.

    Raises:
        RuntimeError: It could not be recorded to the end.
    """
    planned = plan(RIG, excitation, PERIOD)
    task = resting_task(RIG, planned.duration, "xy")
    env = RecordEpisodes(RigEnv(task, twin=twin, control_period=PERIOD, observe="all"))
    told = None if show is None else lambda step: show("recording", step, len(planned.actions))
    stopped = excite(env, planned, excitation, seed, progress=told)
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


def nominal_lengths(
    robot: RobotParams, points: np.ndarray, total: float | None = None
) -> np.ndarray:
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
    still = np.zeros_like(points)
    servo = ServoConstraints(robot)
    inverse = servo.plan(points, still, still)
    if total is None:
        return inverse.pulled
    tension = servo.tendons.tension(inverse.reduced, total)
    return servo.tendons.pulled(tension, servo.curvature(inverse.y))


def train(order: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Identified parameters of a twin, for the rig's controllers (thesis sec. 5.1)."""

    twin = order.settings.get("twin", 0)
    found = identified(record(twin, order.seed, show=show), order.seed, show=show)
    rig, errors = parameters_of(found, twin), found.networks.errors
    rig.save(order.path, RIG, {"seed": order.seed})
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
