"""The robots, tasks and episodes described by the arguments of commands."""

import itertools
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.control.registry import (
    EVERY_POLICY,
    FEEDBACKS,
    POLICIES,
    SENSORS,
    incompatibility,
    installed_policies,
    policy_environment,
    policy_name,
)
from softrobot_env.control.sensed import load_reconstruction
from softrobot_env.core.files import file_name
from softrobot_env.core.records import placed
from softrobot_env.core.registry import load
from softrobot_env.envs.disturbances import periods, rounded
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.tracking import DEFAULT_PERIOD
from softrobot_env.evaluation.report import REAL, VIRTUAL
from softrobot_env.evaluation.runner import Case, acts_on_identified
from softrobot_env.hardware.interface import HardwareFile
from softrobot_env.hardware.registry import hardware_of
from softrobot_env.hardware.transport import Transport
from softrobot_env.robots import (
    ENTRIES,
    VARIATIONS,
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
    make_task,
    tasks_of,
    with_option,
)

from .arguments import SCENE, SIMULATED, expand_all, flags, plant_options
from .robot.link import opened, robot_of

#: Duration [s] of step responses: the thesis' 25 s lets slow policies settle.
STEP_DURATION = 25.0

#: Step widths [m] of tasks that have one, unless given (thesis Tabs. 6.2 to 6.4).
STEP_WIDTHS = (0.05, 0.1, 0.2)

#: Number of robots sampled from --randomize: default and maximum.
_DRAWS, _MOST_DRAWS = 5, 100_000

#: Values of arguments that a command does not have.
_GIVEN = ("robot", "twin", "identified", "sensors", "predict", "duration")
_UNLESS_GIVEN = dict.fromkeys((*SCENE, *_GIVEN))
_UNLESS_GIVEN |= {"plant": MUJOCO, "feedback": FEEDBACKS[0]}


def period_of(case: Case) -> float:
    """Control period [s] of the environment of a case."""
    usual = entry_of(case.task.robot).control_period or DEFAULT_PERIOD
    return case.scene.get("control_period", usual)


def families() -> dict[RobotParams, tuple[str, ...]]:
    """Robots with their own policies, which drive no other robot unless --robot names it."""
    return {entry.robot: entry.policies for entry in ENTRIES.values() if entry.policies}


def with_twins() -> list[RobotParams]:
    """The robots that can be simulated with the errors of a twin."""
    return [entry.robot for entry in ENTRIES.values() if entry.twin is not None]


