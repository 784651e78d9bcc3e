"""Damping, friction and delay of rods by `mujoco.sysid`, beside what `softrobot identify` finds.

Rods are those of `softrobot benchmark identify`, by other seeds. Both are given the same windows of
the same recordings, statics that were found before, and MuJoCo's chain; mujoco.sysid steps it by
MuJoCo's integrator. Needs `pip install "mujoco[sysid]"`.

    python scripts/sysid.py --out out
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import mujoco
import numpy as np
from mujoco.sysid._src.optimize import calculate_intervals, optimize
from mujoco.sysid._src.parameter import Parameter, ParameterDict
from mujoco.sysid._src.residual import build_residual_fn
from mujoco.sysid._src.timeseries import SignalType, TimeSeries
from mujoco.sysid._src.trajectory import ModelSequences, create_initial_state
from numpy import ndarray

from softrobot_env.commands.output import new_results
from softrobot_env.core.files import write_text
from softrobot_env.envs.simulation.plants import MujocoPlant
from softrobot_env.evaluation.report import write_json
from softrobot_env.identification.fit import path
from softrobot_env.identification.fit.dynamics import Dynamics, dynamics_of, windows_of
from softrobot_env.recordings import Recording
from softrobot_env.rendering.tables import text_page
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import Scene, scene_xml
from studies.lab import Record, quantity, table
from studies.truths.rubbing_rod import BELIEVED, Truth, drawn, recorded

#: Seed, truth, and the robot that the dynamics are found from.
Rod = tuple[int, Truth, RobotParams]

SEEDS = (1000, 1001, 1002)
_STAGES = ("frame", "statics", "dynamics")
_MM = 1e-3


@dataclass(frozen=True, kw_only=True)
class SysidRow(Record):
    """What was found of a rod.

    Attributes:
        rod: Its seed.
        by: "softrobot" or "mujoco.sysid".
        damping, friction: Relative errors.
        damping_size, friction_size: Their sizes.
        inside: Whether the damping's 95 % interval holds the truth.
        interval: Half of the 95 % interval of the damping [1].
        delay: Error [s].
        rms: [m] of the markers' errors in the windows, their means left out.
        time: [s].
    """

    rod: int = quantity("", "d")
    by: str
    damping: float = quantity("%", "+.1f")
    friction: float = quantity("%", "+.1f")
    damping_size: float
    friction_size: float
    inside: bool
    interval: float = quantity("%", ".1f", "95 %: +-")
    delay: float = quantity("ms", "+.1f")
    rms: float = quantity("mm", ".2f", "RMS")
    time: float = quantity("s", ".1f")


def _row(by: str, rod: Rod, *found: float, interval: float, **own: float) -> SysidRow:
    """A row, from the logarithms of factors on damping and friction, and the delay [s]."""
    seed, truth, robot = rod
    first = np.mean([t.friction for t in robot.tendons])
    damping = float(np.exp(found[0]) / truth.damping - 1)
    friction = float(first * np.exp(found[1]) / truth.friction - 1)
    sizes = {"damping_size": abs(damping), "friction_size": abs(friction)}
    own |= {"inside": bool(abs(np.log1p(damping)) <= interval), "interval": interval}
    errors = {"damping": damping, "friction": friction, "delay": found[2] - truth.delay}
    return SysidRow(rod=seed, by=by, **errors, **sizes, **own)


def rows_of(seed: int) -> list[SysidRow]:
    """What both find of a rod."""
    truth, given, times = drawn(seed), [], []

    def watched(robot: RobotParams, moving: Recording, *others: Any, **more: Any) -> Dynamics:
        given.append((robot, moving))
        begin = perf_counter()
        found = dynamics_of(robot, moving, *others, **more)
        times.append(perf_counter() - begin)
        return found

    path.dynamics_of = watched
    known = ("mass", "marker_offset")
    recording = recorded(truth, seed)
    own = path.identify(recording, BELIEVED, _STAGES, known=known, validate=False).dynamics
    robot, moving = given[0]
    rod, half = (seed, truth, robot), float(1.96 * own.deviation[0])
    found = own.values[0], own.friction[0], own.delay
    ours = _row("softrobot", rod, *found, interval=half, rms=own.after, time=times[0])
    return [ours, _by_sysid(rod, windows_of(moving))]


def _by_sysid(rod: Rod, windows: Recording) -> SysidRow:
    robot = rod[2]
    begin = perf_counter()
    found = ParameterDict()
    bounds = {"damping": (0.0, -2.0, 2.0), "friction": (0.0, -1.5, 1.5), "delay": (0.02, 0.0, 0.1)}
    for name, ends in bounds.items():
        found.add(Parameter(name, *ends))

    def scene_of(values: ParameterDict) -> Scene:
        damping, rubs = (float(np.exp(values[n].value[0])) for n in ("damping", "friction"))
        tendons = tuple(replace(t, friction=t.friction * rubs) for t in robot.tendons)
        built = replace(robot, tendons=tendons).vary(damping_time=damping)
        return MujocoPlant(built, 0.01, actuation="tension").nominal

    scene = scene_of(found)
    sequences, postures = _sequences(scene, windows, robot)
    residual = build_residual_fn(
        models_sequences=[sequences],
        build_model=lambda values, spec: scene_of(values).model,
        modify_residual=_residual(scene, postures),
        n_threads=1,
        resample_true=False,
    )
    found, result = optimize(found, residual, verbose=False, max_iters=20)
    taken = perf_counter() - begin
    left = [np.ravel(part) for part in residual(result.x, found)[0]]
    _, half = calculate_intervals(left, result.jac)
    values = (float(found[name].value[0]) for name in bounds)
    rms = _MM * float(np.sqrt(3 * np.mean(np.concatenate(left) ** 2)))
    return _row("mujoco.sysid", rod, *values, interval=float(half[0]), rms=rms, time=taken)


def _sequences(
    scene: Scene, windows: Recording, robot: RobotParams
) -> tuple[ModelSequences, list[ndarray]]:
    """The windows, whose markers carry their window's number and whether they count; postures."""
    model, controls = scene.model, windows.controls(robot)
    step, names, begins, commands, seen, postures = model.opt.timestep, [], [], [], [], []
    for run in range(int(windows.runs[-1]) + 1):
        rows = np.flatnonzero(windows.runs == run)
        times, places = windows.times[rows], windows.markers[rows, 0]
        count = round(times[-1] / step)
        held = np.searchsorted(times, (np.arange(count) + 0.5) * step, side="right") - 1
        q = scene.equilibrium(controls[rows[0]])
        about = np.full(len(rows), float(run)), np.isfinite(places[:, 0])
        table = np.column_stack([np.nan_to_num(places), *about])
        names.append(f"window {run}")
        postures.append(q)
        begins.append(create_initial_state(model, q))
        command = step * np.arange(count), controls[rows[held]]
        commands.append(TimeSeries.from_control_names(*command, model))
        seen.append(TimeSeries.from_custom_map(times, table, [("tip", 5, SignalType.CustomObs)]))
    spec = mujoco.MjSpec.from_string(scene_xml(scene.config))
    return ModelSequences("rod", spec, names, begins, commands, seen, True), postures


