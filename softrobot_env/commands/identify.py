"""`softrobot identify`: find a robot's parameters in a recording of it."""

from argparse import Namespace
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from softrobot_env.core.interfaces import ProgressCallback
from softrobot_env.core.processes import chosen_processes, using
from softrobot_env.identification.fit import report
from softrobot_env.identification.fit.path import Identification, check_stages, identify, placed
from softrobot_env.identification.fit.report import ErrorRow, chain_row, parameter_rows
from softrobot_env.identification.replay import replay
from softrobot_env.recordings import read_recording
from softrobot_env.rendering.recordings import plot_identification
from softrobot_env.robots import find_robot

from . import output
from .output import say
from .recording import FILE_TEXT

EXAMPLE = """softrobot identify train.csv --header assets/recordings/ftdcr_v4.toml --robot ftdcr_v4
  softrobot identify pulls.csv --robot my.toml --stages frame,tendons,statics"""

_STAGES = ("frame", "tendons", "geometry", "statics", "dynamics", "residual", "network")


ARGUMENTS = f"""
    {FILE_TEXT}
    <robot!> as you believe it to be
    --stages A,B ({",".join(_STAGES)})  stages to run; the rest stays as in the robot file;
        default: all, {",".join(_STAGES)}
    --known A,B  kinds of parameters that the robot file gives exactly, such as
        mass,tendon_radius
    --any-turn  the recording's frame may be anywhere and turned in any way; about the robot's
        axis it may be turned anyway where the columns' tendons are not known
    --no-validation  skip the cross-validation, which takes half of the time and gives the errors
        to expect of unseen recordings
    <no-plots>
    <workers>; those of the assignment, of further starts and of the cross-validation;
        default: two processes, of the cross-validation alone
    --out DIR (out/identify)
    <overwrite>
"""


@output.filling
def run(args: Namespace) -> int:
    """Run the command.

    Raises:
        FileExistsError: Results exist, and --overwrite is not given.
        ValueError: The recording or robot cannot be used for an identification; the message says
            why.
    """
    began = perf_counter()
    stages = check_stages(args.stages)
    robot = find_robot(args.robot)
    recording = read_recording(args.recording, args.header)
    # The last one keeps the cluster open: it is started, or connected to, once for all parts.
    with output.progress_on("identify") as show, using(args.workers), chosen_processes():
        found = identify(
            recording,
            robot,
            stages,
            known=args.known or (),
            any_turn=args.any_turn,
            validate=not args.no_validation,
            show=show,
        )
        chain = _on_chain(found, show)
    say(report.tables(found, chain, whole=False))
    files = report.write_files(found, args.out)
    tables, rows = report.tables(found, chain, whole=True), report.report_rows(found, chain)
    say(f"{perf_counter() - began:.0f} s")
    draw = partial(_plot, found, args)
    output.write_report(args, rows, "Identification of a robot", tables, draw, files)
    return 0


def _on_chain(found: Identification, show: ProgressCallback) -> ErrorRow | None:
    """Errors of the identified robot, simulated by the MuJoCo chain."""
    static = placed(found.recording, replace(found.header, static=True))
    tell = partial(show, "MuJoCo chain", total=len(static.times))
    tell(0)
    error = replay(static, found.robot, progress=tell).error
    return None if np.isnan(error).all() else chain_row(error)


def _plot(found: Identification, args: Namespace) -> None:
    errors = {"fitted": found.fit.simulated.error[:, -1]}
    if (left_out := found.validation) is not None:
        errors[f"{report.LEFT_OUT} of the fit"] = left_out.error[:, -1]
        if left_out.corrected is not None:
            errors[f"{report.LEFT_OUT}, with residual"] = left_out.corrected[:, -1]
    rows = [row for row in parameter_rows(found) if row.found]
    title = f"{args.recording.name}, {found.believed.name}"
    plot_identification(found.recording.markers[:, -1], errors, rows, title, args.out)