class Setup:
    """Simulated robots, as the arguments of a command describe them.

    Which arguments apply is up to the robot of each task.

    Attributes:
        robot: Robot of --robot, used for all tasks; None if each task has its own.
        delays: [s], for which policies compensate, 0 for none.
    """

    def __init__(self, args: Namespace) -> None:
        """Read --robot.

        Raises:
            ValueError, OSError: See `find_robot`.
        """
        self._args = args = Namespace(**_UNLESS_GIVEN | vars(args))
        self.robot = None if args.robot is None else find_robot(args.robot)
        self.delays = list(dict.fromkeys(args.predict or [0.0]))
        self._read: dict[RobotParams, Any] = {}

    def default_policy(self, task: Task) -> str:
        """The policy to show on a task."""
        name = entry_of(task.robot).policy
        return name if self.incompatibility(name, task) is None else RobotEntry.policy

    def incompatibility(self, policy: str, task: Task) -> str | None:
        """Why a policy does not fit a task's robot or reference; None if it does.

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
        return incompatibility(policy, robot, delay=max(self.delays))

    def twins(self, robot: RobotParams) -> list[int | None]:
        """Twins of a robot to run every case on; None for the nominal robot."""
        usual = entry_of(robot).twin
        if usual is None:
            return [None]
        return [usual] if self._args.twin is None else list(dict.fromkeys(self._args.twin))

    def complete(self, case: Case) -> Case:
        """A case of task, policy, variation and twin, completed by the other arguments.

        Step responses are long. Reads the file of identified parameters for policies that use them.

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
            scene=plant_options(args, case.policy, robot, case.delay),
            identified=self._identified(robot) if identified else None,
        )

    def check(self, cases: list[Case]) -> None:
        """Refuse values that an environment would refuse later, and those that no case uses.

        Raises:
            ValueError: The message names what is allowed.
        """
        self._check_twins([case for case in cases if case.task.robot in with_twins()])
        self._check_feedback(cases)
        for case in cases:
            if case.plant != MUJOCO and "tendon_friction" in case.variation:
                raise ValueError(f"tendon_friction: only with --plant {MUJOCO}")
            if case.plant != MUJOCO and case.real_drive:
                raise ValueError(f"--real-drive: only with --plant {MUJOCO}")
            with placed(case.policy):
                for delay in (case.variation.get("delay", 0.0), case.delay):
                    periods(delay, period_of(case))
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
        given = flags(self._args, ("twin", "identified"))
        if not cases and given:
            tasks = "; ".join(f"{r.name}, {', '.join(tasks_of(r).own())}" for r in with_twins())
            raise ValueError(f"{given}: only with tasks of the {tasks}")
        unused = self._args.identified is not None and not any(case.identified for case in cases)
        if cases and unused:
            robot = cases[0].task.robot
            able = [name for name in entry_of(robot).policies if acts_on_identified(name, robot)]
            raise ValueError(f"--identified: only with the policies {', '.join(able)}")

    def _try_out(self, cases: list[Case]) -> None:
        """Build environments: they refuse variations, and references too fast or too far."""
        tried = {}
        for case in cases:
            vary = tuple(case.variation.items())
            tried[case.task, case.twin, case.plant, vary, case.real_drive] = case
        for case in tried.values():
            env = self.environment(case)
            if case.variation or case.real_drive:
                env.reset(options=case.reset_options)

    def environment(self, case: Case, **drawing: Any) -> gymnasium.Env:
        """Environment for a case, with all observables; `drawing` is how to render."""
        return case.environment(**drawing)

    def _identified(self, robot: RobotParams) -> Any:
        """Identified parameters of a robot, from --identified or those shipped with the package.

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


def products(values: Mapping[str, Iterable[Any]]) -> list[dict[str, Any]]:
    """Every choice of one of the values of each name."""
    chosen = itertools.product(*values.values())
    return [dict(zip(values, one, strict=True)) for one in chosen]


def combinations(make: Maker, given: Given) -> list[Options]:
    """All combinations of the values given for options of a task."""
    values = {}
    for option, default in defaults(make).items():
        found = given.get(option, [default])
        if isinstance(default, float):  # seeds stay integers
            found = map(float, found)
        values[option] = dict.fromkeys(found)
    return products(values)


def check_used(given: Given, makers: Mapping[str, Maker], robot: RobotParams | None) -> None:
    """Refuse options that none of the tasks has.

    Raises:
        ValueError: The message names the tasks that have the option, or all options.
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


def merge(pairs: list[tuple[str, list[float]]]) -> Given:
    """Values by name; those of a name given twice add up."""
    merged: Given = {}
    for name, values in pairs:
        merged[name] = list(dict.fromkeys([*merged.get(name, []), *values]))
    return merged


