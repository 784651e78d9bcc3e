"""The robots that commands can be given, as their arguments describe them."""

import argparse
from dataclasses import replace
from typing import Any

import gymnasium

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.commands.arguments import plant_options
from softrobot_env.control.registry import (
    FEEDBACKS,
    SENSORS,
    incompatibility,
    policy_environment,
)
from softrobot_env.control.sensed import load_reconstruction
from softrobot_env.core.registry import load
from softrobot_env.envs.disturbances import periods
from softrobot_env.envs.tracking import DEFAULT_PERIOD
from softrobot_env.evaluation.report import REAL, VIRTUAL
from softrobot_env.evaluation.runner import Case, acts_on_identified
from softrobot_env.robots import ENTRIES, RobotEntry, RobotParams, entry_of, find_robot
from softrobot_env.tasks import Task, tasks_of

#: What --env can be: simulated, or over a serial line.
SIMULATED = "sim"
ENVIRONMENTS = (SIMULATED, VIRTUAL, REAL)

#: Duration [s] of step responses: the thesis' 25 s lets slow policies settle.
STEP_DURATION = 25.0

#: Arguments that only robots with twins have.
_TWIN_ARGUMENTS = ("twin", "learnt")

#: Shown of a robot that its own policy cannot drive.
_SHOWN = RobotEntry.policy


def period_of(case: Case) -> float:
    """Control period [s] of the environment of a case."""
    usual = entry_of(case.task.robot).control_period or DEFAULT_PERIOD
    return case.scene.get("control_period", usual)


def families() -> dict[RobotParams, tuple[str, ...]]:
    """The policies that were made for a robot: those that it is given unless --robot names it."""
    return {entry.robot: entry.policies for entry in ENTRIES.values() if entry.policies}


def with_twins() -> list[RobotParams]:
    """The robots that are simulated with the errors of a twin."""
    return [entry.robot for entry in ENTRIES.values() if entry.twin is not None]


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
        self._read: dict[RobotParams, Any] = {}

    def default_policy(self, task: Task) -> str:
        """The policy to show on a task."""
        name = entry_of(task.robot).policy
        return name if self.incompatibility(name, task) is None else _SHOWN

    def incompatibility(self, policy: str, task: Task) -> str | None:
        """Why a policy is not for a task's robot, or its reference; None where it is.

        Raises:
            ValueError: There is no such policy.
        """
        robot, entry = task.robot, entry_of(task.robot)
        if entry.axes is not None and policy in entry.policies and len(task.axes) > 2:
            own = ", ".join(tasks_of(robot).own())
            return f"policy {policy!r} follows x and y alone, as {own} have them"
        own = policy_environment(policy, robot).get("control_period")
        given = getattr(self._args, "control_period", None)
        if None not in (own, given) and abs(round(own / given) * given - own) > 1e-9:
            return f"{policy} needs a control_period that divides {own:g} s, not {given:g} s"
        made_for = {} if self.robot is not None else families()
        for owner, family in made_for.items():
            if policy in family and robot in made_for:
                return None if owner == robot else f"policy {policy!r} is for robot {owner.name!r}"
        return incompatibility(policy, robot)

    def twins(self, robot: RobotParams) -> list[int | None]:
        """Twins of a robot to run every case on, None for the robot as it should be."""
        usual = entry_of(robot).twin
        if usual is None:
            return [None]
        return [usual] if self._args.twin is None else list(dict.fromkeys(self._args.twin))

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
            identified=self._identified(case.task.robot)
            if acts_on_identified(case.policy, case.task.robot)
            else None,
        )

    def check(self, cases: list[Case]) -> None:
        """Refuse what an environment would refuse in a later episode, and what no case uses.

        Raises:
            ValueError: The message names what is allowed.
        """
        self._check_twins([case for case in cases if case.task.robot in with_twins()])
        self._check_feedback(cases)
        for case in cases:
            if case.plant != MUJOCO and "tendon_friction" in case.variation:
                raise ValueError(f"tendon_friction: only with --plant {MUJOCO}")
            try:
                periods(case.variation.get("delay", 0.0), period_of(case))
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
            shipped = entry_of(case.task.robot).twin
            if feedback == SENSORS and file is None and case.twin not in (None, shipped):
                raise ValueError(
                    f"--feedback {SENSORS}: the calibration that comes with the package is of twin "
                    f"{shipped}; make one by `softrobot train sensors --robot "
                    f"{case.task.robot.name} --twin {case.twin} --out DIR` and give it by --sensors"
                )

    def _check_twins(self, cases: list[Case]) -> None:
        """Refuse arguments of robots with twins that no case uses."""
        args = vars(self._args)
        own = [f"--{name}" for name in _TWIN_ARGUMENTS if args.get(name) is not None]
        if not cases and own:
            tasks = "; ".join(f"{r.name}, {', '.join(tasks_of(r).own())}" for r in with_twins())
            raise ValueError(f"{', '.join(own)}: only with tasks of the {tasks}")
        unused = args.get("learnt") is not None and not any(case.identified for case in cases)
        if cases and unused:
            robot = cases[0].task.robot
            able = [name for name in entry_of(robot).policies if acts_on_identified(name, robot)]
            raise ValueError(f"--learnt: only with the policies {', '.join(able)}")

    def _try_out(self, cases: list[Case]) -> None:
        """Environments refuse references that are too fast or too far, and variations."""
        tried = {}
        for case in cases:
            varied = tuple(case.variation.items())
            tried[case.task, case.twin, case.plant, varied] = case
        for case in tried.values():
            env = self.environment(case)
            if case.variation:
                env.reset(options=case.reset_options)

    def environment(self, case: Case, **drawing: Any) -> gymnasium.Env:
        """Environment for a case, with all observables; `drawing` is how to render."""
        return case.environment(**drawing)

    def _identified(self, robot: RobotParams) -> Any:
        """Identified parameters of a robot, of --learnt or those that come with the package.

        Raises:
            FileNotFoundError: No such file.
            ValueError: It cannot be used, see `RobotEntry.identified`.
        """
        if robot not in self._read:
            self._read[robot] = load(entry_of(robot).identified)(robot, self._args.learnt)
        return self._read[robot]