def _residual(scene: Scene, postures: list[ndarray]) -> Callable[..., Any]:
    def residual(
        values: ParameterDict,
        simulated: TimeSeries,
        measured: TimeSeries,
        model: mujoco.MjModel,
        everything: bool,
        state: ndarray,
    ) -> tuple[ndarray, TimeSeries, TimeSeries]:
        run, counts = int(measured.data[0, 3]), measured.data[:, 4] > 0
        q = np.vstack([postures[run], state[:, 1 : 1 + model.nq]])
        tip, times = scene.tip(q), np.append(0.0, state[:, 0])
        late = measured.times - float(values["delay"].value[0])
        at = np.stack([np.interp(late, times, tip[:, axis]) for axis in range(3)], axis=1)
        error = (at - measured.data[:, :3])[counts]
        return np.ravel(error - error.mean(axis=0)) / _MM, measured, measured

    return residual


def main() -> None:
    """Make the report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out"))
    parser.add_argument("--overwrite", action="store_true")
    args = parser.parse_args()
    rows = [row for seed in SEEDS for row in rows_of(seed)]
    shown = "rod", "by", "damping", "interval", "friction", "delay", "rms", "time"
    (found,) = table("Rods in motion: errors of what was found", *shown)(rows)
    command = "python scripts/sysid.py " + " ".join(sys.argv[1:])
    out = args.out / "sysid"
    with new_results(out, args.overwrite):
        write_json(out / "report.json", [row.row() for row in rows], command)
        write_text(out / "report.md", text_page("Damping by mujoco.sysid", found, command))
    print((out / "report.md").read_text())


if __name__ == "__main__":
    main()
