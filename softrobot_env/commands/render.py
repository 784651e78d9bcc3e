"""`softrobot render`: a video of a policy on a task."""

import argparse
from pathlib import Path

from rich.console import Console
from rich.progress import Progress

from softrobot_env.commands.arguments import (
    add_feedback,
    add_plant,
    add_task,
    plant_options,
    positive,
    size,
)
from softrobot_env.control.registry import POLICIES, make_policy
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.tasks import make_task

EXAMPLE = "softrobot render --task swing --policy feedforward_pi --out swing.mp4"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_task(parser)
    parser.add_argument("--policy", choices=list(POLICIES), default="feedforward_pi")
    parser.add_argument(
        "--out", type=Path, default=Path("out/render.mp4"), metavar="FILE", help=".mp4 or .gif"
    )
    parser.add_argument("--fps", type=int, default=30, help="frames per second; default: 30")
    parser.add_argument("--size", type=size, nargs=2, default=(640, 480), metavar=("W", "H"))
    parser.add_argument("--duration", type=positive, metavar="S", help="default: the task's")
    add_feedback(parser)
    add_plant(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    from softrobot_env.rendering.video import record, write_video

    task = make_task(args.task, args.step_width)
    width, height = args.size
    env = TrackingEnv(
        task,
        observe="all",
        render_mode="rgb_array",
        width=width,
        height=height,
        **plant_options(args, args.policy),
    )
    policy = make_policy(args.policy, task.robot, env.control_period, args.feedback)
    console = Console()
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task(f"{task.label}, {args.policy}", total=1.0)
        frames = record(
            env,
            policy,
            fps=args.fps,
            title=f"{task.label}, {args.policy}",
            options={} if args.duration is None else {"duration": args.duration},
            progress=lambda share: progress.update(bar, completed=share),
        )
        count = write_video(args.out, frames, fps=args.fps)
    env.close()
    console.print(f"Wrote {args.out} ({count} frames)")
    return 0
