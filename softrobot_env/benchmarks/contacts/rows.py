"""The rows of the contact study: cells of a grid, and checks against exact solutions."""

from dataclasses import dataclass

from softrobot_env.benchmarks.records import Record
from softrobot_env.benchmarks.verdicts import Verdict

#: Share of the length within which all that moves is accurate.
ACCURATE_SHARE = 0.01


@dataclass(frozen=True)
class Cell(Record):
    """A scene with one stiffness, friction and timestep.

    Attributes:
        scene: Key of `benchmarks.contacts.cases.CASES`.
        stiffness_ratio: Stiffness of the skin over that of the robot's material [1].
        stiffness: [N/m2].
        friction: Coefficient [1].
        steps_ratio: Timestep over the rule's [1].
        timestep: [s].
        verdict: What became of it.
        why: What was refused or failed; None otherwise.
        warning: What a `TimestepWarning` said.
        error: [m], largest distance of the tip or a free object from the refined run.
        error_share: Over the robot's length [1].
        uncertainty: [m], the same between the two finest runs.
        wall_time: [s] of the run.
        duration: [s] simulated.
        most_touches: Most contacts at the end of a control period.
    """

    scene: str
    stiffness_ratio: float
    stiffness: float
    friction: float
    steps_ratio: int
    timestep: float
    verdict: Verdict
    why: str | None
    warning: str | None
    error: float | None
    error_share: float | None
    uncertainty: float | None
    wall_time: float | None
    duration: float
    most_touches: int | None


@dataclass(frozen=True)
class Check(Record):
    """A rod at rest on something against an exact solution.

    Attributes:
        case: Key of `benchmarks.contacts.exact.CHECKS`.
        pieces: Pieces of the chain.
        stiffness: [N/m2], of the skin.
        timestep: [s], with which it came to rest.
        force: [N], size of the sum of all contact forces on the rod.
        force_error: Distance from the exact sum, over its size [1].
        pressed_error: Error of the sum of the forces' sizes, over it [1].
        tip_error: Distance of the tips over the length [1]; None where only forces are exact.
        wall_time: [s] until it came to rest.
    """

    case: str
    pieces: int
    stiffness: float
    timestep: float
    force: float
    force_error: float
    pressed_error: float
    tip_error: float | None
    wall_time: float
