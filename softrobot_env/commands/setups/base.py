"""What the robots that commands can be given have in common."""

import argparse
from typing import TYPE_CHECKING, Any, ClassVar

from softrobot_env.evaluation.runner import Case

if TYPE_CHECKING:
    import gymnasium


class Setup:
    """Robots of one kind, as the arguments of a command describe them.

    Attributes:
        tasks: Names of the tasks it can be given.
        policies: Names of the policies that can drive it.
        default_policy: The one to show.
    """

    tasks: ClassVar[tuple[str, ...]]
    policies: ClassVar[tuple[str, ...]]
    default_policy: ClassVar[str]

    def __init__(self, args: argparse.Namespace) -> None:
        self._args = args

    def twins(self) -> list[int | None]:
        """Rigs to run every case on."""
        return [None]

    def complete(self, case: Case) -> Case:
        """A case of task, policy, variation and twin with all else that the arguments say of it.

        Raises:
            ValueError, FileNotFoundError: An argument that does not fit; the message says why.
        """
        raise NotImplementedError

    def check(self, cases: list[Case]) -> None:
        """Refuse what an environment would refuse in a later episode, and what no case uses.

        Raises:
            ValueError: The message names what is allowed.
        """
        raise NotImplementedError

    def environment(self, case: Case, **drawing: Any) -> "gymnasium.Env":
        """Environment for a case, with all observables; `drawing` is how to render."""
        return case.environment(**drawing)


def setup_of(task: str, setups: tuple[Setup, ...]) -> Setup:
    """The setup that a task is for."""
    return next(setup for setup in setups if task in setup.tasks)
