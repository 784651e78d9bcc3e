"""The robots that commands can be given, as their arguments describe them."""

import argparse
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import gymnasium

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.commands.arguments import plant_options
from softrobot_env.control.registry import (
    FEEDBACKS,
    POLICIES,
    REDUCED_POLICIES,
    RIG_POLICIES,
    SENSORS,
    misfit,
    policy_environment,
)
from softrobot_env.control.sensed import load_reconstruction
from softrobot_env.envs.disturbances import split
from softrobot_env.envs.tracking import DEFAULT_PERIOD
from softrobot_env.evaluation.labels import REAL, VIRTUAL
from softrobot_env.evaluation.runner import Case, acts_on_identified
from softrobot_env.robots import ARM, RIG, RobotParams, find_robot
from softrobot_env.scene.registry import SCENES
from softrobot_env.tasks import RIG_TASKS, Task

if TYPE_CHECKING:
    from softrobot_env.control.rig.identified import IdentifiedParameters

#: What --env can be: simulated, or over a serial line.
SIMULATED = "sim"
ENVIRONMENTS = (SIMULATED, VIRTUAL, REAL)

#: Duration [s] of step responses: the thesis' 25 s lets slow policies settle.
STEP_DURATION = 25.0

#: The twin whose networks come with the package.
_SHIPPED = 0

#: Arguments that only the rig has.
_RIG_ARGUMENTS = ("twin", "learnt")

#: The policies that were made for a robot: those that it is given unless --robot names it.
FAMILIES = {ARM: tuple(POLICIES), RIG: (*RIG_POLICIES, *REDUCED_POLICIES)}

#: What is shown of a robot unless told otherwise, by robot, and of all others.
_SHOWN, _SHOWN_OF_OTHERS = {ARM: "feedforward_pi", RIG: "hybrid"}, "static"


def period_of(case: Case) -> float:
    """Control period [s] of the environment of a case."""
    usual = SCENES[RIG.name].control_period if case.task.robot == RIG else DEFAULT_PERIOD
    return case.scene.get("control_period", usual)


