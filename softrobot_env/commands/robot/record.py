"""`softrobot robot record`: excite a robot within limits, and record it for an identification."""

from argparse import Namespace
from contextlib import closing
from dataclasses import fields, replace
from functools import partial

import gymnasium

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.envs.recording import RecordEpisodes
from softrobot_env.evaluation.report import VIRTUAL
from softrobot_env.evaluation.runner import Case
from softrobot_env.identification import excitation
from softrobot_env.recordings import Recording, write_recording
from softrobot_env.recordings.columns import check_writable
from softrobot_env.recordings.files import header_path
from softrobot_env.robots import RobotParams, default_robot, entry_of, find_robot

from ..arguments import SIMULATED
from ..output import check_free, new_file, progress_on, say
from .link import robot_of
from .virtual import real_env

EXAMPLE = """softrobot robot record --twin 3 --out out/rig.csv
  softrobot robot record --robot my.toml --kinds pulls --static --out out/pulls.csv
  softrobot robot record --env real --robot-file rig.toml --amplitude 0.3 --radius 0.1"""

_USUAL = excitation.Excitation()

ARGUMENTS = f"""
    <robot> default: the rig
    --env ENV ({SIMULATED})  out of %(choices)s
    --twin SEED|none  errors of manufacturing and servos of a simulated or virtual robot
        driven by length, unknown to policies; default: of the rig 0, of others none
    --vary NAME=V  deviations of a simulated robot from its file:
        <variations>
    --plant PLANT ({MUJOCO})  of a simulated robot, out of %(choices)s
    --robot-file FILE  of a real robot; default: the robot's own, of the rig as it comes
    <port>
    --control-period S (0.02)
    --kinds KIND+ ({" ".join(_USUAL.kinds)})  out of %(choices)s
    --amplitude X ({_USUAL.amplitude:g})  largest share of full scale
    --speed X ({_USUAL.speed:g})  full scales per second, at most, but for visits
    --levels LEVELS ({_USUAL.levels})  of a pull
    --rest X ({_USUAL.rest:g})  s at each level of a pull
    --decay X ({_USUAL.decay:g})  s after a release
    --duration X ({_USUAL.duration:g})  s of the random motion
    --bandwidth X ({_USUAL.bandwidth:g})  Hz of the random motion, at most
    --points POINTS ({_USUAL.points})  to be visited
    --tension X ({_USUAL.tension:g})  largest tension over the tendons' limits
    --radius X ({_USUAL.radius:g})  m, largest way of the tip from where it rests
    --seed SEED ({_USUAL.seed})  of random motion and of noise
    --static  keep one row for each rest, averaged over its end
    --out FILE (out/recording.csv)  or a .parquet
    <overwrite>
"""

KINDS = {"kinds": excitation.KINDS}


def run(args: Namespace) -> int:
    """Run the command; 1 if the robot was stopped before the end."""
    check_writable(args.out)
    check_free(header_path(args.out), overwrite=args.overwrite)
    with new_file(args.out, args.overwrite):
        return _run(args)


def _run(args: Namespace) -> int:
    """Record and write."""
    robot = default_robot(on_a_line=True) if args.robot is None else find_robot(args.robot)
    planned = excitation.plan(robot, _excitation(args), args.control_period)
    scales = ", ".join(f"{scale:.2g}" for scale in planned.scales)
    say(f"{planned.duration:.0f} s of commands, up to {scales} of full scale")
    recording, stopped = _recorded(args, robot, planned)
    if stopped:
        say(f"Stopped {stopped}", markup=False, soft_wrap=True)
    if args.static:
        recording, moved = excitation.at_rests(recording, planned)
        say(f"At the ends of rests the tip moved by up to {1e3 * moved:.2g} mm")
    write_recording(recording, args.out)
    say(f"Wrote {len(recording.times)} rows to {args.out}, with a header file")
    return int(bool(stopped))


def _recorded(
    args: Namespace, robot: RobotParams, planned: excitation.Plan
) -> tuple[Recording, str | None]:
    """The recording, and why it ended early, or None."""
    options = {"vary": _varied(args)} if args.vary else None
    count, how = len(planned.actions), _excitation(args)
    recorded = closing(RecordEpisodes(_environment(args, robot, planned)))
    with recorded as env, progress_on("record", count) as show:
        tell = partial(show, "record", total=count)
        try:
            stopped = excitation.excite(env, planned, how, args.seed, options, tell)
        except KeyboardInterrupt:  # keep the recording so far
            stopped = "by Ctrl-C"
        return env.recording, stopped


def _excitation(args: Namespace) -> excitation.Excitation:
    given = {field.name: getattr(args, field.name) for field in fields(_USUAL)}
    return replace(_USUAL, **given | {"kinds": tuple(args.kinds)})


def _varied(args: Namespace) -> dict[str, float]:
    several = [name for name, values in args.vary if len(values) > 1]
    if several:
        raise ValueError(f"--vary {several[0]}: one value, as a recording is of one robot")
    if args.vary and args.env != SIMULATED:
        raise ValueError(f"--vary: only with --env {SIMULATED}")
    return {name: values[0] for name, values in args.vary}


def _environment(args: Namespace, robot: RobotParams, planned: excitation.Plan) -> gymnasium.Env:
    """The robot in an environment; a real one is at rest when that is closed."""
    entry, options = entry_of(robot), {"control_period": args.control_period}
    task = excitation.resting_task(robot, planned.duration, entry.axes)
    (seed,) = args.twin or (entry.twin,)
    if args.env == SIMULATED:
        return Case(task, "hold", twin=seed, plant=args.plant, scene=options).environment()

    if args.plant != MUJOCO:
        raise ValueError(f"--plant: only with --env {SIMULATED}")
    make = real_env(robot, args.env == VIRTUAL)
    options["observe"] = "all"
    if args.env != VIRTUAL:
        own = entry.on_a_line or args.robot_file is not None
        return make(task, robot_file=robot_of(args) if own else None, port=args.port, **options)
    if seed is None and entry.on_a_line:
        raise ValueError(f"--twin none: only with --env {SIMULATED}")
    return make(task, seed, **options)
