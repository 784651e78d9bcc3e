"""`softrobot render`: a video of a policy on a task."""

import argparse
from dataclasses import replace
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from softrobot_env.commands.arguments import (
    add_feedback,
    add_learnt,
    add_plant,
    add_twin,
    positive,
    size,
)
from softrobot_env.commands.cases import make_setups
from softrobot_env.commands.setups import Setup, setup_of
from softrobot_env.commands.task_options import add_task, one_task
from softrobot_env.control.registry import POLICIES, RIG_POLICIES
from softrobot_env.evaluation.runner import Case

EXAMPLE = """softrobot render --task swing --policy feedforward_pi --out swing.mp4
  softrobot render --task triangle --policy hybrid --option period=1 --out triangle.gif"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_task(parser)
    parser.add_argument(
        "--policy",
        choices=[*POLICIES, *RIG_POLICIES],
        metavar="POLICY",
        help=f"of the arm: {', '.join(POLICIES)}; default: feedforward_pi; of the test rig: "
        f"{', '.join(RIG_POLICIES)}; default: hybrid",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/render.mp4"), metavar="FILE", help=".mp4 or .gif"
    )
    parser.add_argument("--fps", type=int, default=30, help="frames per second; default: 30")
    parser.add_argument("--size", type=size, nargs=2, default=(640, 480), metavar=("W", "H"))
    parser.add_argument("--duration", type=positive, metavar="S", help="default: the task's")
    add_twin(parser)
    add_learnt(parser)
    add_feedback(parser)
    add_plant(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    from softrobot_env.rendering.video import record, write_video

    setups = make_setups(args)
    setup = setup_of(args.task, setups)
    case = _case(args, setup)
    for other in setups:
        other.check([case] if other is setup else [])
    width, height = args.size
    env = setup.environment(case, render_mode="rgb_array", width=width, height=height)
    console = Console()
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task(case.label, total=1.0)
        frames = record(
            env,
            case.make_policy(env.control_period),
            fps=args.fps,
            title=case.label,
            options=case.reset_options,
            progress=lambda share: progress.update(bar, completed=share),
        )
        count = write_video(args.out, frames, fps=args.fps)
    env.close()
    console.print(f"Wrote {args.out} ({count} frames)")
    return 0


def _case(args: argparse.Namespace, setup: Setup) -> Case:
    """The episode to show.

    Raises:
        ValueError: A policy of another robot.
    """
    task = one_task(args)
    policy = args.policy or setup.default_policy
    if policy not in setup.policies:
        raise ValueError(
            f"policy {policy!r} is not for the task {args.task}; choose from "
            f"{', '.join(setup.policies)}"
        )
    case = Case(task, policy, twin=setup.twins()[0])
    return replace(setup.complete(case), duration=args.duration)
