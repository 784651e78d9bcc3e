"""`softrobot train`: make the trained artifacts that policies load, for any robot."""

import argparse
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter
from typing import Any

from rich.console import Console

from softrobot_env.commands import train_rl
from softrobot_env.commands.arguments import add_robot, add_workers, policy, seed, seeds
from softrobot_env.commands.output import (
    add_out,
    check_folder,
    claimed,
    inside,
    new_file,
    progress_on,
)
from softrobot_env.commands.train_several import SEVERAL, train_several
from softrobot_env.rendering.tables import named_values
from softrobot_env.robots import RobotParams, default_robot, find_robot
from softrobot_env.robots.artifacts import artifact_folder, looked_up, training_folder
from softrobot_env.training.registry import TRAININGS
from softrobot_env.training.request import Training, TrainingRequest, file_of
from softrobot_env.training.rl_config import checkpoint_of

EXAMPLE = """softrobot train lq_preview --robot my.toml
  softrobot train imitation --robot my.toml --teacher lq_preview
  softrobot train ppo --robot my.toml --start none
  softrobot train ppo --seeds 0..4 --set rate=1e-4,3e-4 --workers 4
  softrobot train rig_nn --twin 3"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument(
        "what",
        nargs="?",
        choices=list(TRAININGS),
        metavar="NAME",
        help=f"policy to train, out of {', '.join(TRAININGS)}; or give --algo",
    )
    add_robot(parser, "a name or a file; default: the thesis' of the artifact")
    drawn = parser.add_mutually_exclusive_group()
    drawn.add_argument("--seed", type=seed, help="of the randomness; default: 0")
    drawn.add_argument(
        "--seeds",
        type=seeds,
        metavar="A..B|A,B",
        help="a run for each; with this, several values of --set or --workers, runs have folders "
        "in that of --out, and the same command goes on with those that are not done",
    )
    add_workers(parser, "; several runs at a time; default: as many processes as cores")
    add_out(
        parser,
        None,
        "default: beside the file of a robot of one's own, else out; of several runs "
        f"{SEVERAL}/NAME",
    )
    parser.add_argument(
        "--ship",
        action="store_true",
        help="write what comes with the package: models/, or beside the robots in assets/",
    )
    parser.add_argument(
        "--quick", action="store_true", help="seconds, to see that everything runs; no good policy"
    )
    parser.add_argument(
        "--twin",
        type=seed,
        metavar="SEED",
        help="of the twin that rig_nn is of; default: 0. Others than 0 go to a file with "
        "the seed in its name, for `softrobot evaluate --learnt`",
    )
    parser.add_argument(
        "--recording",
        type=Path,
        metavar="FILE",
        help="that ssm learns from, see `softrobot recording`; default: motion that is simulated",
    )
    parser.add_argument(
        "--teacher",
        type=policy,
        metavar="POLICY",
        help="that imitation learns from; default: of the arm mpc_preview, else lq_preview",
    )
    train_rl.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Run the command.

    Raises:
        ValueError: Neither an artifact nor an algorithm is given, or both, an argument that is
            not theirs, another robot than theirs, or the file is there already.
        ImportError: A package is missing; says what to install.
    """
    if (args.what is None) == (args.algo is None):
        raise ValueError(
            f"give an artifact ({', '.join(TRAININGS)}) or an algorithm (--algo "
            f"{', '.join(train_rl.ALGORITHMS)})"
        )
    name, args.seed = args.what or args.algo, args.seed or 0
    training, settings = TRAININGS[name], _settings(args)
    robot = find_robot(args.robot) if args.robot else training.robot or default_robot()
    training.check(name, robot, settings)
    check_settings(training, settings)
    values = train_rl.values_of(args)
    if args.seeds or args.workers or any(len(own) > 1 for own in values.values()):
        return train_several(args, name, robot, settings, values)
    order = TrainingRequest(robot, _path(args, name, robot), args.seed, settings)
    console, began = Console(), perf_counter()
    with ExitStack() as held:
        held.enter_context(new_file(order.path, args.overwrite or bool(settings.get("resume"))))
        if "checkpoint" in training.options:
            folder = checkpoint_of(settings, order.path)
            held.enter_context(claimed(folder))
            check_folder(folder)
        order.path.parent.mkdir(parents=True, exist_ok=True)
        progress = held.enter_context(progress_on(console))
        bar = progress.add_task(name, total=None)

        def show(description: str, done: int, total: int) -> None:
            progress.update(bar, description=f"{name}: {description}", completed=done, total=total)

        figures = training.run(order, show)
    figures = dict(figures) | {"time": f"{perf_counter() - began:.1f} s"}
    console.print(named_values(f"{name} of {robot.name}, seed {args.seed}", figures))
    console.print(f"Wrote {order.path}", soft_wrap=True)
    used = looked_up(robot, name)
    if used is not None and used.resolve() != order.path.resolve():
        console.print(f"The policy {name} still acts on {used}: --ship replaces it", soft_wrap=True)
    return 0


def _settings(args: argparse.Namespace) -> dict[str, Any]:
    """Settings of trainings that are given."""
    own = {name: getattr(args, name) for name in ("twin", "recording", "teacher", "quick")}
    return {n: v for n, v in own.items() if v not in (None, False)} | train_rl.given(args)


def check_settings(training: Training, settings: dict[str, Any]) -> None:
    """Raise ValueError for settings that a training does not take."""
    foreign: dict[str, list[str]] = {}
    for name in settings:
        if name not in training.options:
            able = [other for other, known in TRAININGS.items() if name in known.options]
            foreign.setdefault(", ".join(able), []).append(f"--{name}")
    if foreign:
        told = (f"{', '.join(options)}: only with {able}" for able, options in foreign.items())
        raise ValueError("; ".join(told))


def _path(args: argparse.Namespace, name: str, robot: RobotParams) -> Path:
    """The file to write."""
    if args.ship and args.out is not None:
        raise ValueError("--ship has its folder: give it or --out")
    folder = artifact_folder(robot) if args.ship else args.out or training_folder(robot)
    path = file_of(robot, inside(folder, name if args.name is None else args.name), folder)
    return path.with_stem(f"{path.stem}_{args.twin}") if args.twin else path
