"""Tasks: a robot, a reference for its tip, a duration, a start, and options."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from inspect import signature
from typing import Literal

import numpy as np

from softrobot_env.core.records import Name, Positive, check_fields
from softrobot_env.robots import RobotParams, as_number
from softrobot_env.robots.actuation import check_inputs, robot_inputs

from .trajectories import Trajectory

#: Longest episode [s]; the reference is sampled in advance.
LONGEST = 3600.0


@dataclass(frozen=True)
class Option:
    """An option of tasks, with its form in reports, labels and file names.

    Attributes:
        column: Of a row of a report.
        scale: Unit of labels per SI unit [1].
        unit: Unit in labels, empty for plain numbers.
    """

    column: str
    scale: float = 1.0
    unit: str = ""

    def text(self, value: float) -> str:
        """A value as text."""
        return f"{self.scale * value:g} {self.unit}".rstrip()


#: Options of all tasks, in the order of labels. The parameters of a task's maker define which of
#: them it has, and their defaults.
OPTIONS: dict[str, Option] = {
    "seed": Option("path_seed"),
    "step_width": Option("step_width", 1e3, "mm"),
    "radius": Option("radius", 1e3, "mm"),
    "speed": Option("speed", 1.0, "m/s"),
    "frequency": Option("frequency", 1.0, "f1"),
    "period": Option("period", 1.0, "s"),
    "hold": Option("hold", 1.0, "s"),
}


def labelled(name: str, options: Mapping[str, float | None]) -> str:
    """Label of a task with values of its options; None counts as not given.

    Options that only a user's task has come last, by their names.
    """
    out = [name]
    for option, value in (dict.fromkeys(OPTIONS) | {**options}).items():
        if value is not None:
            known = option in OPTIONS
            out.append(OPTIONS[option].text(value) if known else f"{option} {value:g}")
    return " ".join(out)


@dataclass(frozen=True)
class Task:
    """What a policy should do in an environment.

    Attributes:
        name: Key in the registry of tasks.
        robot: The nominal robot; what is simulated may be a variation or a twin of it.
        trajectory: Reference of the tip.
        duration: [s] of an episode.
        start_input: (n_inputs,), inputs of the robot (`robots.actuation`) in whose equilibrium the
            episode starts at rest: reduced ones [N], or lengths [m] pulled in.
        options: The options of the task, (name, value) each.
        axes: Coordinates of the tip that the reference defines: "xz" for a planar robot, "xyz" for
            a spatial one, or "xy" if its height follows from them.
        maker: The function that made it, to remake it with other options.
    """

    name: Name
    robot: RobotParams
    trajectory: Trajectory
    duration: Positive
    start_input: tuple[float, ...]
    options: tuple[tuple[str, float], ...] = ()
    axes: Literal["xz", "xy", "xyz"] = "xz"
    maker: Callable[..., "Task"] | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        check_fields(self, f"task {self.name!r}")
        inputs, planar = robot_inputs(self.robot), self.robot.moves_in_xz
        if inputs.n_inputs == 0 or len(self.start_input) != inputs.n_inputs:
            raise ValueError(
                f"task {self.name!r}: robot {self.robot.name!r} has {inputs.n_inputs} tendon "
                f"inputs, start_input {len(self.start_input)}; a task needs as many, and at least "
                "one"
            )
        if planar != (self.axes == "xz"):
            allowed = "xz" if planar else "xy or xyz"
            raise ValueError(
                f"task {self.name!r}: the tip of robot {self.robot.name!r} moves in "
                f"{'the x-z plane' if planar else 'space'}, axes must be {allowed}, got "
                f"{self.axes!r}"
            )
        check_inputs(inputs, np.array(self.start_input), f"task {self.name!r}: start_input")
        if not 0 < self.duration <= LONGEST:
            raise ValueError(
                f"task {self.name!r}: duration must lie in (0, {LONGEST:g}] s, got "
                f"{self.duration!r}"
            )

    def option(self, name: str) -> float | None:
        """Value of an option, None if the task has none of this name."""
        return dict(self.options).get(name)

    @property
    def step_width(self) -> float | None:
        """[m] of the step task, None for the others."""
        return self.option("step_width")

    @property
    def label(self) -> str:
        """Label with the options."""
        return labelled(self.name, dict(self.options))


#: Makes a task from values of its options; its parameters have their names and defaults.
Maker = Callable[..., Task]


def defaults(make: Maker) -> dict[str, float]:
    """Default values of a task's options, by name."""
    return {name: p.default for name, p in signature(make).parameters.items()}


def whole(seed: float) -> int:
    """A seed as a whole number.

    Raises:
        ValueError: It is not one, or negative.
    """
    number = as_number(seed)
    if number is None or number < 0 or number != int(number):
        raise ValueError(f"seed must be a whole number >= 0, got {seed!r}")
    return int(number)
