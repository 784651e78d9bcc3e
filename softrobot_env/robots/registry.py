"""The named robots, and what the package knows of each: examples that are files, and those of
plug-ins.
"""

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import replace as with_fields
from math import pi
from pathlib import Path
from typing import Any

from softrobot_env.core.files import assets_dir
from softrobot_env.core.registry import Registry, load_plugins

from .file import read_gripper, read_robot
from .parameters import Gripper, RobotParams

#: [m], pulled in by a full-scale action.
LENGTH_SCALE = 0.03

#: Speed [m/s] at which a servo winds: 0.16 s for 60 degrees (CHASERVO DS20) on a horn of 20 mm (S).
SERVO_SPEED = pi / 3 / 0.16 * 0.020

#: [s] between two pictures of the webcam of the rig (T).
CAMERA_PERIOD = 1 / 90

#: Pieces that a robot of one piece on a serial line is cut into: the first frequency of the thesis'
#: rig is then within 1 % of the beam's.
RIG_PIECES = 4


@dataclass(frozen=True)
class RobotEntry:
    """A named robot, and what it has that others have not; code by its path `module:name`.

    Attributes:
        robot: Its parameters.
        default: Whether commands take it where no robot is given.
        on_a_line: Whether it is the one behind a serial line.
        scene: Whether its scene is exported to `assets/`.
        chain: The robot whose chain of pieces stands and moves as these parameters say: laws know
            the robot by it, and it is simulated; the robot itself unless given.
        stiffer: [1], Young's modulus of `chain` over that of the robot.
        pieces: Of the simulated chain; the robot's own unless given.
        control_period: [s] of its environment; the usual one unless given.
        axes: Coordinates of the tip that its camera sees; all that its tasks have unless given.
        environment: Its class.
        twin: Seed of the twin that is simulated unless another one is asked for, and whose trained
            files come with the package; None where a robot is simulated as it should be.
        plain_files: Whether trained files have the name of the policy alone.
        named_by_tasks: Whether its tasks tell it in reports, without its name.
        task, policy: Shown unless another one is asked for.
        tasks: That "all" stands for, its usual one first; every one unless given.
        policies: Made for it: those that it is given where tasks have their robots; none unless
            given.
        teacher: Policy that is imitated unless another one is asked for. The gains of the usual
            one, made in a minute, track about as well as model predictive ones and need no further
            package.
        training: What trainings need of it, see `training.references.RobotTraining`.
        identified: Reads identified parameters, for policies that act on them (`identified`).
        reported: Row of an evaluation -> rows that the literature reports of its task.
    """

    robot: RobotParams
    default: bool = False
    on_a_line: bool = False
    scene: bool = False
    chain: RobotParams | None = None
    stiffer: float = 1.0
    pieces: int | None = None
    control_period: float | None = None
    axes: str | None = None
    environment: str = "softrobot_env.envs.tracking:TrackingEnv"
    twin: int | None = None
    plain_files: bool = False
    named_by_tasks: bool = False
    task: str = "circle"
    policy: str = "static"
    tasks: tuple[str, ...] | None = None
    policies: tuple[str, ...] = ()
    teacher: str = "lq_preview"
    training: str = "softrobot_env.training.references:RobotTraining"
    identified: str | None = None
    reported: str | None = None


#: Robots of assets/robots/, described by files as a user's own.
EXAMPLES = ("planar_finger", "silicone_rod", "hanging_trunk", "ftdcr_v4")

#: The finger of the gripper, a file as well.
FINGER = read_robot(assets_dir() / "robots" / "gripper_finger.toml")

#: What is known of the named robots.
ENTRIES: Registry[RobotEntry] = Registry(
    "robot",
    {FINGER.name: RobotEntry(FINGER)}
    | {name: RobotEntry(read_robot(assets_dir() / "robots" / f"{name}.toml")) for name in EXAMPLES},
)


class _Robots(Registry[RobotParams]):
    """The robots of `ENTRIES`."""

    def registered(self) -> dict[str, RobotParams]:
        """See `Registry`."""
        return {name: entry.robot for name, entry in ENTRIES.registered().items()}


#: The named robots.
ROBOTS: Registry[RobotParams] = _Robots("robot", {})


def entry_of(robot: RobotParams) -> RobotEntry:
    """What is known of a robot: its entry, or what holds for any that is not named."""
    load_plugins()
    entry = ENTRIES.registered().get(robot.name)
    return entry if entry is not None and entry.robot == robot else RobotEntry(robot)


def default_robot(on_a_line: bool = False) -> RobotParams:
    """The robot that commands take where none is given, or the one behind a serial line.

    Raises:
        ValueError: No robot is declared to be that.
    """
    known = ENTRIES.values()
    found = next((e.robot for e in known if (e.on_a_line if on_a_line else e.default)), None)
    if found is None:
        raise ValueError(f"give a robot: --robot FILE, or one of {', '.join(ENTRIES)}")
    return found


def usual_task(robot: RobotParams | None = None) -> str:
    """The first of a robot's own tasks; of the one behind a serial line unless given."""
    entry = entry_of(robot or default_robot(on_a_line=True))
    return (entry.tasks or (entry.task,))[0]


def register_entry(entry: RobotEntry, *, replace: bool = False) -> None:
    """Add a robot with what is known of it; errors as of `register_robot`."""
    ENTRIES.register(entry.robot.name, entry, replace)


def register_robot(
    robot: RobotParams | str | Path, name: str | None = None, *, replace: bool = False
) -> RobotParams:
    """Add a robot to the named ones; returns it, with its name.

    Args:
        robot: The robot, or a file that describes it.
        name: Its name; the robot's own unless given.
        replace: Whether it may take the place of another of this name.

    Raises:
        ValueError: The name is taken, or the file says what is not allowed.
        TypeError: Neither a robot nor a path.
        OSError: The file cannot be read.
    """
    if isinstance(robot, str | Path):
        robot = read_robot(robot)
    if not isinstance(robot, RobotParams):
        raise TypeError(f"a robot is a RobotParams or the path of a robot file, got {robot!r}")
    named = with_fields(robot, name=robot.name if name is None else name)
    register_entry(RobotEntry(named), replace=replace)
    return named


def find_robot(which: RobotParams | Path | str) -> RobotParams:
    """The robot of a name, or of a file: a path that ends in .toml; a robot is itself.

    Raises:
        ValueError: No such name, the message lists them; or the file says what is not allowed.
        OSError: The file cannot be read.
    """
    return which if isinstance(which, RobotParams) else _read_or_found(which, read_robot, ROBOTS)


def _read_or_found(which: Path | str, read: Callable[[str], Any], known: Registry) -> Any:
    if not isinstance(which, Path | str):
        raise ValueError(f"a {known.kind} is given by its name or its file, got {which!r}")
    is_file = isinstance(which, Path) or which.endswith(".toml")
    return read(str(which)) if is_file else known.find(which)


#: The named grippers, described by files as a user's own.
GRIPPERS = Registry("gripper", {"gripper": read_gripper(assets_dir() / "grippers/gripper.toml")})


def find_gripper(which: Gripper | Path | str) -> Gripper:
    """The gripper of a name, or of a file, or itself; errors as of `find_robot`."""
    return which if isinstance(which, Gripper) else _read_or_found(which, read_gripper, GRIPPERS)
