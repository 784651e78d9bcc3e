"""The spatial test rig as commands simulate it."""

import argparse
from typing import Any

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.commands.arguments import scene_options
from softrobot_env.commands.arm_setup import ARM_ARGUMENTS
from softrobot_env.commands.cases import Case
from softrobot_env.control.registry import RIG_POLICIES, make_policy, policy_environment
from softrobot_env.envs.rig import RigEnv
from softrobot_env.interfaces import Policy
from softrobot_env.rig_tasks import RIG_TASKS
from softrobot_env.tasks import ALL_TASKS
from softrobot_env.twin import twin_or_ideal

#: The twin whose networks are shipped.
_SHIPPED = 0


class RigSetup:
    """The spatial test rig: twins of it, or an ideal one."""

    tasks = tuple(RIG_TASKS)
    policies = tuple(RIG_POLICIES)
    default_policy = "hybrid"
    plant = MUJOCO
    feedback = None

    def __init__(self, args: argparse.Namespace) -> None:
        """As `arguments.add_scene` and `add_twin` were given."""
        self._args = args

    def twins(self) -> list[int | None]:
        """Those asked for."""
        return [_SHIPPED] if self._args.twin is None else list(dict.fromkeys(self._args.twin))

    def check(self, cases: list[Case]) -> None:
        """Refuse twins without a case, arguments of the arm with one, and unfit references."""
        if not cases and self._args.twin is not None:
            raise ValueError(f"--twin: only with tasks of the rig, {', '.join(RIG_TASKS)}")
        foreign = [
            f"--{name}"
            for name, default in ARM_ARGUMENTS.items()
            if getattr(self._args, name, default) != default
        ]
        if cases and foreign:
            raise ValueError(
                f"{', '.join(foreign)}: only with tasks of the arm, {', '.join(ALL_TASKS)}"
            )
        # Environments refuse references that are too fast or too far.
        for case in {(case.task, case.twin): case for case in cases}.values():
            self.environment(case)

    def environment(self, case: Case, **drawing: Any) -> RigEnv:
        """Environment for a case."""
        options = policy_environment(case.policy) | scene_options(self._args) | drawing
        return RigEnv(case.task, twin=twin_or_ideal(case.twin), observe="all", **options)

    def policy(self, case: Case, control_period: float) -> Policy:
        """The policy of a case, which knows the nominal rig and what is shipped."""
        return make_policy(case.policy, case.task.robot, control_period)

    def reset_options(self, case: Case) -> dict[str, Any]:
        """None."""
        return {}
