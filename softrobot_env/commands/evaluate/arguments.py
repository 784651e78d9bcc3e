"""Arguments of `softrobot evaluate`."""

import argparse
from pathlib import Path

from softrobot_env.commands.arguments import (
    add_feedback,
    add_learnt,
    add_out,
    add_plant,
    add_twin,
    names_or_all,
    positive,
    variation,
)
from softrobot_env.commands.setups.choice import ENVIRONMENTS, SIMULATED
from softrobot_env.commands.task_options import Given, merge, option
from softrobot_env.control.registry import POLICIES, RIG_POLICIES
from softrobot_env.envs.disturbances import NEUTRAL
from softrobot_env.tasks import ALL_TASKS, EVERY_TASK, RIG_TASKS, TASKS, UNSEEN_TASKS, WITH_OPTION


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    _add_cases(parser)
    _add_options(parser)
    parser.add_argument("--no-plots", action="store_true", help="skip the plots")
    parser.add_argument("--save-rollouts", action="store_true", help="also write npz records")
    add_twin(parser, several=True)
    add_learnt(parser)
    parser.add_argument(
        "--vary",
        action="append",
        type=variation,
        default=[],
        metavar="NAME=V1,V2",
        help=f"values of one of {', '.join(NEUTRAL)}: of the arm, in SI units or as factors; "
        "controllers keep the nominal robot",
    )
    _add_real(parser)
    add_feedback(parser)
    add_plant(parser)
    add_out(parser, "out/evaluate")


def _add_cases(parser: argparse.ArgumentParser) -> None:
    """--tasks and --policies."""
    parser.add_argument(
        "--tasks",
        nargs="+",
        type=names_or_all(list(EVERY_TASK)),
        default=["all"],
        metavar="TASK",
        help=f"of the arm: {', '.join(ALL_TASKS)}; of the test rig: {', '.join(RIG_TASKS)}; "
        f"default: all, which is {', '.join(TASKS)}. Those of the rig are named explicitly",
    )
    parser.add_argument(
        "--policies",
        nargs="+",
        type=names_or_all([*POLICIES, *RIG_POLICIES]),
        default=["all"],
        metavar="POLICY",
        help=f"of the arm: {', '.join(POLICIES)}; of the test rig: {', '.join(RIG_POLICIES)}; "
        "default: all that fit a task",
    )


def _add_options(parser: argparse.ArgumentParser) -> None:
    """--option, and short forms of some."""
    parser.add_argument(
        "--option",
        action="append",
        type=option,
        default=[],
        metavar="NAME=V1,V2",
        help="values of an option of tasks, in SI units: "
        + "; ".join(f"{name} of {', '.join(tasks)}" for name, tasks in WITH_OPTION.items()),
    )
    parser.add_argument(
        "--step-widths",
        nargs="+",
        type=positive,
        metavar="M",
        help="as --option step_width=...; default: 0.05 0.1 0.2",
    )
    parser.add_argument(
        "--speeds",
        type=_speeds,
        metavar="V1,V2",
        help=f"as --option speed=...; of {', '.join(UNSEEN_TASKS)} the largest of the reference, "
        "default: 0.1",
    )
    parser.add_argument(
        "--path-seeds",
        nargs="+",
        type=int,
        metavar="N",
        help="as --option seed=...; default: 0",
    )


def _add_real(parser: argparse.ArgumentParser) -> None:
    """--env, and where a real robot is."""
    parser.add_argument(
        "--env",
        choices=ENVIRONMENTS,
        default=SIMULATED,
        help="tasks of the rig in simulation, on a virtual robot over a serial line in real time, "
        f"or on a real one; default: {SIMULATED}",
    )
    parser.add_argument(
        "--robot-file",
        type=Path,
        metavar="FILE",
        help="of a real robot, see `softrobot robot calibrate`; default: the rig's",
    )
    parser.add_argument("--port", help="serial port; default: the robot file's")
    parser.add_argument(
        "--record", type=Path, metavar="DIR", help="record the serial line of every episode"
    )


def _speeds(text: str) -> list[float]:
    """`0.05,0.1` as numbers."""
    return [positive(part) for part in text.split(",")]


def given_options(args: argparse.Namespace) -> Given:
    """Values given for options of tasks, in whatever form."""
    short = {"step_width": args.step_widths, "speed": args.speeds, "seed": args.path_seeds}
    return merge([*args.option, *((name, values) for name, values in short.items() if values)])
