"""The robots that commands can be given, as their arguments describe them."""

import argparse
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.commands.arguments import plant_options, scene_options
from softrobot_env.control.registry import FEEDBACKS, POLICIES, RIG_POLICIES
from softrobot_env.envs.disturbances import split
from softrobot_env.envs.tracking import DEFAULT_PERIOD
from softrobot_env.evaluation.labels import REAL, VIRTUAL
from softrobot_env.evaluation.runner import Case, acts_on_identified
from softrobot_env.robots import RIG
from softrobot_env.tasks import ALL_TASKS, RIG_TASKS

if TYPE_CHECKING:
    from softrobot_env.control.rig.identified import IdentifiedParameters

#: What --env can be: simulated, or over a serial line.
SIMULATED = "sim"
ENVIRONMENTS = (SIMULATED, VIRTUAL, REAL)

#: Duration [s] of step responses: the thesis' 25 s lets slow policies settle.
STEP_DURATION = 25.0

#: Arguments that only the arm has -> their value unless given.
ARM_ARGUMENTS = {"vary": [], "feedback": FEEDBACKS[0], "plant": MUJOCO}

#: The twin whose networks come with the package.
_SHIPPED = 0

#: Arguments that only the rig has.
_RIG_ARGUMENTS = ("twin", "learnt")


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

    def environment(self, case: Case, **drawing: Any) -> gymnasium.Env:
        """Environment for a case, with all observables; `drawing` is how to render."""
        return case.environment(**drawing)


class ArmSetup(Setup):
    """The planar arm, in MuJoCo or as a beam model."""

    tasks = tuple(ALL_TASKS)
    policies = tuple(POLICIES)
    default_policy = "feedforward_pi"

    def complete(self, case: Case) -> Case:
        """See `Setup`; step responses are long."""
        return replace(
            case,
            plant=self._args.plant,
            feedback=self._args.feedback,
            duration=None if case.task.step_width is None else STEP_DURATION,
            scene=plant_options(self._args, case.policy),
        )

    def check(self, cases: list[Case]) -> None:
        """Refuse variations that a case cannot have."""
        for case in cases:
            if case.plant != MUJOCO and "tendon_friction" in case.variation:
                raise ValueError(f"tendon_friction: only with --plant {MUJOCO}")
            try:
                split(case.variation, case.scene.get("control_period", DEFAULT_PERIOD))
            except ValueError as error:
                raise ValueError(f"{case.policy}: {error}") from None


class RigSetup(Setup):
    """The spatial test rig: twins of it, or an ideal one."""

    tasks = tuple(RIG_TASKS)
    policies = tuple(RIG_POLICIES)
    default_policy = "hybrid"
    plant = MUJOCO

    def twins(self) -> list[int | None]:
        """Those asked for."""
        return [_SHIPPED] if self._args.twin is None else list(dict.fromkeys(self._args.twin))

    def complete(self, case: Case) -> Case:
        """See `Setup`; reads the file of identified parameters for policies that act on them."""
        known = self._identified if acts_on_identified(case.policy) else None
        return replace(case, plant=self.plant, scene=scene_options(self._args), identified=known)

    def check(self, cases: list[Case]) -> None:
        """Refuse what no case uses, arguments of the arm and unfit references."""
        args = vars(self._args)
        own = [f"--{name}" for name in _RIG_ARGUMENTS if args.get(name) is not None]
        foreign = [
            f"--{name}"
            for name, default in ARM_ARGUMENTS.items()
            if args.get(name, default) != default
        ]
        if not cases and own:
            tasks = ", ".join(RIG_TASKS)
            raise ValueError(f"{', '.join(own)}: only with tasks of the rig, {tasks}")
        if cases and foreign:
            tasks = ", ".join(ALL_TASKS)
            raise ValueError(f"{', '.join(foreign)}: only with tasks of the arm, {tasks}")
        unused = args.get("learnt") is not None and not any(case.identified for case in cases)
        if cases and unused:
            able = ", ".join(filter(acts_on_identified, RIG_POLICIES))
            raise ValueError(f"--learnt: only with the policies {able}")
        # Environments refuse references that are too fast or too far.
        for case in {(case.task, case.twin): case for case in cases}.values():
            self.environment(case)

    @cached_property
    def _identified(self) -> "IdentifiedParameters":
        """Identified parameters, of --learnt or of twin 0.

        Raises:
            FileNotFoundError: No such file.
            ValueError: It cannot be used, see `IdentifiedParameters.load`.
        """
        from softrobot_env.control.rig.identified import IdentifiedParameters

        return IdentifiedParameters.load(RIG, self._args.learnt)


def setup_of(task: str, setups: tuple[Setup, ...]) -> Setup:
    """The setup that a task is for."""
    return next(setup for setup in setups if task in setup.tasks)
