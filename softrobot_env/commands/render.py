"""`softrobot render`: a video of a policy on a task."""

import argparse
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from softrobot_env.commands.arguments import (
    add_feedback,
    add_learnt,
    add_plant,
    add_robot,
    add_twin,
    policy,
    positive,
    size,
)
from softrobot_env.commands.cases import fitting, make_setup
from softrobot_env.commands.output import add_out, check_free, new_file, progress_on
from softrobot_env.commands.setups import Setup
from softrobot_env.commands.task_options import add_task, one_task
from softrobot_env.envs.recording import RecordEpisodes
from softrobot_env.evaluation.runner import Case
from softrobot_env.robots import ENTRIES

#: Frames per second of a GIF, and frames in all, unless told.
_GIF_FPS, _GIF_FRAMES = 12, 180

EXAMPLE = """softrobot render --task swing --policy feedforward_pi --out swing.mp4
  softrobot render --task triangle --policy hybrid --option period=1 --begin 10 --out fast.gif
  softrobot render --robot my.toml --task circle --policy static --out circle.mp4"""


def _policies() -> str:
    """Policies of robots that have some of their own, for people."""
    entries = [entry for entry in ENTRIES.values() if entry.policies]
    own = (
        f"of the {e.robot.name}: {', '.join(e.policies)}; default: {e.policy}; " for e in entries
    )
    return "".join(own)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_robot(parser, "default: the task's")
    add_task(parser)
    parser.add_argument(
        "--policy",
        type=policy,
        metavar="POLICY",
        help=f"{_policies()}or one's own, package.module:name or file.py:name; default: static",
    )
    add_out(parser, "out/render.mp4", ", or a .gif", "FILE")
    parser.add_argument(
        "--fps",
        type=positive,
        help=f"frames per second; default: 30, of a .gif {_GIF_FPS}, with {_GIF_FRAMES} frames at "
        "most",
    )
    parser.add_argument(
        "--size",
        type=size,
        nargs=2,
        metavar=("W", "H"),
        help="default: 640 480, of a .gif 400 300",
    )
    parser.add_argument("--duration", type=positive, metavar="S", help="default: the task's")
    parser.add_argument(
        "--begin",
        type=positive,
        default=0.0,
        metavar="S",
        help="what is before is not shown, such as the way to where laps begin; default: 0",
    )
    parser.add_argument(
        "--record", type=Path, metavar="FILE", help="also write a recording, .csv or .parquet"
    )
    add_twin(parser)
    add_learnt(parser)
    add_feedback(parser)
    add_plant(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    from softrobot_env.rendering.video import record, write_video

    if args.record is not None:
        check_free(args.record, overwrite=args.overwrite)
    setup = make_setup(args)
    case = _case(args, setup)
    setup.check([case])
    fps, (width, height) = _format(args, case)
    env = setup.environment(case, render_mode="rgb_array", width=width, height=height)
    policy = case.make_policy(env.control_period)
    if args.record is not None:
        env = RecordEpisodes(env, args.record)
    console = Console()
    with (
        new_file(args.out, args.overwrite),
        progress_on(console) as progress,
    ):
        bar = progress.add_task(case.label, total=1.0)
        frames = record(
            env,
            policy,
            fps=fps,
            title=case.label,
            begin=args.begin,
            options=case.reset_options,
            progress=lambda share: progress.update(bar, completed=share),
        )
        count = write_video(args.out, frames, fps=fps)
    env.close()
    console.print(f"Wrote {args.out} ({count} frames)")
    return 0


def _format(args: argparse.Namespace, case: Case) -> tuple[float, tuple[int, int]]:
    """Frames per second, width and height: a GIF stays below some 2 MB unless told otherwise."""
    if args.out.suffix.lower() != ".gif":
        return args.fps or 30, args.size or (640, 480)
    duration = args.duration or case.task.duration
    most = _GIF_FRAMES / (duration - args.begin)
    return args.fps or min(_GIF_FPS, most), args.size or (400, 300)


def _case(args: argparse.Namespace, setup: Setup) -> Case:
    """The episode to show.

    Raises:
        ValueError: A policy of another robot; nothing would be shown.
    """
    task = one_task(args, setup.robot)
    name = args.policy or setup.default_policy(task)
    reason = setup.incompatibility(name, task)
    if reason is not None:
        raise ValueError(
            f"policy {name!r} is not for the task {task.name}: {reason}; choose from "
            f"{', '.join(fitting(task, setup))}"
        )
    if args.begin >= (args.duration or task.duration):
        raise ValueError(
            f"--begin {args.begin:g}: the episode is over after {args.duration or task.duration:g} "
            "s, which --duration changes"
        )
    case = Case(task, name, twin=setup.twins(task.robot)[0])
    return replace(setup.complete(case), duration=args.duration)
