"""The spatial test rig as commands simulate it."""

import argparse
from functools import cached_property
from typing import TYPE_CHECKING, Any

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.commands.arguments import scene_options
from softrobot_env.commands.setups.arm import ARM_ARGUMENTS
from softrobot_env.commands.setups.case import Case
from softrobot_env.commands.setups.identified import check_learnt, learns, load_learnt
from softrobot_env.control.registry import RIG_POLICIES, make_policy, policy_environment
from softrobot_env.envs.rig import RigEnv
from softrobot_env.evaluation.labels import learnt_label
from softrobot_env.interfaces import Policy
from softrobot_env.robots.twin import twin_or_ideal
from softrobot_env.tasks import ALL_TASKS, RIG_TASKS

if TYPE_CHECKING:
    from softrobot_env.control.rig.identified import IdentifiedParameters

#: The twin whose networks are shipped.
_SHIPPED = 0

#: Arguments that only the rig has.
_OWN = ("twin", "learnt")


class RigSetup:
    """The spatial test rig: twins of it, or an ideal one."""

    tasks = tuple(RIG_TASKS)
    policies = tuple(RIG_POLICIES)
    default_policy = "hybrid"
    plant = MUJOCO
    feedback = None

    def __init__(self, args: argparse.Namespace) -> None:
        """As `arguments.add_scene`, `add_twin` and `add_learnt` were given."""
        self._args = args

    def twins(self) -> list[int | None]:
        """Those asked for."""
        return [_SHIPPED] if self._args.twin is None else list(dict.fromkeys(self._args.twin))

    def check(self, cases: list[Case]) -> None:
        """Refuse what no case uses, arguments of the arm, unfit references and unfit files."""
        own = [f"--{name}" for name in _OWN if getattr(self._args, name, None) is not None]
        if not cases and own:
            raise ValueError(
                f"{', '.join(own)}: only with tasks of the rig, {', '.join(RIG_TASKS)}"
            )
        foreign = [
            f"--{name}"
            for name, default in ARM_ARGUMENTS.items()
            if getattr(self._args, name, default) != default
        ]
        if cases and foreign:
            raise ValueError(
                f"{', '.join(foreign)}: only with tasks of the arm, {', '.join(ALL_TASKS)}"
            )
        if cases:
            check_learnt(self._args.learnt, [case.policy for case in cases])
        # Environments refuse references that are too fast or too far.
        for case in {(case.task, case.twin): case for case in cases}.values():
            self.environment(case)
        for case in cases:
            self.learnt_of(case)  # reads the file

    def environment(self, case: Case, **drawing: Any) -> RigEnv:
        """Environment for a case."""
        options = policy_environment(case.policy) | scene_options(self._args) | drawing
        return RigEnv(case.task, twin=twin_or_ideal(case.twin), observe="all", **options)

    def policy(self, case: Case, control_period: float) -> Policy:
        """The policy of a case, which knows the nominal rig and what was learnt of one."""
        known = {"learnt": self._learnt} if learns(case.policy) else {}
        return make_policy(case.policy, case.task.robot, control_period, **known)

    def learnt_of(self, case: Case) -> str | None:
        """The rig that the policy has learnt of, None if it has learnt nothing."""
        return learnt_label(self._learnt.twin) if learns(case.policy) else None

    @cached_property
    def _learnt(self) -> "IdentifiedParameters":
        return load_learnt(self._args.learnt)

    def reset_options(self, case: Case) -> dict[str, Any]:
        """None."""
        return {}
