"""What policies of the test rig have learnt, as commands are given it."""

from pathlib import Path
from typing import TYPE_CHECKING
from zipfile import BadZipFile, is_zipfile

from softrobot_env.control.registry import RIG_POLICIES
from softrobot_env.robots import RIG

if TYPE_CHECKING:
    from softrobot_env.control.rig.identified import IdentifiedParameters


def learns(policy: str) -> bool:
    """Whether a policy of the rig uses what was learnt of one."""
    return RIG_POLICIES[policy].takes("learnt")


def check_learnt(path: Path | None, policies: list[str]) -> None:
    """Refuse a file that none of the policies uses.

    Raises:
        ValueError: The message names the policies that use one.
    """
    if path is not None and not any(map(learns, policies)):
        able = ", ".join(filter(learns, RIG_POLICIES))
        raise ValueError(f"--learnt: only with the policies {able}")


def load_learnt(path: Path | None) -> "IdentifiedParameters":
    """What was learnt of a rig.

    Args:
        path: A file of `softrobot train rig_nn`; the one shipped, of twin 0, unless given.

    Raises:
        FileNotFoundError: No such file.
        ValueError: It is another kind of file, belongs to another robot or lacks something.
    """
    from softrobot_env.control.rig.identified import IdentifiedParameters

    if path is None:
        return IdentifiedParameters.load(RIG)
    strange = f"{path} is not a file of `softrobot train rig_nn`"
    if path.is_file() and not is_zipfile(path):
        raise ValueError(strange)
    try:
        return IdentifiedParameters.load(RIG, path)
    except (KeyError, BadZipFile) as error:
        raise ValueError(strange) from error
