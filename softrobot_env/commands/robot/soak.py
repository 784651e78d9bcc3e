"""`softrobot robot soak`: a long run at full rate, checked against its limits."""

from argparse import Namespace
from contextlib import closing
from dataclasses import replace
from math import ceil, isnan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy import ndarray
from rich.table import Table

from softrobot_env.control.registry import make_policy
from softrobot_env.core.artifacts import read_arrays
from softrobot_env.core.files import read_table
from softrobot_env.envs.real import RealEnv
from softrobot_env.evaluation.report import write_json
from softrobot_env.evaluation.run import Columns, play
from softrobot_env.hardware.interface import HardwareFile
from softrobot_env.hardware.registry import HARDWARE, find_hardware
from softrobot_env.hardware.tip import TipSource
from softrobot_env.rendering.tables import named_values
from softrobot_env.robots import RobotParams, default_robot, entry_of, find_robot, usual_task
from softrobot_env.tasks import Task, make_task

from ..output import filling, progress_on, say
from .virtual import FIRMWARE, virtual_process

EXAMPLE = "softrobot robot soak --seconds 60"

_PERIOD = 2.0  # s, of a lap
_MOST_MISSED = 1e-3  # share of the steps
_OLDEST = 1.0  # s

#: Of `info`, in every step.
_SAMPLED = ("rtt_s", "lateness_s", "tip_age", "error")

#: Of the link, see `hardware.protocol.session.LinkCounters`.
_COUNTERS = (
    "lost",
    "crc_errors",
    "frame_errors",
    "device_crc_errors",
    "device_frame_errors",
    "longest_delay",
)

#: Interval [s] over which the speed of outputs is checked: pulses change at single ticks.
_WINDOW = 0.05


ARGUMENTS = """
    --seconds S (600)  duration
    --robot-file FILE  a real robot, as of `softrobot robot info`; default: a virtual one
    --hardware KIND (firmware)  of the virtual robot, out of %(choices)s
    --robot ROBOT  of virtual motors: a robot driven by length, its name or file; default: the rig
    --twin SEED  of the virtual robot; default: of a board 0, of motors the nominal
    --out DIR (out/soak)
    <overwrite>
"""

KINDS = {"hardware": tuple(HARDWARE)}


@filling
def run(args: Namespace) -> int:
    """Run the command; 1 if a limit was exceeded."""
    robot = default_robot(on_a_line=True) if args.robot is None else find_robot(args.robot)
    if args.robot_file is not None:
        if "hardware" in read_table(args.robot_file):
            robot = find_robot(args.robot_file)
        row = soak(robot, find_hardware(args.robot_file), None, args.seconds)
    else:
        row = soak_virtual(args.hardware, robot, args.twin, args.seconds)
    promises = _promises(row)
    write_json(args.out / "report.json", [row, *promises], args.command_line)
    say(_table(row, promises))
    say(f"Wrote {args.out}/report.json")
    return int(not all(kept["met"] for kept in promises))


def soak_virtual(kind: str, robot: RobotParams, twin: int | None, seconds: float) -> dict[str, Any]:
    """The row of a virtual robot, including data of its own log."""
    own = {} if kind == FIRMWARE else {"kind": kind, "robot": robot}
    seed = 0 if kind == FIRMWARE and twin is None else twin
    with TemporaryDirectory() as folder:
        log = Path(folder) / "log.npz"
        with virtual_process(seed, log=log, **own) as virtual:
            row = soak(robot, virtual.file, virtual.tip, seconds)
        return row | unsafe_outputs(read_arrays(log), virtual.file)


def soak_task(robot: RobotParams, seconds: float) -> tuple[Task, str]:
    """Task and policy for a run of this length [s]: laps of the rig's task, or points."""
    if entry_of(robot).on_a_line:
        task = make_task(usual_task(robot), robot=robot, period=_PERIOD)
        run, policy = replace(task.trajectory, laps=max(0, int(seconds / _PERIOD))), "hybrid"
    else:
        task, policy = make_task("reach", robot=robot), "static"
        again = ceil(seconds / task.duration)
        run = replace(task.trajectory, points=task.trajectory.points * again)
    return replace(task, name="soak", trajectory=run, duration=seconds), policy


