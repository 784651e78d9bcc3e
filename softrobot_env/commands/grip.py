"""`softrobot grip`: close a gripper on a bar, report the result, and write a video."""

from argparse import Namespace
from collections.abc import Callable
from math import hypot
from typing import Any

from numpy import ndarray

from softrobot_env.control.gripper import ScriptedGrip, calibrated, senses
from softrobot_env.envs.gripper import GripperEnv, VectorGripperEnv
from softrobot_env.evaluation.run import Moment, play
from softrobot_env.rendering.video import caption, check_suffix, explain, write_video
from softrobot_env.robots import find_gripper
from softrobot_env.scene.assembly import FINENESS
from softrobot_env.tasks.gripper import GRIP_TASKS

from .arguments import positive
from .output import new_file, progress_on, say

EXAMPLE = """softrobot grip --task enclose --diameter 0.06 --tension 20 --out grip.gif
  softrobot grip --task hold --gripper my_gripper.toml --seed 3"""

_FIXED = ("diameter", "mass", "friction")

#: Properties of a sampled gripper, so that it can grip another bar.
_OWN = ("modulus", "arm", "sensor_errors", "specimen")


ARGUMENTS = """
    --task TASK (hold)  out of %(choices)s
    --gripper GRIPPER (gripper)  a gripper file (*.toml), or one out of <grippers>
    --tension N (30)  of all tendons
    --diameter M  default: sampled
    --mass KG  default: sampled
    --friction 1  default: sampled
    --seed SEED (0)  of the samples
    --fineness FINENESS (quick)  out of %(choices)s
    --pieces PIECES  of each finger; default: by fineness
    --timestep S  default: by fineness
    --out FILE  .mp4 or .gif; default: no video
    <overwrite>
    --fps FPS (25)  frames per second
    --size W H (640 480)
"""

KINDS = {"task": GRIP_TASKS, "fineness": FINENESS, "tension": positive, "friction": positive}


def run(args: Namespace) -> int:
    """Run the command."""
    if args.out is None:
        return _run(args)
    check_suffix(args.out)
    with new_file(args.out, args.overwrite):
        return _run(args)


def _run(args: Namespace) -> int:
    """Close the gripper, and show it if requested."""
    gripper = find_gripper(args.gripper)
    span = 2 * max(hypot(*one.base.position[:2]) + one.robot.reach for one in gripper.fingers)
    if (args.diameter or 0.0) > span:
        raise ValueError(f"--diameter: its fingers span {span:.3g} m, got {args.diameter:g} m")
    filmed = args.out is not None
    sensed = filmed and senses(gripper)
    how = {
        "gripper": gripper,
        "fineness": args.fineness,
        "pieces": args.pieces,
        "timestep": args.timestep,
        "observe": ("sensors",) if sensed else ("curvature",),
    }
    pictured = {"render_mode": "rgb_array" if filmed else None}
    pictured |= dict(zip(("width", "height"), args.size, strict=True))
    env = GripperEnv(args.task, **how, **pictured)
    policy = ScriptedGrip(env.gripper, env.control_period, args.tension)
    fixed = {name: getattr(args, name) for name in _FIXED if getattr(args, name) is not None}
    pictures, info, shape = [], {}, None
    with progress_on(args.task, env.max_episode_steps) as show:
        for count, moment in enumerate(play(env, policy, args.seed, fixed), 1):
            info = moment.info
            if sensed:
                shape = shape or _calibrated(how, moment, args.seed)
                env.shown = shape(moment.observation["sensors"])
            show(args.task, count, env.max_episode_steps)
            if filmed and info["time"] * args.fps + 1e-6 >= len(pictures):
                pictures.append(_picture(env, args, info))
    env.close()
    say(_outcome(info))
    if filmed:
        count = write_video(args.out, pictures, args.fps)
        say(f"Wrote {args.out} ({count} frames)")
    return int("failure" in info)


def _calibrated(how: dict[str, Any], start: Moment, seed: int) -> Callable[[ndarray], ndarray]:
    """Function from readings to curvatures (pieces,) [1/m], for the gripper of an episode."""
    own = {name: start.info[name] for name in _OWN}
    found = calibrated(VectorGripperEnv(1, "enclose", **how), own, seed + 1)
    straight = start.observation["sensors"]
    return lambda readings: found.curvature(readings, straight)[0]


def _picture(env: Any, args: Namespace, info: dict[str, Any]) -> Any:
    picture = explain(env.render(), env.metres_per_pixel, float(env.gripper.tension_limits.max()))
    now = float(env.simulation.ctrl[0, 0])
    text = f"{1e3 * info['diameter']:.0f} mm, t = {info['time']:.2f} s, {now:.0f} N"
    known = "its mean curvatures" if env.shown is None else "the calibrated sensors"
    return caption(picture, [args.task, text, f"blue: shape by {known}"])


def _outcome(info: dict[str, Any]) -> str:
    verdict = info.get("failure") or ("success" if info["success"] else "no success")
    return (
        f"bar of {1e3 * info['diameter']:.1f} mm: {verdict}; error {100 * info['error']:.0f} % of "
        f"the limit, after {info['time']:.2f} s"
    )
