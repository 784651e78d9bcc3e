"""`softrobot train`: make the trained artifacts that policies load, for any robot."""

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

from softrobot_env.core.files import file_name
from softrobot_env.core.processes import using
from softrobot_env.core.runs import KEPT, kept_rows
from softrobot_env.rendering.tables import named_values
from softrobot_env.robots import RobotParams, default_robot, find_robot
from softrobot_env.robots.artifacts import (
    artifact_folder,
    artifact_name,
    looked_up,
    training_folder,
)
from softrobot_env.training import registry
from softrobot_env.training.request import LEARNERS, Training, TrainingRequest, file_of
from softrobot_env.training.rl_config import (
    IMITATION,
    ROBOT_TASKS,
    SCRATCH_SETTINGS,
    TRAINING_TASKS,
    checkpoint_of,
)
from softrobot_env.training.several import report, runs
from softrobot_env.training.several.report import plot
from softrobot_env.training.several.runs import Run

from . import arguments, output
from .arguments import declare, of_text
from .output import say

#: Where several runs are written, in a folder named after the training.
SEVERAL_RUNS = Path("out") / "trainings"

ALGORITHMS = tuple(SCRATCH_SETTINGS)

EXAMPLE = """softrobot train lq_preview --robot my.toml
  softrobot train imitation --robot my.toml --teacher lq_preview
  softrobot train ppo --robot my.toml --start none
  softrobot train ppo --seeds 0..4 --set rate=1e-4,3e-4 --workers 4
  softrobot train rig_nn --twin 3"""


#: Arguments of reinforcement learning.
LEARNING = f"""
    [reinforcement learning]
    --task TASK+ (all)  out of {", ".join(TRAINING_TASKS)} (random references), of other robots
        than the arm out of {", ".join(ROBOT_TASKS)}
    --start NETWORK ({IMITATION})  file of a network to start from, imitation (the one in --out,
        else where policies look) or none
    --randomize  sample robots and disturbances from broad ranges, not only Young's modulus
    --backend BACKEND (mujoco)  what simulates: MuJoCo, or MuJoCo Warp (warp) on a graphics card
        (see docs/howto/gpu.md)
    --device DEVICE  of the backend warp: cuda:0 unless given, or cpu
    --steps STEPS  environment steps; default: by algorithm
    --set NAME=V1,V2  another number of training.rl_config.RLConfig, for instance rate=1e-4;
        with several values a run for each
"""


def add_arguments(parser: ArgumentParser) -> None:
    """Arguments of the command."""
    chance = """
        --seed SEED  random seed; default: 0
        --seeds A..B|A,B  a run for each; with this, several values of --set or --workers, runs have
            folders in that of --out, and the same command resumes unfinished ones
    """
    declare(parser.add_mutually_exclusive_group(), chance)
    text = f"""
        what NAME?  policy to train, out of %(choices)s; or give --algo
        <robot> a name or a file; default: the thesis' of the artifact
        <workers>; several runs at a time; default: as many processes as cores
        --out DIR  default: beside the file of your own robot, else out; of several runs
            {SEVERAL_RUNS}/NAME
        <overwrite>
        --ship  write what comes with the package: models/, or beside the robots in assets/
        --quick  seconds, to check that everything runs; not a good policy
        --twin SEED  of the twin measured by rig_nn; default: 0. Others than 0 go to a file with the
            seed in its name, for `softrobot evaluate --identified`
        --recording FILE  that ssm learns from, see `softrobot recording`; default: motion that is
            simulated
        --teacher POLICY  that imitation learns from; default: of the arm mpc_preview, else
            lq_preview
        {LEARNING}
        --algo NAME  algorithm of stable-baselines3, as NAME, out of %(choices)s
        --name NAME  of the file written; default: the algorithm's
        --checkpoint DIR  folder with what --resume needs; default: out/train/NAME
        --resume  resume from the checkpoint
        --log DIR  folder for TensorBoard logs
    """
    kinds = LEARNING_KINDS | {"name": of_text(file_name)}
    declare(parser, text, what=registry.TRAININGS, algo=ALGORITHMS, **kinds)


def _setting(text: str) -> tuple[str, tuple[float, ...]]:
    """`name=number` or `name=number,number`."""
    name, _, values = text.partition("=")
    try:
        return name, tuple(dict.fromkeys(map(float, values.split(","))))
    except ValueError:
        raise ArgumentTypeError(f"{text!r} is not NAME=NUMBER or N1,N2") from None


#: Kinds of the arguments of `LEARNING`, see `arguments.declare`.
LEARNING_KINDS = {
    "task": (*TRAINING_TASKS, *ROBOT_TASKS, "all"),
    "backend": ("mujoco", "warp"),
    "set": _setting,
}


def given(args: Namespace) -> dict[str, Any]:
    """The given settings of a training; of several values of one, the first."""
    parser = ArgumentParser()
    add_arguments(parser)
    names = ("twin", "recording", "teacher", "quick", *registry.REINFORCEMENT)
    found = {name: getattr(args, name) for name in names if hasattr(args, name)}
    found["set"] = [(name, values[0]) for name, values in found["set"]]
    return {name: value for name, value in found.items() if value != parser.get_default(name)}


