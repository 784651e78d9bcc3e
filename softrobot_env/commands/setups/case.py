"""Cases, and what the robots that they run on have in common."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol

from softrobot_env.evaluation.labels import option_columns, rig_label, task_label
from softrobot_env.interfaces import Policy
from softrobot_env.tasks import Task

if TYPE_CHECKING:
    import gymnasium


@dataclass(frozen=True)
class Case:
    """One episode to run.

    Attributes:
        task: The task.
        policy: Name of the policy.
        variation: What differs from the nominal arm.
        twin: Seed of the rig's twin; None for an ideal rig, and for the arm.
    """

    task: Task
    policy: str
    variation: dict[str, float] = field(default_factory=dict)
    twin: int | None = None

    @property
    def columns(self) -> dict[str, Any]:
        """What a row of the report says of task and rig."""
        return {
            "task": self.task.name,
            **option_columns(dict(self.task.options)),
            "twin": self.twin,
        }


class Setup(Protocol):
    """Robots of one kind.

    Attributes:
        tasks: Names of the tasks it can be given.
        policies: Names of the policies that can drive it.
        default_policy: The one to show.
        plant: What moves, as reports say it.
        feedback: What policies measure; None where they measure nothing.
    """

    tasks: tuple[str, ...]
    policies: tuple[str, ...]
    default_policy: str
    plant: str
    feedback: str | None

    def twins(self) -> list[int | None]:
        """Rigs to run every case on."""

    def check(self, cases: list[Case]) -> None:
        """Refuse what an environment would refuse in a later episode, and what no case uses.

        Raises:
            ValueError: The message names what is allowed.
        """

    def environment(self, case: Case, **drawing: Any) -> "gymnasium.Env":
        """Environment for a case, with all observables; `drawing` is how to render."""

    def policy(self, case: Case, control_period: float) -> Policy:
        """The policy of a case, deciding every `control_period` [s]."""

    def learnt_of(self, case: Case) -> str | None:
        """The rig that the policy of a case has learnt of, for people; None if of none."""

    def reset_options(self, case: Case) -> dict[str, Any]:
        """Options of `reset` for an evaluated case."""


def case_label(case: Case, setup: Setup) -> str:
    """Task, rig and policy for people."""
    rig_name = rig_label(case.columns | {"plant": setup.plant})
    return ", ".join(filter(None, (task_label(case.columns), rig_name, case.policy)))


def setup_of(task: str, setups: tuple[Setup, ...]) -> Setup:
    """The setup that a task is for."""
    return next(setup for setup in setups if task in setup.tasks)
