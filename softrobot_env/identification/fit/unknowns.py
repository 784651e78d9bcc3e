"""The unknown parameters of a robot, with prior spreads about its file's values.

Parameters are zero for the robot of the file. Each belongs to a stage that a user can switch off;
spreads are standard deviations of a prior, the uncertainty of a datasheet and of careful assembly.
Parameters that the data determine better do not depend on them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import radians
from typing import Literal

import numpy as np
from numpy import ndarray
from scipy.linalg import block_diag

from softrobot_env.recordings import Recording
from softrobot_env.robots import RobotParams

#: Kinds that make a robot lag behind its commands; a search must begin with nonzero values.
LAGS = ("tendon_friction", "backlash")

#: Kinds that few robots have, and which are used only if the data support them.
HOLDS, RUBS = "bending_friction", "friction_coefficient"

#: All kinds that a model includes unless they are known exactly.
FRICTIONS = (*LAGS, HOLDS, RUBS)

#: Coefficient of friction [1] of tendons that a search begins with unless the file knows one.
START_COEFFICIENT = 0.1

#: How the recording's frame may be rotated, beyond the uncertainty of careful assembly.
Turned = Literal["as said", "about the axis", "any way"]

_ANY = 3.0  # rad, of a turn that may be any
_BEND = 0.1  # rad, by which the zero of a servo may bend a robot
_HOLD = 0.06  # rad, by which friction of the backbone may keep a robot bent
_BACKLASH = 0.003  # half of a backlash that is usual, over the recorded range of commands

#: Stages in their order, and what they identify.
STAGES: dict[str, str] = {
    "frame": "frame of the recording and offsets of its markers",
    "tendons": "which column pulls which tendon, their angles and distances, scales of commands",
    "geometry": "curvature without load, anisotropy, direction of gravity",
    "statics": "Young's modulus, mass; stiffness, pretension and friction of tendons, backlash; "
    "friction of the backbone, or of tendons by tension, where the data ask for it",
    "dynamics": "damping, delay and friction, of a robot that was recorded in motion",
    "residual": "what physics leaves, learned near the data",
    "network": "networks of the statics of a rig that visited points (thesis sec. 3.2 and 5.1)",
}


@dataclass(frozen=True)
class Group:
    """Parameters of one kind.

    Attributes:
        name: Of the kind.
        stage: The stage that identifies them.
        labels: One for each.
        spread: Of the prior, in its unit: standard deviation of what each has for itself; of all
            of them or of each.
        unit: Of the numbers; "log" of factors exp(x), "share" of shares of one.
        common: Standard deviation of what all have in common.
    """

    name: str
    stage: str
    labels: tuple[str, ...]
    spread: float | tuple[float, ...]
    unit: str
    common: float = 0.0

    @property
    def prior(self) -> ndarray:
        """(k, k) covariance."""
        own = np.broadcast_to(np.array(self.spread, float), (len(self.labels),))
        return np.diag(own**2) + self.common**2


def groups(
    robot: RobotParams, recording: Recording, *, turned: Turned, spatial: bool, by_length: bool
) -> list[Group]:
    """The unknowns of a robot and a recording of it.

    Args:
        robot: The robot of the file.
        recording: Of this robot.
        turned: How the recording's axes may be rotated; with any orientation, any position is
            allowed too.
        spatial: Whether the robot leaves its plane.
        by_length: Whether the recording's commands are lengths.
    """
    names = robot.tendon_names
    sections = tuple(f"section {k + 1}" for k in range(len(robot.backbone.sections)))
    markers = [f"marker {k + 1}" for k in range(len(recording.header.marker))]
    axes, turns = ("x", "y", "z") if spatial else ("x", "z"), ("x", "y", "z") if spatial else ("y",)
    loose, tilt = (radians(2) if turned == "as said" else _ANY), radians(3)
    about = [loose if axis == "z" else _ANY if turned == "any way" else tilt for axis in turns]
    size = robot.length
    away = float(np.nanmax(np.abs(recording.markers), initial=size))
    shift = away if turned == "any way" else 0.03 * size
    found = [
        Group("frame_turn", "frame", turns, tuple(about), "rad"),
        Group("frame_shift", "frame", axes, shift, "m"),
        Group(
            "marker_offset",
            "frame",
            tuple(f"{m} {a}" for m in markers for a in axes),
            max(0.015 * size, 1e-3),
            "m",
        ),
        Group("tendon_radius", "tendons", names, 0.05, "log"),
    ]
    if spatial:
        found.append(Group("tendon_angle", "tendons", names, radians(8), "rad", radians(5)))
        bends = ("towards x", "towards y")
        found.append(Group("precurvature", "geometry", bends, 0.1 / size, "1/m"))
        ways = ("along x", "along the diagonal")
        found.append(Group("anisotropy", "geometry", ways, 0.05, "share"))
    if any(robot.gravity):
        tilts = ("about x", "about y") if spatial else ("about y",)
        found.append(Group("gravity_tilt", "geometry", tilts, radians(3), "rad"))
        found.append(Group("mass", "statics", ("all",), 0.4, "log"))
    found.append(Group("youngs_modulus", "statics", sections, 0.1, "log", 0.3))
    if by_length:
        found.append(Group("tendon_stiffness", "statics", names, 0.3, "log", 1.0))
        zero = _BEND * np.median(robot.of_tendons("farthest") * robot.of_tendons("stiffness"))
        usual = float(np.median(robot.of_tendons("pretension")))
        found.append(Group("pretension", "statics", names, zero, "N", usual + zero))
        found.append(Group("backlash", "statics", ("all",), 1.5, "log"))
    found.append(Group(HOLDS, "statics", sections, 0.4, "log", 2.0))
    found.append(Group("tendon_friction", "statics", names, 0.4, "log", 2.0))
    found.append(Group(RUBS, "statics", ("all",), 2.0, "log"))
    return found


def _typical_force(robot: RobotParams, travel: float, by_length: bool) -> float:
    """[N] that tendons bear, roughly: what half of the recorded range of commands takes."""
    if not by_length:
        return max(travel, 1e-6)
    stiff = np.median(robot.of_tendons("stiffness"))
    bend = 2 * float(robot.backbone.bending(np.array([robot.length / 2]))[0]) / robot.length
    arm = np.median(np.maximum(robot.of_tendons("farthest"), 1e-4))
    return float(travel / 2 * min(stiff, bend / arm**2))


def start_friction(robot: RobotParams, travel: float, by_length: bool) -> ndarray:
    """(n_tendons,) [N] that a search begins with: the file's, or a twentieth of usual forces."""
    least = 0.05 * _typical_force(robot, travel, by_length)
    return np.maximum(robot.of_tendons("friction"), least)