def run(args: Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: Neither an artifact nor an algorithm is given, or both; an argument or robot
            does not belong to them; or the file exists.
        ImportError: A package is missing; the message says what to install.
    """
    if (args.what is None) == (args.algo is None):
        raise ValueError(
            f"give an artifact ({', '.join(registry.TRAININGS)}) or an algorithm (--algo "
            f"{', '.join(ALGORITHMS)})"
        )
    name, args.seed = args.what or args.algo, args.seed or 0
    training, settings = registry.TRAININGS[name], given(args)
    robot = (training.robot or default_robot()) if args.robot is None else find_robot(args.robot)
    training.check(robot, settings)
    check_settings(training, settings)
    values = dict(args.set)  # of one given twice, the last
    if args.seeds or args.workers or any(len(own) > 1 for own in values.values()):
        return train_several(args, name, robot, settings, values)
    request = TrainingRequest(robot, _path(args, name, robot), args.seed, settings)
    began = perf_counter()
    with ExitStack() as held:
        held.enter_context(
            output.new_file(request.path, args.overwrite or bool(settings.get("resume")))
        )
        if "checkpoint" in training.options:
            folder = checkpoint_of(settings, request.path)
            held.enter_context(output.claimed(folder))
            output.check_folder(folder)
        request.path.parent.mkdir(parents=True, exist_ok=True)
        show = held.enter_context(output.progress_on(name, prefix=f"{name}: "))
        figures = training.run(request, show)
    figures = dict(figures) | {"time": f"{perf_counter() - began:.1f} s"}
    say(named_values(f"{name} of {robot.name}, seed {args.seed}", figures))
    say(f"Wrote {request.path}", soft_wrap=True)
    used = looked_up(robot, name)
    if used is not None and used.resolve() != request.path.resolve():
        say(f"The policy {name} still acts on {used}: --ship replaces it", soft_wrap=True)
    return 0


def check_settings(training: Training, settings: dict[str, Any]) -> None:
    """Raise ValueError for settings that a training does not take."""
    foreign: dict[str, list[str]] = {}
    for name in settings:
        if name not in training.options:
            able = [other for other, known in registry.TRAININGS.items() if name in known.options]
            foreign.setdefault(", ".join(able), []).append(f"--{name}")
    if foreign:
        refused = (f"{', '.join(options)}: only with {able}" for able, options in foreign.items())
        raise ValueError("; ".join(refused))


def _path(args: Namespace, name: str, robot: RobotParams) -> Path:
    """The file to write."""
    if args.ship and args.out is not None:
        raise ValueError("--ship has its folder: give it or --out")
    folder = artifact_folder(robot) if args.ship else args.out or training_folder(robot)
    path = file_of(robot, args.name or name, folder)
    return path.with_stem(f"{path.stem}_{args.twin}") if args.twin else path


# ---------------------------------------------------------------- several runs


#: Arguments for a single run only.
_SINGLE = ("ship", "checkpoint", "resume")


def train_several(
    args: Namespace,
    name: str,
    robot: RobotParams,
    settings: Mapping[str, Any],
    values: Mapping[str, Sequence[float]],
) -> int:
    """Train with all seeds and values of settings; 1 if a run failed.

    Raises:
        ValueError: An argument that several runs do not take, seeds for a deterministic training,
            or one that a run would refuse.
        FileExistsError: There are results already, and no --overwrite.
    """
    if given := arguments.flags(args, _SINGLE):
        raise ValueError(f"{given}: of a single run, not of --seeds and --workers")
    if args.seeds is not None and not registry.TRAININGS[name].is_random:
        able = ", ".join(other for other, known in registry.TRAININGS.items() if known.is_random)
        raise ValueError(f"--seeds: nothing in {name} is random; only with {able}")
    args.out = out = args.out or SEVERAL_RUNS / name
    request = request_in(out, name, robot, settings, args.name)
    requests = runs.requests_of(request, args.seeds or (args.seed,), values)
    if name in LEARNERS:
        from softrobot_env.training.rl import check_request

        for one in requests.values():
            check_request(name, one)
    with output.new_results(out, args.overwrite), kept_rows(out / KEPT, *study_in(args)) as kept:
        bar = output.progress_on(name, len(requests), prefix=f"{name}: ")
        with bar as show, using(args.workers):
            found = runs.run_all(name, requests, kept, show, args.overwrite)
        if kept.taken:
            say(f"Took up {kept.taken} runs that were done when the command stopped")
        write(args, f"Several runs of {name}", found, report.tables(found))
    best = report.best_of(found)
    if best is not None:
        path = out / best.folder / request.path.name
        say(f"Best: seed {best.seed}, {path}", soft_wrap=True, highlight=False)
    return int(any(run.failure for run in found))


def request_in(
    out: Path, name: str, robot: RobotParams, settings: Mapping[str, Any], file: str | None
) -> TrainingRequest:
    """The common request of runs whose folders, and the files they build on, are in `out`."""
    path = file_of(robot, file or name, out.resolve())
    settings = dict(settings)
    if "recording" in settings:
        settings["recording"] = settings["recording"].resolve()
    beside = path.with_name(artifact_name(robot, IMITATION))
    if "start" in settings and Path(settings["start"]).is_file():
        settings["start"] = str(Path(settings["start"]).resolve())
    elif name in LEARNERS and "start" not in settings and beside.is_file():
        settings["start"] = str(beside)
    return replace(TrainingRequest(robot, path, 0, settings), near=path.parent)


def study_in(args: Namespace) -> tuple[str, set[Path]]:
    """See `arguments.study_of`; files that runs build on are in the folder of results."""
    study, files = arguments.study_of(args)
    return study, files | set(args.out.resolve().glob("*.npz"))


def write(args: Namespace, title: str, found: list[Run], tables: Any) -> None:
    """Write report, page and curves."""
    say(tables)
    curves = any(run.curve for run in found)
    draw = partial(plot, found, args.out / "curves.png") if curves else None
    output.write_report(args, [run.row() for run in found], title, tables, draw)
