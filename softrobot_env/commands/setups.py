"""The robots and tasks that commands can be given, as their arguments describe them."""

import itertools
from argparse import ArgumentTypeError, Namespace
from collections.abc import Mapping
from dataclasses import replace
from math import isfinite
from typing import Any

import gymnasium

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.control.registry import FEEDBACKS, SENSORS, incompatibility, policy_environment
from softrobot_env.control.sensed import load_reconstruction
from softrobot_env.core.records import placed
from softrobot_env.core.registry import is_path, load
from softrobot_env.envs.disturbances import periods
from softrobot_env.envs.tracking import DEFAULT_PERIOD
from softrobot_env.evaluation.report import REAL, VIRTUAL
from softrobot_env.evaluation.runner import Case, acts_on_identified
from softrobot_env.robots import (
    ENTRIES,
    ROBOTS,
    RobotEntry,
    RobotParams,
    default_robot,
    entry_of,
    find_robot,
)
from softrobot_env.tasks import (
    EVERY_TASK,
    Maker,
    Task,
    defaults,
    find_maker,
    known_tasks,
    make_task,
    tasks_of,
    with_option,
)
from softrobot_env.tasks.generic import GENERIC_TASKS

from . import arguments

#: What --env can be: simulated, or over a serial line.
SIMULATED = "sim"
ENVIRONMENTS = (SIMULATED, VIRTUAL, REAL)

#: Duration [s] of step responses: the thesis' 25 s lets slow policies settle.
STEP_DURATION = 25.0

