"""The planar arm as commands run it."""

import argparse
from typing import Any

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.commands.arguments import plant_options
from softrobot_env.commands.setups.case import Case
from softrobot_env.control.registry import FEEDBACKS, POLICIES, make_policy
from softrobot_env.envs.disturbances import split
from softrobot_env.envs.tracking import DEFAULT_PERIOD, TrackingEnv
from softrobot_env.interfaces import Policy
from softrobot_env.tasks import ALL_TASKS

#: Duration [s] of evaluated step responses: the thesis' 25 s lets slow policies settle.
STEP_DURATION = 25.0

#: Arguments that only the arm has -> their value unless given.
ARM_ARGUMENTS = {"vary": [], "feedback": FEEDBACKS[0], "plant": MUJOCO}


class ArmSetup:
    """The planar arm, in MuJoCo or as a beam model."""

    tasks = tuple(ALL_TASKS)
    policies = tuple(POLICIES)
    default_policy = "feedforward_pi"

    def __init__(self, args: argparse.Namespace) -> None:
        """As `arguments.add_plant` and `add_feedback` were given."""
        self._args = args
        self.plant, self.feedback = args.plant, args.feedback

    def twins(self) -> list[int | None]:
        """None: the arm is varied instead."""
        return [None]

    def check(self, cases: list[Case]) -> None:
        """Refuse variations that a case cannot have."""
        for case in cases:
            if self.plant != MUJOCO and "tendon_friction" in case.variation:
                raise ValueError(f"tendon_friction: only with --plant {MUJOCO}")
            period = plant_options(self._args, case.policy).get("control_period", DEFAULT_PERIOD)
            try:
                split(case.variation, period)
            except ValueError as error:
                raise ValueError(f"{case.policy}: {error}") from None

    def environment(self, case: Case, **drawing: Any) -> TrackingEnv:
        """Environment for a case."""
        options = plant_options(self._args, case.policy) | drawing
        return TrackingEnv(case.task, observe="all", **options)

    def policy(self, case: Case, control_period: float) -> Policy:
        """The policy of a case, behind an observer where rates are not measured."""
        return make_policy(case.policy, case.task.robot, control_period, self.feedback)

    def learnt_of(self, case: Case) -> None:
        """None: what policies of the arm have learnt is of the nominal one."""

    def reset_options(self, case: Case) -> dict[str, Any]:
        """Variation, and a longer step response."""
        longer = {} if case.task.step_width is None else {"duration": STEP_DURATION}
        return {"vary": case.variation, **longer}
