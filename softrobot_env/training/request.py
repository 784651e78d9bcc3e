"""What is asked of a training, what it is, and what it tells at its end."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any

from softrobot_env.core.extras import install_command
from softrobot_env.core.interfaces import ProgressCallback
from softrobot_env.core.registry import VARIANTS, load
from softrobot_env.robots import RobotParams
from softrobot_env.robots.artifacts import artifact_folder, artifact_name

#: What the backend "warp" simulates with.
WARP = "mujoco_warp"

#: Policies that learn by reward: algorithm, and whether robots and disturbances are sampled.
LEARNERS = {name: (name, False) for name in ("ppo", "sac", "td3")} | {
    f"{name}_randomized": (name, True) for name in ("ppo", "sac")
}


@dataclass(frozen=True)
class Quantity:
    """A measured number, which several trainings can be compared by.

    Attributes:
        value: In SI units; None where there is none.
        form: Format of the number.
        unit: That it is shown in, see `rendering.tables.FACTORS`; others have the factor 1.
    """

    value: float | None
    form: str
    unit: str = ""

    def __str__(self) -> str:
        from softrobot_env.rendering.tables import number

        return f"{number(self.value, self.form, self.unit)} {self.unit}".strip()


def quantity_mm(length: float) -> Quantity:
    """A length [m], shown in mm."""
    return Quantity(float(length), ".3f", "mm")


#: What a training found, as pairs of a name and its value, measured or a text for people.
Metrics = list[tuple[str, "str | Quantity"]]


@dataclass(frozen=True)
class TrainingRequest:
    """What is asked of a training.

    Attributes:
        robot: To train for.
        path: File to write.
        seed: Of everything random.
        settings: Values of the training's own options, those alone that are given.
        near: Folder where what it builds on is looked for first; that of the file unless given.
        report: Called with the learning curve after each check of a reinforcement learning.
    """

    robot: RobotParams
    path: Path
    seed: int = 0
    settings: Mapping[str, Any] = field(default_factory=dict)
    near: Path | None = None
    report: Callable[[list[dict[str, float]]], None] | None = None

    @property
    def folder(self) -> Path:
        """Where what it builds on is looked for first."""
        return self.near or self.path.parent


#: Trains as requested, writes the file and returns what it found.
Train = Callable[[TrainingRequest, ProgressCallback], Metrics]


@dataclass(frozen=True)
class Training:
    """How to make an artifact.

    Attributes:
        policy: That acts on it, by name.
        how: Trains, or the path of what does; a robot may have a variant, "training POLICY".
        options: Names of the settings that it takes.
        packages: That it needs beyond the package's own, of the extras `rl`, `mpc` and `gpu`.
        robot: The only robot it is of, None of any.
        also: Further packages that it needs for some robots and settings.
        is_random: Whether anything in it is random, so that seeds differ.
    """

    policy: str
    how: Train | str
    options: tuple[str, ...] = ()
    packages: tuple[str, ...] = ()
    robot: RobotParams | None = None
    also: Callable[[RobotParams, Mapping[str, Any]], tuple[str, ...]] = lambda robot, settings: ()
    is_random: bool = True

    def run(self, request: TrainingRequest, show: ProgressCallback) -> Metrics:
        """Train as requested, write the file and return what was found."""
        how = VARIANTS.find(f"training {self.policy}", request.robot) or self.how
        return (load(how) if isinstance(how, str) else how)(request, show)

    def check(self, robot: RobotParams, settings: Mapping[str, Any] = MappingProxyType({})) -> None:
        """Say what is missing before any work is done.

        Raises:
            ValueError: It is not of this robot.
            ImportError: A package is missing; says what to install.
        """
        if self.robot is not None and robot != self.robot:
            raise ValueError(
                f"{self.policy} is trained for the robot {self.robot.name!r} alone, not for "
                f"{robot.name!r}"
            )
        packages = (*self.packages, *self.also(robot, settings))
        missing = [package for package in packages if find_spec(package) is None]
        if missing:
            extras = ("rl", "mpc", *(("gpu",) if WARP in packages else ()))
            raise ImportError(
                f"{self.policy} needs {', '.join(missing)}: {install_command(*extras)}"
            )


def file_of(robot: RobotParams, policy: str, folder: Path | None = None) -> Path:
    """The file that a training writes: where policies look, unless a folder is given."""
    return (folder or artifact_folder(robot)) / artifact_name(robot, policy)


def curve_file(path: Path) -> Path:
    """Where a reinforcement learning that writes to a file writes its learning curve."""
    return path.with_name(f"{path.stem}_curve.json")
