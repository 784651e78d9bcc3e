"""The spatial test rig as commands simulate it."""

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING
from zipfile import BadZipFile, is_zipfile

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.commands.arguments import scene_options
from softrobot_env.commands.setups.arm import ARM_ARGUMENTS
from softrobot_env.commands.setups.base import Setup
from softrobot_env.control.registry import RIG_POLICIES
from softrobot_env.evaluation.runner import Case, acts_on_identified
from softrobot_env.robots import RIG
from softrobot_env.tasks import ALL_TASKS, RIG_TASKS

if TYPE_CHECKING:
    from softrobot_env.control.rig.identified import IdentifiedParameters

#: The twin whose networks come with the package.
_SHIPPED = 0

#: Arguments that only the rig has.
_OWN = ("twin", "learnt")


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
        own = [f"--{name}" for name in _OWN if args.get(name) is not None]
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
            ValueError: It is another kind of file, belongs to another robot or lacks something.
        """
        from softrobot_env.control.rig.identified import IdentifiedParameters

        path = self._args.learnt
        if path is None:
            return IdentifiedParameters.load(RIG)
        strange = f"{path} is not a file of `softrobot train rig_nn`"
        if path.is_file() and not is_zipfile(path):
            raise ValueError(strange)
        try:
            return IdentifiedParameters.load(RIG, path)
        except (KeyError, BadZipFile) as error:
            raise ValueError(strange) from error