#: What arguments are that a command does not have.
_GIVEN = ("robot", "twin", "identified", "sensors", "duration")
_UNLESS_GIVEN = dict.fromkeys((*arguments.SCENE, *_GIVEN))
_UNLESS_GIVEN |= {"plant": MUJOCO, "feedback": FEEDBACKS[0]}


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

    def __init__(self, args: Namespace) -> None:
        """Read --robot.

        Raises:
            ValueError, OSError: As `find_robot`.
        """
        self._args = args = Namespace(**_UNLESS_GIVEN | vars(args))
        self.robot = None if args.robot is None else find_robot(args.robot)
        self._read: dict[RobotParams, Any] = {}

    def default_policy(self, task: Task) -> str:
        """The policy to show on a task."""
        name = entry_of(task.robot).policy
        return name if self.incompatibility(name, task) is None else RobotEntry.policy

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
        given = self._args.control_period
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
        args, robot = self._args, case.task.robot
        step = STEP_DURATION if case.task.step_width is not None else None
        measured = robot.drive.kind == "tension" or args.feedback == SENSORS
        identified = acts_on_identified(case.policy, robot)
        return replace(
            case,
            plant=args.plant,
            feedback=args.feedback if measured else None,
            sensors=args.sensors,
            duration=args.duration or step,
            scene=arguments.plant_options(args, case.policy, robot),
            identified=self._identified(robot) if identified else None,
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
            with placed(case.policy):
                periods(case.variation.get("delay", 0.0), period_of(case))
        self._try_out(cases)

    def _check_feedback(self, cases: list[Case]) -> None:
        """Refuse feedback that a robot does not have."""
        feedback, file = self._args.feedback, self._args.sensors
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
        given = arguments.flags(self._args, ("twin", "identified"))
        if not cases and given:
            tasks = "; ".join(f"{r.name}, {', '.join(tasks_of(r).own())}" for r in with_twins())
            raise ValueError(f"{given}: only with tasks of the {tasks}")
        unused = self._args.identified is not None and not any(case.identified for case in cases)
        if cases and unused:
            robot = cases[0].task.robot
            able = [name for name in entry_of(robot).policies if acts_on_identified(name, robot)]
            raise ValueError(f"--identified: only with the policies {', '.join(able)}")

    def _try_out(self, cases: list[Case]) -> None:
        """Environments refuse references that are too fast or too far, and variations."""
        tried = {}
        for case in cases:
            tried[case.task, case.twin, case.plant, tuple(case.variation.items())] = case
        for case in tried.values():
            env = self.environment(case)
            if case.variation:
                env.reset(options=case.reset_options)

    def environment(self, case: Case, **drawing: Any) -> gymnasium.Env:
        """Environment for a case, with all observables; `drawing` is how to render."""
        return case.environment(**drawing)

    def _identified(self, robot: RobotParams) -> Any:
        """Identified parameters of a robot, of --identified or those that come with the package.

        Raises:
            FileNotFoundError: No such file.
            ValueError: It cannot be used, see `RobotEntry.identified`.
        """
        if robot not in self._read:
            self._read[robot] = load(entry_of(robot).identified)(robot, self._args.identified)
        return self._read[robot]


#: Options of a task by name.
Options = dict[str, float]

#: Values given for options of tasks.
Given = dict[str, list[float]]


def task_help() -> str:
    """What --task can be, for people."""
    own = {name: ", ".join(tasks_of(robot).own()) for name, robot in ROBOTS.items()}
    named = "".join(f"of the {name}: {tasks}; " for name, tasks in own.items() if tasks)
    return (
        f"{named}of any --robot: {', '.join(GENERIC_TASKS.registered())}; or one's own, "
        "package.module:name or file.py:name"
    )


def task_options() -> dict[str, list[str]]:
    """Options of the tasks that have a robot -> those tasks."""
    return {name: tasks for name, tasks in with_option(EVERY_TASK).items() if tasks}


def task_name(text: str) -> str:
    """A task's name, or the path of one's own."""
    if not is_path(text) and text not in known_tasks():
        known = ", ".join(known_tasks())
        raise ArgumentTypeError(
            f"unknown task {text!r}; choose from {known}, or give package.module:name or "
            "file.py:name"
        )
    return text


def combinations(make: Maker, given: Given) -> list[Options]:
    """Options of a task in every combination of the values given for them."""
    own = defaults(make)
    values = []
    for option, default in own.items():
        kind = float if isinstance(default, float) else lambda seed: seed  # seeds stay whole
        values.append([v if v is None else kind(v) for v in given.get(option, [default])])
    return [
        dict(zip(own, chosen, strict=True))
        for chosen in itertools.product(*map(dict.fromkeys, values))
    ]


def check_used(given: Given, makers: Mapping[str, Maker], robot: RobotParams | None) -> None:
    """Refuse options that none of the tasks has.

    Raises:
        ValueError: The message names the tasks that have the option, or else all options.
    """
    here = with_option(makers)
    known = here | (with_option(EVERY_TASK) if robot is None else with_option(tasks_of(robot)))
    for name in given:
        if here.get(name):
            continue
        if not known.get(name):
            able = ", ".join(filter(known.get, known))
            raise ValueError(f"no task has the option {name!r}; choose from {able}")
        raise ValueError(f"{name} is an option of {', '.join(known[name])} only")


def option(text: str) -> tuple[str, list[float]]:
    """`name=1,2,3` as the name of an option of tasks and its values."""
    name, values = arguments.named_values(text)
    a_number = arguments.number("a number", isfinite)
    # What is written as a whole number stays one.
    return name, [int(value) if value.isdecimal() else a_number(value) for value in values]


def merge(pairs: list[tuple[str, list[float]]]) -> Given:
    """Values by name; those of a name given twice add up."""
    merged: Given = {}
    for name, values in pairs:
        merged[name] = list(dict.fromkeys([*merged.get(name, []), *values]))
    return merged


def task_text() -> str:
    """--task, --option and --step-width, of commands that are about one task."""
    return f"""
        --task TASK  {task_help()}; default: swing of the arm, circle of --robot
        --option NAME=VALUE  an option of the task, in SI units, out of {", ".join(task_options())}
        --step-width M  as --option step_width=...
    """


#: Kinds of the arguments of `task_text`, see `arguments.declare`.
TASK_KINDS = {"task": task_name, "option": option}


def one_task(args: Namespace, robot: RobotParams | None) -> Task:
    """The task of `task_text`, for a robot unless it has its own.

    Raises:
        ValueError: An option of other tasks, several values of one, or one out of range.
    """
    width = [] if args.step_width is None else [("step_width", [args.step_width])]
    given = merge([*args.option, *width])
    name = args.task or entry_of(default_robot() if robot is None else robot).task
    make = find_maker(name, robot)
    check_used(given, {name: make}, robot)
    options, *more = combinations(make, given)
    if more:
        raise ValueError("--option: only one value of each for one task")
    return make_task(name, robot=robot, **options)