class Setup:
    """Simulated robots, as the arguments of a command describe them.

    Which arguments apply is up to the robot of each task.

    Attributes:
        robot: That of --robot, for which all tasks are; None where each task has its own.
    """

    def __init__(self, args: argparse.Namespace) -> None:
        """Read --robot.

        Raises:
            ValueError, OSError: As `find_robot`.
        """
        self._args = args
        given = getattr(args, "robot", None)
        self.robot = None if given is None else find_robot(given)
        self._feedback = getattr(args, "feedback", FEEDBACKS[0])
        self._sensors = getattr(args, "sensors", None)

    def default_policy(self, task: Task) -> str:
        """The policy to show on a task."""
        name = _SHOWN.get(task.robot, _SHOWN_OF_OTHERS)
        return name if self.misfit(name, task) is None else _SHOWN_OF_OTHERS

    def misfit(self, policy: str, task: Task) -> str | None:
        """Why a policy is not for a task's robot, or its reference; None where it is.

        Raises:
            ValueError: There is no such policy.
        """
        robot = task.robot
        if robot == RIG and policy in FAMILIES[RIG] and len(task.axes) > 2:
            return f"policy {policy!r} follows x and y alone, as {', '.join(RIG_TASKS)} have them"
        own = policy_environment(policy, robot).get("control_period")
        given = getattr(self._args, "control_period", None)
        if None not in (own, given) and abs(round(own / given) * given - own) > 1e-9:
            return f"{policy} needs a control_period that divides {own:g} s, not {given:g} s"
        families = {} if self.robot is not None else FAMILIES
        for owner, family in families.items():
            if policy in family and robot in families:
                return None if owner == robot else f"policy {policy!r} is for robot {owner.name!r}"
        return misfit(policy, robot)

    def twins(self, robot: RobotParams) -> list[int | None]:
        """Twins of a robot to run every case on, None for the robot as it should be."""
        if robot != RIG:
            return [None]
        return [_SHIPPED] if self._args.twin is None else list(dict.fromkeys(self._args.twin))

    def complete(self, case: Case) -> Case:
        """A case of task, policy, variation and twin with all else that the arguments say of it.

        Step responses are long. Reads the file of identified parameters for policies that act on
        them.

        Raises:
            ValueError, FileNotFoundError: An argument that does not fit; the message says why.
        """
        step = STEP_DURATION if case.task.step_width is not None else None
        tension, feedback = case.task.robot.drive.kind == "tension", self._feedback
        return replace(
            case,
            plant=self._args.plant,
            feedback=feedback if tension or feedback == SENSORS else None,
            sensors=self._sensors,
            duration=getattr(self._args, "duration", None) or step,
            scene=plant_options(self._args, case.policy, case.task.robot),
            identified=self._identified if acts_on_identified(case.policy) else None,
        )

    def check(self, cases: list[Case]) -> None:
        """Refuse what an environment would refuse in a later episode, and what no case uses.

        Raises:
            ValueError: The message names what is allowed.
        """
        self._check_rig([case for case in cases if case.task.robot == RIG])
        self._check_feedback(cases)
        for case in cases:
            if case.plant != MUJOCO and "tendon_friction" in case.variation:
                raise ValueError(f"tendon_friction: only with --plant {MUJOCO}")
            try:
                split(case.variation, period_of(case))
            except ValueError as error:
                raise ValueError(f"{case.policy}: {error}") from None
        self._try_out(cases)

    def _check_feedback(self, cases: list[Case]) -> None:
        """Refuse feedback that a robot does not have."""
        feedback, file = self._feedback, self._sensors
        if feedback != SENSORS and file is not None:
            raise ValueError(f"--sensors: only with --feedback {SENSORS}")
        for robot in {case.task.robot for case in cases} if feedback == SENSORS else ():
            load_reconstruction(robot, file)
        for case in cases:
            if feedback == "output" and case.task.robot.drive.kind != "tension":
                raise ValueError(
                    "--feedback output: only with robots driven by tension, not with "
                    f"{case.task.robot.name!r}"
                )
            if feedback == SENSORS and file is None and case.twin not in (None, _SHIPPED):
                raise ValueError(
                    f"--feedback {SENSORS}: the calibration that comes with the package is of twin "
                    f"{_SHIPPED}; make one by `softrobot train sensors --robot rig --twin "
                    f"{case.twin} --out DIR` and give it by --sensors"
                )

    def _check_rig(self, cases: list[Case]) -> None:
        """Refuse arguments of the rig that no case uses."""
        args = vars(self._args)
        own = [f"--{name}" for name in _RIG_ARGUMENTS if args.get(name) is not None]
        if not cases and own:
            tasks = ", ".join(RIG_TASKS)
            raise ValueError(f"{', '.join(own)}: only with tasks of the rig, {tasks}")
        unused = args.get("learnt") is not None and not any(case.identified for case in cases)
        if cases and unused:
            able = ", ".join(filter(acts_on_identified, RIG_POLICIES))
            raise ValueError(f"--learnt: only with the policies {able}")

    def _try_out(self, cases: list[Case]) -> None:
        """Environments refuse references that are too fast or too far, and variations."""
        tried = {}
        for case in cases:
            if case.task.robot != ARM:
                varied = tuple(case.variation.items())
                tried[case.task, case.twin, case.plant, varied] = case
        for case in tried.values():
            env = self.environment(case)
            if case.variation:
                env.reset(options=case.reset_options)

    def environment(self, case: Case, **drawing: Any) -> gymnasium.Env:
        """Environment for a case, with all observables; `drawing` is how to render."""
        return case.environment(**drawing)

    @cached_property
    def _identified(self) -> "IdentifiedParameters":
        """Identified parameters, of --learnt or of twin 0.

        Raises:
            FileNotFoundError: No such file.
            ValueError: It cannot be used, see `IdentifiedParameters.load`.
        """
        from softrobot_env.control.rig.identified import IdentifiedParameters

        return IdentifiedParameters.load(RIG, self._args.learnt)