def soak(
    robot: RobotParams, file: HardwareFile, tip: TipSource | None, seconds: float
) -> dict[str, Any]:
    """Measurements of a run of this length [s], of a real robot or a virtual one."""
    task, policy = soak_task(robot, seconds)
    # Missed steps do not end the run: they are checked afterwards.
    steps = round(seconds / file.control_period)
    # A stall counts as missed steps and late answers, and does not end the run.
    env = RealEnv(task, robot_file=file, tip=tip, max_missed=steps, oldest=_OLDEST)
    policy = make_policy(policy, robot, env.control_period)
    samples, last = Columns(), {}
    with closing(env), progress_on("soak", seconds) as show:
        for count, moment in enumerate(play(env, policy)):
            last = moment.info
            if count > 0:
                # Keeping `info` itself would slow later steps down (garbage collection).
                samples.add({name: last[name] for name in _SAMPLED})
            if count % 50 == 0:
                show("soak", last["time"], seconds)
    return _measured(samples.columns(), last, env.control_period)


def _measured(samples: dict[str, ndarray], last: dict[str, Any], period: float) -> dict[str, Any]:
    trips = [None if isnan(trip) else trip for trip in samples["rtt_s"]]
    row = {"what": "soak", "steps": round(last["time"] / period), "control_period": period}
    row |= {"missed_steps": int(last["missed_steps"]), "failure": last.get("failure")}
    columns = {"round_trip": answer_times(trips, period), "lateness": samples["lateness_s"]}
    for name, values in columns.items():
        quantiles = np.percentile(values, [50, 99, 100]).tolist()
        row |= dict(zip((f"{name}_median", f"{name}_p99", f"{name}_max"), quantiles, strict=True))
    row["tip_age_max"] = max(samples["tip_age"])
    row["e_mean"] = float(np.mean(samples["error"]))
    return row | {name: float(last[f"link_{name}"]) for name in _COUNTERS}


def answer_times(trips: list[float | None], period: float) -> list[float]:
    """How long [s] every step waited for an answer.

    Args:
        trips: Round trip [s] of every step, None without an answer in its period: such a step
            waited for the answer to a later one.
        period: [s].
    """
    times, following = [], period
    for trip in reversed(trips):
        following = period + following if trip is None else trip
        times.append(following)
    return times[::-1]


def unsafe_outputs(log: dict[str, ndarray], file: HardwareFile) -> dict[str, Any]:
    """Number of times a virtual robot's outputs left the range or exceeded the allowed speed.

    Args:
        log: Log written by `softrobot robot virtual --log`.
        file: The limits.
    """
    time, applied = log["time"], log["applied"]
    low, high = np.array([[s.minimum, s.maximum] for s in file.tendons]).T
    outside = np.any((applied < low - 1e-9) | (applied > high + 1e-9), axis=1)
    after = np.searchsorted(time, time + _WINDOW)
    first = np.arange(len(time))[after < len(time)]
    after = after[after < len(time)]
    way = np.abs(applied[after] - applied[first]).max(axis=1)
    # Outputs change a tick before or after they are logged.
    allowed = file.slew * (time[after] - time[first] + 2e-3) + 2e-5
    return {"ticks": len(time), "unsafe_outputs": int(outside.sum() + np.sum(way > allowed))}


def _promises(row: dict[str, Any]) -> list[dict[str, Any]]:
    """Values of a run, their upper limits, and whether they are met."""
    kept = {
        "share of missed steps": (row["missed_steps"] / row["steps"], _MOST_MISSED),
        "round trip, 99 % [s]": (row["round_trip_p99"], row["control_period"]),
        "failures": (float(row["failure"] is not None), 0.0),
    }
    if "unsafe_outputs" in row:
        kept["unsafe outputs"] = float(row["unsafe_outputs"]), 0.0
    return [
        {"promise": name, "value": value, "limit": limit, "met": value <= limit}
        for name, (value, limit) in kept.items()
    ]


def _table(row: dict[str, Any], promises: list[dict[str, Any]]) -> Table:
    values = {k: f"{v:.4g}" if isinstance(v, float) else str(v) for k, v in row.items()}
    for kept in promises:
        verdict = "met" if kept["met"] else "BROKEN"
        values[kept["promise"]] = f"{kept['value']:.4g}, at most {kept['limit']:.4g}: {verdict}"
    return named_values("Soak", values)
