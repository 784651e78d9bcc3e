"""Moving mounts: the base of a robot follows a motion that is prescribed.

A mount is a body with slides along the world's axes and hinges about them, on which the robot
stands. Its joints have so much more inertia (MuJoCo's armature, `HEAVY` times the robot's) that
what the robot does moves them by less than rounding in a share, and one drive each, whose control
is the joint's acceleration. So the robot feels all inertial forces of its base, those of rotation
too, with nothing approximated, and no solver has to hold a constraint.

Our own integrator lets controls change linearly from one timestep to the next. The acceleration of
a cubic spline does just that: the mount runs along the spline through the wanted positions at the
ends of the timesteps, and its rows of order three and more make no error in it. MuJoCo's
integrators hold a control for a timestep, so that the mount would drift: they are refused.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.core.records import Vector3, check_fields
from softrobot_env.robots import RobotParams

from .chain import set_inertia

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

#: Inertia of a mount over that of its robot [1].
HEAVY = 1e9

MOUNT_BODY = "mount"

#: Directions in which a mount can move [m] and turn [rad], along and about the world's axes.
SLIDES, TURNS = ("x", "y", "z"), ("turn_x", "turn_y", "turn_z")

#: Motion of a mount: of the time [s], (k,) [m] and [rad] in the order of its directions.
Prescribed = Callable[[float], Sequence[float]]

_SMALL = 1e-12  # kg and kg m2: MuJoCo takes no body without mass


@dataclass(frozen=True)
class Mount:
    """A base that moves.

    Attributes:
        directions: Out of `SLIDES` and then `TURNS`, in that order. Each turn is about an axis that
            those before it have turned along.
        pivot: (3,) [m] about which it turns; where the robot is clamped unless given.
    """

    directions: tuple[str, ...]
    pivot: Vector3 | None = None

    def __post_init__(self) -> None:
        check_fields(self, "mount")
        known = (*SLIDES, *TURNS)
        if not self.directions or [d for d in known if d in self.directions] != [*self.directions]:
            raise ValueError(
                f"directions of a mount must be some of {', '.join(known)}, in this order and each "
                f"at most once, got {', '.join(self.directions) or 'none'}"
            )

    @property
    def turns(self) -> bool:
        """Whether it does not slide only."""
        return bool(set(TURNS) & set(self.directions))

    @staticmethod
    def axis(direction: str) -> ndarray:
        """(3,) along or about which a direction is, in the world."""
        return np.eye(3)[(TURNS if direction in TURNS else SLIDES).index(direction)]


def add_mount(
    spec: mujoco.MjSpec, prefix: str, mount: Mount, robot: RobotParams
) -> mujoco.MjsFrame:
    """Add a mount, named with a prefix, to a spec; returns the frame to attach the robot to.

    At rest the frame's axes are the world's.
    """
    clamp = robot.clamp.position
    pivot = np.array(clamp if mount.pivot is None else mount.pivot, float)
    body = spec.worldbody.add_body(name=prefix + MOUNT_BODY, pos=pivot)
    set_inertia(body, _SMALL, 0, [_SMALL] * 3)
    mass = robot.mass + sum(d.mass for d in robot.discs) + (robot.head.mass if robot.head else 0.0)
    reach = robot.reach + float(np.linalg.norm(pivot - clamp))
    for direction in mount.directions:
        turn = direction in TURNS
        kind = mujoco.mjtJoint.mjJNT_HINGE if turn else mujoco.mjtJoint.mjJNT_SLIDE
        joint = body.add_joint(name=f"{prefix}{MOUNT_BODY}_{direction}", type=kind)
        joint.axis = mount.axis(direction)
        joint.armature = HEAVY * mass * (reach**2 if turn else 1.0)
    return body.add_frame(pos=-pivot)


def add_drives(spec: mujoco.MjSpec, prefix: str, mount: Mount) -> None:
    """Add the drives of a mount, after those of all robots."""
    for direction in mount.directions:
        joint = spec.joint(f"{prefix}{MOUNT_BODY}_{direction}")
        drive = spec.add_actuator(
            name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        drive.gear = [joint.armature, 0, 0, 0, 0, 0]
        drive.set_to_motor()


def followed(
    mount: Mount, motion: Prescribed, duration: float, timestep: float, accuracy: float
) -> "CubicSpline":
    """The spline (k,) of the time [s] along which a mount runs.

    Args:
        mount: The mount.
        motion: What it shall follow.
        duration, timestep: [s].
        accuracy: [m] or [rad], how far off it may be between the timesteps.

    Raises:
        ValueError: The motion does not fit the mount, is not finite, or changes too fast.
    """
    from scipy.interpolate import CubicSpline  # takes time to load

    count = len(mount.directions)
    knots = timestep * np.arange(max(round(duration / timestep), 3) + 1)

    def at(times: ndarray) -> ndarray:
        values = [np.atleast_1d(np.asarray(motion(t), float)) for t in times.tolist()]
        if any(x.shape != (count,) or not np.all(np.isfinite(x)) for x in values):
            raise ValueError(
                f"the motion of a mount must be finite numbers along {', '.join(mount.directions)}"
            )
        return np.stack(values)

    spline, middles = CubicSpline(knots, at(knots)), (knots[1:] + knots[:-1]) / 2
    off = float(np.abs(spline(middles) - at(middles)).max())
    if off > accuracy:
        raise ValueError(
            f"the motion of a mount changes too fast for a timestep of {timestep:g} s: between two "
            f"it is {off:.3g} m (or rad) off, {accuracy:.3g} are wanted; give a smaller timestep"
        )
    return spline
