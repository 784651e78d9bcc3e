"""Tasks: a robot, a reference trajectory, a duration and a start posture (audit sec. 4)."""

from collections.abc import Callable
from dataclasses import dataclass

from softrobot_env.robots import ARM, RobotParams
from softrobot_env.tendon_map import TendonMap
from softrobot_env.trajectories import CurveSweep, EqualForceCurve, Polyline, Step, Trajectory

#: Longest episode [s]; its reference is sampled beforehand.
LONGEST = 3600.0


@dataclass(frozen=True)
class Task:
    """What an environment asks of a policy.

    Attributes:
        name: Key in `TASKS`.
        robot: The robot.
        trajectory: Reference of the tip.
        duration: [s] of an episode.
        start_input: (n_inputs,) [N], reduced tendon inputs in whose equilibrium the episode
            starts at rest.
        step_width: [m] of the step task, None for the others.
    """

    name: str
    robot: RobotParams
    trajectory: Trajectory
    duration: float
    start_input: tuple[float, ...]
    step_width: float | None = None

    def __post_init__(self) -> None:
        inputs = TendonMap(self.robot).n_inputs
        if inputs == 0 or len(self.start_input) != inputs:
            raise ValueError(
                f"task {self.name!r}: robot {self.robot.name!r} has {inputs} tendon inputs, "
                f"start_input {len(self.start_input)}; a task needs as many, and at least one"
            )
        if not 0 < self.duration <= LONGEST:
            raise ValueError(
                f"task {self.name!r}: duration must lie in (0, {LONGEST:g}] s, got "
                f"{self.duration!r}"
            )

    @property
    def label(self) -> str:
        """Name for people, with the step width in millimetres."""
        return self.name if self.step_width is None else f"{self.name} {1e3 * self.step_width:g} mm"


#: Start of the step task on the equal-force curve.
_STEP_START = 0.6

#: Reduced input [N] of least norm that holds the arm's tip at the L-shape's start; a test holds
#: it to the constant-curvature statics.
_LSHAPE_START = (5.37167978, 7.43194333, 7.85705717)


def equal_input(robot: RobotParams, a: float) -> tuple[float, ...]:
    """Equal reduced inputs [N] that bend the arm to parameter a of its equal-force curve."""
    force = a * robot.bending_stiffness / abs(robot.tendons[0].offset[0])
    return (force,) * (len(robot.tendons) // 2)


def _step(step_width: float = 0.05) -> Task:
    curve = EqualForceCurve(ARM.length)
    target = curve.parameter_at_distance(_STEP_START, step_width)
    trajectory = Step(
        start=tuple(curve.derivative(_STEP_START, 0)), target=tuple(curve.derivative(target, 0))
    )
    return Task("step", ARM, trajectory, 5.0, equal_input(ARM, _STEP_START), step_width)


def _swing() -> Task:
    sweep = CurveSweep(EqualForceCurve(ARM.length), half_length=0.5, speed=0.1)
    return Task("swing", ARM, sweep, 15.0, equal_input(ARM, sweep.start_parameter))


def _lshape() -> Task:
    corners = ((0.24, 0.0, 0.42), (0.24, 0.0, 0.30), (0.35, 0.0, 0.30))
    return Task("lshape", ARM, Polyline(corners, (0.0, 5.0, 10.0)), 15.0, _LSHAPE_START)


TASKS: dict[str, Callable[..., Task]] = {"step": _step, "swing": _swing, "lshape": _lshape}

#: Step widths [m] of Tabs. 6.2 to 6.4.
STEP_WIDTHS = (0.05, 0.1, 0.2)


def make_task(name: str, step_width: float | None = None) -> Task:
    """Build a task by name.

    Args:
        name: One of `TASKS`.
        step_width: [m], for the step task only; 0.05 unless given.

    Raises:
        ValueError: Unknown name, a step width for another task, or one out of reach.
    """
    if name not in TASKS:
        raise ValueError(f"unknown task {name!r}; choose from {', '.join(TASKS)}")
    if step_width is None:
        return TASKS[name]()
    if name != "step":
        raise ValueError(f"step_width applies to the step task only, not to {name!r}")
    return _step(float(step_width))
