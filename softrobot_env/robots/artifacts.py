"""What was learned of a robot: where its files are, and that they are of this robot."""

import json
from dataclasses import MISSING, Field, fields, is_dataclass, replace
from hashlib import sha256
from numbers import Real
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy import ndarray

from softrobot_env.core.artifacts import Arrays, read_arrays
from softrobot_env.core.files import assets_dir, file_name, models_dir

from .file import read_robot
from .parameters import RobotParams
from .registry import ROBOTS, default_robot, entry_of

#: Where trainings write what is not beside a robot's file.
OUT = Path("out")


def artifact_name(robot: RobotParams, policy: str) -> str:
    """Name of the file of what a policy has learned of a robot."""
    if robot.file is None and entry_of(robot).plain_files:
        return file_name(f"{policy}.npz")
    return file_name(f"{robot.name if robot.file is None else robot.file.stem}.{policy}.npz")


def artifact_folder(robot: RobotParams) -> Path:
    """Where what is learned of a robot is written: beside its file, else in that of models."""
    return models_dir() if robot.file is None else robot.file.parent


def training_folder(robot: RobotParams) -> Path:
    """Where a training writes unless a file is given: beside the file of a robot of one's own, else
    in `out`, so that it replaces nothing that comes with the package."""
    own = robot.file is not None and assets_dir().resolve() not in robot.file.resolve().parents
    return artifact_folder(robot) if own else OUT


def find_artifact(robot: RobotParams, policy: str) -> Path:
    """What a policy has learned of a robot: beside the robot's file, in the folder of models, where
    trainings write, or what is shipped for the thesis' robots, which other robots are refused when
    it is read.

    Raises:
        ValueError: There is none; the message tells the command that makes it.
    """
    found = looked_up(robot, policy) or models_dir() / f"{policy}.npz"
    if not found.is_file():
        raise ValueError(_untrained(robot, policy))
    return found


def looked_up(robot: RobotParams, policy: str) -> Path | None:
    """What was learned of a robot by its name, which policies act on; None if there is nothing."""
    folders = artifact_folder(robot), models_dir(), training_folder(robot)
    places = [folder / artifact_name(robot, policy) for folder in folders]
    return next((path for path in places if path.is_file()), None)


def train_command(robot: RobotParams, policy: str) -> str:
    """The command that trains a policy for a robot, where it will be looked for."""
    return f"softrobot train {policy} --robot {_called(robot) or robot.name + '_changed.toml'}"


def _called(robot: RobotParams) -> str | None:
    """What a command knows a robot by; None of one that has changed since it was named or read."""
    named = ROBOTS.get(robot.name)
    if named == robot and named.file == robot.file:
        return robot.name
    read = robot.file is not None and robot.file.is_file() and read_robot(robot.file)
    return str(robot.file) if read == robot else None


def refuse_artifact(path: str | Path, of: str, robot: RobotParams, policy: str) -> NoReturn:
    """Raise ValueError for what was learned of another robot, with the command that trains."""
    raise ValueError(
        f"{_untrained(robot, policy)} ({path} was trained for {of!r} with other parameters)"
    )


def _untrained(robot: RobotParams, policy: str) -> str:
    text = f"{policy} has not been trained for robot {robot.name!r} as it is"
    if _called(robot) is None:
        text = f"{text}, which has no file: write it by `robots.write_robot` to read it from there"
    return f"{text}: train by `{train_command(robot, policy)}`"


def read_artifact(robot: RobotParams, policy: str, path: str | Path | None = None) -> Arrays:
    """The arrays of a policy's file; found unless given, see `find_artifact`.

    Raises:
        FileNotFoundError: No such file.
        ValueError: The file is damaged, of another robot or of none; the message tells the command
            that trains.
    """
    data = read_arrays(find_artifact(robot, policy) if path is None else path)
    if str(data.get("fingerprint")) != str(fingerprint(robot)["fingerprint"]):
        of = data.get("robot")
        known = of is not None and of.ndim == 0  # the first files tell no robot
        refuse_artifact(data.path, str(of) if known else default_robot().name, robot, policy)
    return data


def fingerprint(robot: RobotParams) -> dict[str, ndarray]:
    """All parameters of a robot but its name, as one number, in what a file tells; with its name.

    Parameters that are as they are unless given do not count, so that a later version, whose
    robots have more of them, knows the robot again; nor does who chose its pieces.
    """
    plain = replace(robot, name="robot", adaptive_pieces=False)
    text = json.dumps(_as_data(plain), sort_keys=True)
    digest = sha256(text.encode()).hexdigest()
    return {"robot": np.array(robot.name), "fingerprint": np.array(digest)}


def _as_data(value: Any) -> Any:
    """A parameter as json tells it; equal ones alike, whatever type their numbers have."""
    if is_dataclass(value):
        named = {f.name: (f, getattr(value, f.name)) for f in fields(value) if f.compare}
        changed = {n: _as_data(v) for n, (f, v) in named.items() if not _is_default(f, v)}
        return {"": type(value).__name__, **changed}
    if isinstance(value, tuple | list | ndarray):
        return [_as_data(entry) for entry in value]
    return float(value) + 0.0 if isinstance(value, Real) else value


def _is_default(field: Field, value: Any) -> bool:
    default = field.default if field.default_factory is MISSING else field.default_factory()
    return default is not MISSING and bool(np.all(default == value))