def start_bending_friction(robot: RobotParams) -> ndarray:
    """(n_sections,) [N m] that a search begins with: the file's, or what keeps a slight bend."""
    middle = np.array([robot.length / 2])
    usual = _HOLD * float(robot.backbone.bending(middle)[0]) / robot.length
    return np.array([s.bending_friction or usual for s in robot.backbone.sections])


def start_backlash(robot: RobotParams, travel: float) -> float:
    """[m], half of the backlash that a search begins with: the file's, or a share of the travel."""
    return max(robot.drive.backlash / 2, _BACKLASH * travel)


@dataclass(frozen=True)
class Fact:
    """Information about the parameters x from another source than the rows: weights @ x = value.

    Attributes:
        weights: (p,).
        value: Its own.
        deviation: Its standard deviation.
    """

    weights: ndarray
    value: float
    deviation: float


@dataclass(frozen=True)
class Unknowns:
    """Parameters in a row.

    Attributes:
        groups: Their kinds, in order.
        facts: What is known beside the file.
    """

    groups: tuple[Group, ...]
    facts: tuple[Fact, ...] = ()

    @cached_property
    def _believed(self) -> tuple[ndarray, ndarray]:
        """Mean (p,) and covariance (p, p) of the prior: the file's, and facts one by one."""
        covariance = block_diag(*(group.prior for group in self.groups))
        mean = np.zeros(len(covariance))
        for fact in self.facts:
            pull = covariance @ fact.weights
            gain = pull / (fact.weights @ pull + fact.deviation**2)
            mean = mean + gain * (fact.value - fact.weights @ mean)
            covariance = covariance - np.outer(gain, pull)
        return mean, covariance

    @property
    def mean(self) -> ndarray:
        """(p,) mean of the prior; zero is what the file says."""
        return self._believed[0]

    @property
    def prior(self) -> ndarray:
        """(p, p) covariance of the prior."""
        return self._believed[1]

    def common(self, name: str) -> ndarray:
        """(p,) weights of the mean of a kind's parameters; zeros if there is none."""
        weights, place = np.zeros(sum(len(g.labels) for g in self.groups)), self.place(name)
        if place is not None:
            weights[place] = 1 / (place.stop - place.start)
        return weights

    @property
    def spread(self) -> ndarray:
        """(p,) standard deviations of the prior."""
        return np.sqrt(np.diag(self.prior))

    @property
    def labels(self) -> list[str]:
        """(p,) labels."""
        return [f"{g.name}: {label}" for g in self.groups for label in g.labels]

    @property
    def moves_frame(self) -> ndarray:
        """(p,) bool, those that turn or shift the recording's frame."""
        names = ("frame_turn", "frame_shift")
        return np.concatenate([[g.name in names] * len(g.labels) for g in self.groups])

    def place(self, name: str) -> slice | None:
        """Where the parameters of a kind stand, None where there is none."""
        begin = 0
        for group in self.groups:
            end = begin + len(group.labels)
            if group.name == name:
                return slice(begin, end)
            begin = end
        return None

    def take(self, x: ndarray, name: str) -> ndarray:
        """The parameters of a kind, (1,) a zero if there is none."""
        place = self.place(name)
        return np.zeros(1, x.dtype) if place is None else x[place]

    def of(self, stages: Sequence[str]) -> ndarray:
        """(p,) bool, those that some stages find."""
        return np.concatenate([[g.stage in stages] * len(g.labels) for g in self.groups])
