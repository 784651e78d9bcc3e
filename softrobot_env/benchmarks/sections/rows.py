"""Rows of the study of sections: a robot, a model, a resolution."""

from dataclasses import dataclass

from softrobot_env.benchmarks.records import Record

#: Largest errors at the default resolution: tip over length, and strains over the largest of them.
GOAL = 0.005


@dataclass(frozen=True)
class Row(Record):
    """A robot's equilibrium under tensions with one model of some resolution.

    Attributes:
        case: Name of the robot, see `cases.CASES`.
        model: "chain", "pcc" or "cosserat".
        pieces: In total; sections have equally many.
        default: Whether that is the model's own choice for the robot.
        n: Number of its coordinates.
        error: [m], distance of the tip from the exact one.
        error_share: Over the length [1].
        curvature_error: Of the mean bending strains of thirds of sections, their largest error over
            the largest strain of the robot [1].
        twist_error: The same of torsion.
        equilibrium_time: [s] to find it, from the straight pose.
        time_per_second: Run time over simulated time of the motion there [1]; None for models too
            large to be stepped in reasonable time.
        failure: Why there is no result; None otherwise.
    """

    case: str
    model: str
    pieces: int
    default: bool
    n: int | None = None
    error: float | None = None
    error_share: float | None = None
    curvature_error: float | None = None
    twist_error: float | None = None
    equilibrium_time: float | None = None
    time_per_second: float | None = None
    failure: str | None = None

    @property
    def good(self) -> bool:
        """Whether all errors are within `GOAL`."""
        errors = (self.error_share, self.curvature_error, self.twist_error)
        return None not in errors and max(errors) <= GOAL