def one_task(args: Namespace, robot: RobotParams | None) -> Task:
    """The task of `<task>`, for a robot unless it has its own.

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


#: Arguments of simulated robots alone -> their value unless given.
_SIMULATED = {
    "real_drive": False,
    "vary": [],
    "randomize": [],
    "feedback": FEEDBACKS[0],
    "plant": MUJOCO,
}
_SIMULATED |= {name: None for name in SCENE if name != "control_period"}


class RealSetup(Setup):
    """A real robot, by default the rig; tasks of other robots are simulated."""

    def __init__(self, args: Namespace) -> None:
        """Arguments of `softrobot evaluate`."""
        super().__init__(args)
        self.plant = args.env
        self._own = self.robot or default_robot(on_a_line=True)
        self._rig = entry_of(self._own).on_a_line

    def twins(self, robot: RobotParams) -> list[int | None]:
        """Seeds for virtual robots; a real one has none."""
        return super().twins(robot) if self.plant == VIRTUAL else [None]

    def complete(self, case: Case) -> Case:
        """See `Setup`."""
        case = super().complete(case)
        return replace(case, plant=self.plant) if case.task.robot == self._own else case

    def check(self, cases: list[Case]) -> None:
        """Refuse arguments that only virtual robots or no robot has, and unsuitable references."""
        args = self._args
        self._make()
        if not any(case.task.robot == self._own for case in cases):
            raise ValueError(f"--env {self.plant}: only with tasks of the {self._own.name}")
        if self.plant == REAL and args.twin is not None:
            raise ValueError("--twin: only with simulated and virtual robots")
        if self.plant == VIRTUAL and (args.robot_file is not None or args.port is not None):
            raise ValueError("--robot-file, --port: only with --env real")
        if self.plant == VIRTUAL and self._rig and None in self.twins(self._own):
            raise ValueError("--twin none: only with simulated robots")
        foreign = [f"--{name}" for name, usual in _SIMULATED.items() if vars(args)[name] != usual]
        if foreign:
            raise ValueError(f"{', '.join(foreign)}: only with simulated robots")
        super().check(cases)

    def environment(self, case: Case, **drawing: Any) -> gymnasium.Env:
        """Environment for a case; its `close` ends a virtual robot's process."""
        if case.task.robot != self._own:
            return super().environment(case, **drawing)
        make = self._make()
        options = {"observe": "all", **case.scene}
        if self.plant == VIRTUAL:
            return make(case.task, case.twin, partial(self._line, case), **options)
        if self._args.robot_file is None and self._own.hardware is not None:
            file = hardware_of(self._own, self._args.port)
        else:
            file = robot_of(self._args)
        return make(case.task, robot_file=file, line=self._line(case, file), **options)

    def _make(self) -> Callable[..., gymnasium.Env]:
        """The factory of the robot's environment; ValueError if its drives are not defined."""
        from .robot.virtual import real_env  # loads plug-ins

        return real_env(self._own, self.plant == VIRTUAL)

    def _line(self, case: Case, file: HardwareFile) -> Callable[[], Transport]:
        """Opens the connection to a robot, recorded if requested."""
        folder = self._args.record
        return lambda: opened(file, None if folder is None else _free_name(folder, case))


def _free_name(folder: Path, case: Case) -> Path:
    """A file name for a log that does not exist yet."""
    folder.mkdir(parents=True, exist_ok=True)
    number = 1
    stem = f"{case.task.name}_{policy_name(case.policy)}"
    while (path := folder / file_name(f"{stem}_{number}.link")).exists():
        number += 1
    return path


def make_setup(args: Namespace) -> Setup:
    """The robots that the arguments describe.

    Raises:
        ValueError: Arguments of a robot over a serial line for a simulated one, or --robot for one.
        ImportError: Packages of the extra `robot` are missing.
    """
    if "env" not in args:
        return Setup(args)
    if args.env == SIMULATED:
        if given := flags(args, ("robot_file", "port")):
            raise ValueError(f"{given}: only with --env real or virtual")
        return Setup(args)
    return RealSetup(args)


def make_cases(args: Namespace, setup: Setup) -> list[Case]:
    """All compatible combinations of the given tasks, policies and values.

    Raises:
        ValueError: A policy without a task or a task without a policy, an option that no case
            uses, or a value that a case cannot have; raised before anything is run.
    """
    robot = default_robot() if setup.robot is None else setup.robot
    every = list(entry_of(robot).tasks or tasks_of(robot)) if "all" in args.tasks else []
    makers = {name: find_maker(name, setup.robot) for name in expand_all(args.tasks, every)}
    short = {"step_width": args.step_widths, "speed": args.speeds, "seed": args.path_seeds}
    short = ((name, values) for name, values in short.items() if values)
    given = merge([*args.option, *short])
    check_used(given, makers, setup.robot)
    wanted = {"step_width": list(STEP_WIDTHS)} | given
    tasks = {
        name: [make_task(name, robot=setup.robot, **o) for o in combinations(make, wanted)]
        for name, make in makers.items()
    }
    _check_names(args.policies)
    _check_policies(args.policies, [made[0] for made in tasks.values()], setup)
    cases = []
    for name, made in tasks.items():
        cases += _of_task(made, _for_task(args.policies, name, made[0], setup), setup, args)
    setup.check(cases)
    return cases


def _of_task(
    tasks: list[Task], policies: list[str], setup: Setup, args: Namespace
) -> Iterator[Case]:
    given, sampled = _variations(args.vary), _draws(args)
    twins, drives = setup.twins(tasks[0].robot), (False, True) if args.real_drive else (False,)
    conditions = list(itertools.product(twins, [*given, *sampled], setup.delays, drives))
    for task in tasks:
        for policy in policies:
            for twin, variation, delay, real in conditions:
                case = Case(task, policy, variation, twin, delay=delay, real_drive=real)
                case = setup.complete(case)
                if variation in sampled:
                    case = replace(case, variation=rounded(variation, period_of(case)))
                yield case


