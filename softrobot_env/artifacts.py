"""Reading files of trained, identified and recorded things: arrays in npz, facts in json.

Every loader reads through here, so that a file that is damaged, incomplete or not finite is refused
by name before anything is computed from it.
"""

import json
from collections.abc import Collection
from hashlib import sha256
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from softrobot_env.paths import models_dir
from softrobot_env.robots import RobotParams


class Arrays(dict[str, np.ndarray]):
    """Arrays by name, out of a file; one that is missing is refused with the file's name.

    Attributes:
        path: The file.
    """

    def __init__(self, path: str | Path, values: dict[str, np.ndarray]) -> None:
        super().__init__(values)
        self.path = path

    def __missing__(self, name: str) -> NoReturn:
        raise ValueError(f"{self.path} lacks the array {name!r}; it has {', '.join(self)}")

    def check_finite(
        self, infinite: Collection[str] = (), unmeasured: Collection[str] = ()
    ) -> None:
        """Refuse numbers that are not finite.

        Args:
            infinite: Arrays that may hold infinity, but not NaN.
            unmeasured: Arrays that may hold both, where nothing was measured.

        Raises:
            ValueError: There are others; the message names file and array.
        """
        for name, array in self.items():
            if array.dtype.kind not in "fc" or name in unmeasured:
                continue
            bad = np.isnan(array) if name in infinite else ~np.isfinite(array)
            if bad.any():
                raise ValueError(
                    f"{self.path}: {bad.sum()} of {bad.size} numbers of the array {name!r} are "
                    "not finite"
                )

    def check_shape(self, name: str, shape: tuple[int | None, ...]) -> None:
        """Raise ValueError unless an array of numbers has a shape, None standing for any size."""
        array = self[name]
        fits = array.ndim == len(shape) and array.dtype.kind in "fiu"
        if not fits or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
            wanted = str(shape).replace("None", "n")
            raise ValueError(
                f"{self.path}: the array {name!r} must hold numbers and have shape {wanted}, got "
                f"{array.dtype} and {array.shape}"
            )


def read_arrays(path: str | Path) -> Arrays:
    """The arrays of an npz file, as they are.

    Raises:
        FileNotFoundError: No such file.
        ValueError: It is no npz file, damaged, or holds other things than arrays.
    """
    with Path(path).open("rb") as file:
        try:
            return Arrays(path, dict(np.load(file, allow_pickle=False)))
        except Exception as error:  # whatever zip, zlib and NumPy raise on damage
            raise ValueError(f"{path} is no npz file of arrays, or damaged") from error


def artifact_name(robot: RobotParams, policy: str) -> str:
    """Name of the file of what a policy has learned of a robot."""
    return f"{robot.name if robot.file is None else robot.file.stem}.{policy}.npz"


def find_artifact(robot: RobotParams, policy: str) -> Path:
    """What a policy has learned of a robot: beside the robot's file, or in the folder of models.

    Raises:
        ValueError: There is none; the message tells the command that makes it.
    """
    folders = [models_dir()] if robot.file is None else [robot.file.parent, models_dir()]
    for folder in folders:
        path = folder / artifact_name(robot, policy)
        if path.is_file():
            return path
    raise ValueError(
        f"{policy} has not been trained for robot {robot.name!r}: make "
        f"{artifact_name(robot, policy)} with `{train_command(robot, policy)}`"
    )


def train_command(robot: RobotParams, policy: str) -> str:
    """The command that trains a policy for a robot, where it will be looked for."""
    return f"softrobot train {policy} --robot {robot.name if robot.file is None else robot.file}"


def check_robot(data: Arrays, robot: RobotParams, policy: str) -> None:
    """Refuse what was learned of another robot.

    Raises:
        ValueError: The fingerprint is another; the message tells the command that trains anew.
    """
    if str(data["fingerprint"]) != str(fingerprint(robot)["fingerprint"]):
        raise ValueError(
            f"{data.path} was made for another robot than {robot.name!r} is now, "
            f"{str(data['robot'])!r}: make it anew with `{train_command(robot, policy)}`"
        )


def fingerprint(robot: RobotParams) -> dict[str, np.ndarray]:
    """All parameters of a robot, as one number, in what a file tells; the first is its name."""
    digest = sha256(repr(robot).encode()).hexdigest()
    return {"robot": np.array(robot.name), "fingerprint": np.array(digest)}


def read_facts(path: str | Path) -> Any:
    """What a json file tells.

    Raises:
        FileNotFoundError: No such file.
        ValueError: It is no json file, or holds a number that is not finite.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=_refuse)
    except ValueError as error:  # decoding errors are of this kind
        raise ValueError(f"{path}: {error}") from None


def _refuse(number: str) -> NoReturn:
    raise ValueError(f"{number} is no finite number")
