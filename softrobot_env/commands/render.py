"""`softrobot render`: a video of a policy on a task."""

from argparse import Namespace
from math import floor

from softrobot_env.envs.recording import RecordEpisodes
from softrobot_env.evaluation.runner import Case
from softrobot_env.rendering.video import record, write_video

from .arguments import not_negative
from .cases import make_setup, one_case
from .output import check_free, new_file, progress_on, say

#: Default frames per second of a GIF, and default number of frames.
_GIF_FPS, _GIF_FRAMES = 12, 180

EXAMPLE = """softrobot render --task swing --policy feedforward_pi --out swing.mp4
  softrobot render --task triangle --policy hybrid --option period=1 --begin 10 --out fast.gif
  softrobot render --robot my.toml --task circle --policy static --out circle.mp4"""


ARGUMENTS = f"""
    <robot> default: the task's
    <task>
    --policy POLICY  <policies>; or your own, package.module:name or file.py:name; default:
        static
    --out FILE (out/render.mp4)  or a .gif
    <overwrite>
    --fps FPS  frames per second; default: 30, of a .gif {_GIF_FPS}, with {_GIF_FRAMES} frames
        at most
    --size W H  default: 640 480, of a .gif 400 300
    --duration S  default: the task's
    --begin S (0)  what is before is cut, such as the way to where laps begin
    --record FILE  also write a recording, .csv or .parquet
    <twin>
    <identified>
    <feedback>
    <plant>
    <scene>
"""

KINDS = {"begin": not_negative}


def run(args: Namespace) -> int:
    """Run the command."""
    if args.record is not None:
        check_free(args.record, overwrite=args.overwrite)
    setup = make_setup(args)
    case = one_case(args, setup, twin=True)
    lasts = args.duration or case.task.duration
    if args.begin >= lasts:
        raise ValueError(
            f"--begin {args.begin:g}: the episode is over after {lasts:g} s, which --duration "
            "changes"
        )
    setup.check([case])
    fps, (width, height) = _format(args, case)
    env = setup.environment(case, render_mode="rgb_array", width=width, height=height)
    policy = case.make_policy(env.control_period)
    if args.record is not None:
        env = RecordEpisodes(env, args.record)
    count = floor((lasts - args.begin) * fps + 1e-6) + 1

    def drawn(share: float) -> None:
        frame = floor((share * lasts - args.begin) * fps + 1e-6) + 1
        show(f"{case.label}, frame", max(frame, 0), count)

    with new_file(args.out, args.overwrite), progress_on(case.label, count) as show:
        frames = record(
            env,
            policy,
            fps=fps,
            title=case.label,
            begin=args.begin,
            options=case.reset_options,
            progress=drawn,
        )
        count = write_video(args.out, frames, fps=fps)
    env.close()
    say(f"Wrote {args.out} ({count} frames)")
    return 0


def _format(args: Namespace, case: Case) -> tuple[float, tuple[int, int]]:
    """Frames per second, width and height: a GIF stays below some 2 MB unless sizes are given."""
    if args.out.suffix.lower() != ".gif":
        return args.fps or 30, args.size or (640, 480)
    duration = args.duration or case.task.duration
    most = _GIF_FRAMES / (duration - args.begin)
    return args.fps or min(_GIF_FPS, most), args.size or (400, 300)