def one_case(args: Namespace, setup: Setup, twin: bool) -> Case:
    """The episode to show: of `<task>`, with --policy or the robot's default policy.

    Args:
        args: The arguments.
        setup: The robots.
        twin: Whether the robot has the errors of a twin.

    Raises:
        ValueError: A policy for another robot; there would be nothing to show.
    """
    task = one_task(args, setup.robot)
    name = args.policy or setup.default_policy(task)
    reason = setup.incompatibility(name, task)
    if reason is not None:
        raise ValueError(
            f"policy {name!r} is not for the task {task.name}: {reason}; choose from "
            f"{', '.join(fitting(task, setup))}"
        )
    if len(setup.delays) > 1:
        raise ValueError("--predict: only one delay for one episode")
    built = setup.twins(task.robot)[0] if twin else None
    case = Case(task, name, twin=built, delay=setup.delays[0])
    return replace(setup.complete(case), duration=getattr(args, "duration", None))


def left_out(args: Namespace, cases: list[Case]) -> list[str]:
    """Policies that were not run because their packages are not installed."""
    missing = [name for name in POLICIES if name not in installed_policies()]
    made_for = {name for case in cases for name in entry_of(case.task.robot).policies}
    return [name for name in missing if name in made_for] if "all" in args.policies else []


def _for_task(names: list[str], called: str, task: Task, setup: Setup) -> list[str]:
    """Policies among those named that can drive the robot of a task.

    Raises:
        ValueError: There is no such policy.
    """
    if "all" in names:
        named = [*fitting(task, setup), *(name for name in names if name != "all")]
    else:
        named = [name for name in names if setup.incompatibility(name, task) is None]
    if not named:
        able = ", ".join(fitting(task, setup))
        raise ValueError(
            f"no policy for task {called!r} among {', '.join(names)}; it can have {able}"
        )
    return list(dict.fromkeys(named))


def fitting(task: Task, setup: Setup) -> list[str]:
    """Installed policies that can drive a task's robot, see `Setup.incompatibility`."""
    ready = [*installed_policies(), *(name for name in EVERY_POLICY if name not in POLICIES)]
    return [name for name in ready if setup.incompatibility(name, task) is None]


def _check_names(names: list[str]) -> None:
    """Raise ValueError where two policies would have one name in reports."""
    paths = {}
    for which in dict.fromkeys(names):
        name = policy_name(which)
        if paths.setdefault(name, which) != which or (which != name and name in EVERY_POLICY):
            raise ValueError(f"there are two policies called {name!r}: rename that of {which!r}")


def _check_policies(names: list[str], tasks: list[Task], setup: Setup) -> None:
    """Refuse policies that are for none of the tasks."""
    for name in (name for name in names if name != "all"):
        reasons = dict.fromkeys(
            (task.robot.name, setup.incompatibility(name, task)) for task in tasks
        )
        if None in [reason for _, reason in reasons]:
            continue
        owners = [robot for robot, made in families().items() if name in made]
        if setup.robot is None and owners:
            fits = ", ".join(tasks_of(owners[0]).own())
            raise ValueError(f"policy {name!r} is for the tasks {fits}")
        refused = "; ".join(f"{robot!r}: {reason}" for robot, reason in reasons)
        raise ValueError(f"policy {name!r} cannot drive robot {refused}")


def _variations(given: list[tuple[str, list[float]]]) -> list[dict[str, float]]:
    """All combinations of variations, without values that change nothing."""
    return [
        {name: value for name, value in chosen.items() if value != VARIATIONS[name].neutral}
        for chosen in products(merge(given))
    ]


def _draws(args: Namespace) -> list[dict[str, float]]:
    """Variations sampled from --randomize, the same for every policy and task.

    Raises:
        ValueError: A range that is not valid, or --draws without a range.
    """
    if not args.randomize and args.draws is not None:
        raise ValueError("--draws: only with --randomize")
    ranges = Randomization(**{name: tuple(ends) for name, ends in args.randomize})
    rng = np.random.default_rng(0)
    count = (args.draws or _DRAWS) if args.randomize else 0
    if count > _MOST_DRAWS:
        raise ValueError(f"--draws: at most {_MOST_DRAWS} robots, got {count}")
    return [ranges.draw(rng) for _ in range(count)]
