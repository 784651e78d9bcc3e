"""The robots and the episodes that commands are asked for."""

import itertools
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from softrobot_env.control.registry import EVERY_POLICY, POLICIES, installed_policies, policy_name
from softrobot_env.envs.disturbances import rounded
from softrobot_env.envs.randomization import Randomization
from softrobot_env.evaluation.runner import Case
from softrobot_env.robots import VARIATIONS, default_robot, entry_of
from softrobot_env.tasks import Task, find_maker, make_task, tasks_of

from . import setups
from .arguments import expand_all, flags
from .setups import Setup

#: Step widths [m] of tasks that have one, unless given (thesis Tabs. 6.2 to 6.4).
STEP_WIDTHS = (0.05, 0.1, 0.2)

#: Robots sampled from --randomize unless given, and at most.
_DRAWS, _MOST_DRAWS = 5, 100_000


def make_setup(args: Namespace) -> Setup:
    """The robots that the arguments describe.

    Raises:
        ValueError: Arguments of a robot over a serial line for a simulated one, or --robot for one.
        ImportError: Packages of the extra `robot` are missing.
    """
    if "env" not in args:
        return Setup(args)
    if args.env == setups.SIMULATED:
        if given := flags(args, ("robot_file", "port")):
            raise ValueError(f"{given}: only with --env real or virtual")
        return Setup(args)
    from .robot.setup import RealSetup

    if args.robot is not None:
        raise ValueError(f"--robot: only with simulated robots, --env {args.env} has its rig")
    return RealSetup(args)


def make_cases(args: Namespace, setup: Setup) -> list[Case]:
    """Every combination of what was asked for that fits together.

    Raises:
        ValueError: A policy without a task or a task without a policy, an option that no case
            uses, or a value that a case cannot have; before anything is run.
    """
    robot = default_robot() if setup.robot is None else setup.robot
    every = list(entry_of(robot).tasks or tasks_of(robot)) if "all" in args.tasks else []
    makers = {name: find_maker(name, setup.robot) for name in expand_all(args.tasks, every)}
    short = {"step_width": args.step_widths, "speed": args.speeds, "seed": args.path_seeds}
    short = ((name, values) for name, values in short.items() if values)
    given = setups.merge([*args.option, *short])
    setups.check_used(given, makers, setup.robot)
    wanted = {"step_width": list(STEP_WIDTHS)} | given
    tasks = {
        name: [make_task(name, robot=setup.robot, **o) for o in setups.combinations(make, wanted)]
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
    conditions = list(itertools.product(setup.twins(tasks[0].robot), [*given, *sampled]))
    for task in tasks:
        for policy in policies:
            for twin, variation in conditions:
                case = setup.complete(Case(task, policy, variation, twin))
                if variation in sampled:
                    case = replace(case, variation=rounded(variation, setups.period_of(case)))
                yield case


def one_case(args: Namespace, setup: Setup, twin: bool) -> Case:
    """The episode to be shown: of `task_text`, with --policy or else the robot's usual one.

    Args:
        args: The arguments.
        setup: The robots.
        twin: Whether it has the errors of a twin.

    Raises:
        ValueError: A policy of another robot; nothing would be shown.
    """
    task = setups.one_task(args, setup.robot)
    name = args.policy or setup.default_policy(task)
    reason = setup.incompatibility(name, task)
    if reason is not None:
        raise ValueError(
            f"policy {name!r} is not for the task {task.name}: {reason}; choose from "
            f"{', '.join(fitting(task, setup))}"
        )
    case = Case(task, name, twin=setup.twins(task.robot)[0] if twin else None)
    return replace(setup.complete(case), duration=getattr(args, "duration", None))


def left_out(args: Namespace, cases: list[Case]) -> list[str]:
    """Policies that would have been run if their packages were installed."""
    missing = [name for name in POLICIES if name not in installed_policies()]
    made_for = {name for case in cases for name in entry_of(case.task.robot).policies}
    return [name for name in missing if name in made_for] if "all" in args.policies else []


def _for_task(names: list[str], called: str, task: Task, setup: Setup) -> list[str]:
    """Policies among those named that can drive the robot of a task.

    Raises:
        ValueError: There is none.
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
        owners = [robot for robot, made in setups.families().items() if name in made]
        if setup.robot is None and owners:
            fits = ", ".join(tasks_of(owners[0]).own())
            raise ValueError(f"policy {name!r} is for the tasks {fits}")
        refused = "; ".join(f"{robot!r}: {reason}" for robot, reason in reasons)
        raise ValueError(f"policy {name!r} cannot drive robot {refused}")


def _variations(given: list[tuple[str, list[float]]]) -> list[dict[str, float]]:
    """Every combination of what varies, without the values that change nothing."""
    varied = setups.merge(given)
    return [
        {n: v for n, v in zip(varied, values, strict=True) if v != VARIATIONS[n].neutral}
        for values in itertools.product(*varied.values())
    ]


def _draws(args: Namespace) -> list[dict[str, float]]:
    """Variations sampled from --randomize, the same for every policy and task.

    Raises:
        ValueError: A range that is none, or --draws without one.
    """
    if not args.randomize and args.draws is not None:
        raise ValueError("--draws: only with --randomize")
    ranges = Randomization(**{name: tuple(ends) for name, ends in args.randomize})
    rng = np.random.default_rng(0)
    count = (args.draws or _DRAWS) if args.randomize else 0
    if count > _MOST_DRAWS:
        raise ValueError(f"--draws: at most {_MOST_DRAWS} robots, got {count}")
    return [ranges.draw(rng) for _ in range(count)]
