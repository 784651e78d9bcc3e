"""The planar arm as commands run it."""

from dataclasses import replace

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.commands.arguments import plant_options
from softrobot_env.commands.setups.base import Setup
from softrobot_env.control.registry import FEEDBACKS, POLICIES
from softrobot_env.envs.disturbances import split
from softrobot_env.envs.tracking import DEFAULT_PERIOD
from softrobot_env.evaluation.runner import Case
from softrobot_env.tasks import ALL_TASKS

#: Duration [s] of step responses: the thesis' 25 s lets slow policies settle.
STEP_DURATION = 25.0

#: Arguments that only the arm has -> their value unless given.
ARM_ARGUMENTS = {"vary": [], "feedback": FEEDBACKS[0], "plant": MUJOCO}


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
