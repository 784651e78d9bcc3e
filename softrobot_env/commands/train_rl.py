"""Reinforcement learning, as `softrobot train --algo` runs it."""

import argparse
import json
from dataclasses import fields, replace
from pathlib import Path

from softrobot_env.commands.arguments import expand_all, names_or_all
from softrobot_env.interfaces import Show
from softrobot_env.learned.network import Network, load_for
from softrobot_env.robots import ARM
from softrobot_env.training.rl_config import SCRATCH_SETTINGS, TRAINING_TASKS, RLConfig, preset

ALGORITHMS = tuple(SCRATCH_SETTINGS)

PACKAGES = ("torch", "stable_baselines3")

_START, _NO_START = "imitation", "none"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments that only reinforcement learning has."""
    group = parser.add_argument_group("reinforcement learning")
    group.add_argument("--algo", choices=ALGORITHMS, help="algorithm of stable-baselines3")
    group.add_argument(
        "--task",
        nargs="+",
        type=names_or_all(list(TRAINING_TASKS)),
        default=["all"],
        metavar="TASK",
        help=f"out of {', '.join(TRAINING_TASKS)} (references drawn at random); default: all",
    )
    group.add_argument(
        "--start",
        default=_START,
        metavar="NETWORK",
        help="file of a network to start from, imitation (the one in --out, else the one "
        "shipped) or none; default: imitation",
    )
    group.add_argument(
        "--randomize",
        action="store_true",
        help="draw robots and disturbances from broad ranges, not Young's modulus alone",
    )
    group.add_argument("--steps", type=int, help="environment steps; default: by algorithm")
    group.add_argument(
        "--set",
        action="append",
        type=_setting,
        default=[],
        metavar="NAME=VALUE",
        help="another number of training.rl_config.RLConfig, for instance rate=1e-4",
    )
    group.add_argument("--name", help="of the file written; default: the algorithm's")
    group.add_argument(
        "--checkpoint",
        type=Path,
        metavar="DIR",
        help="folder of what --resume needs; default: out/train/NAME",
    )
    group.add_argument("--resume", action="store_true", help="go on with the checkpoint")
    group.add_argument("--log", type=Path, metavar="DIR", help="folder of TensorBoard's logs")


def _setting(text: str) -> tuple[str, float]:
    """`name=number`."""
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=NUMBER") from None


def given(args: argparse.Namespace) -> list[str]:
    """Names of the arguments of `add_arguments` that were given."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    names = vars(parser.parse_args([]))
    return [f"--{name}" for name, default in names.items() if getattr(args, name) != default]


def name_of(args: argparse.Namespace) -> str:
    """Name of the file, without its ending."""
    return args.name or args.algo


def run(args: argparse.Namespace, path: Path, show: Show) -> list[tuple[str, str]]:
    """Train, write the network and its learning curve, and return figures for people."""
    from softrobot_env.training.artifacts import figures, save
    from softrobot_env.training.rl import train

    config = _config(args)
    network, curve = train(
        config,
        args.seed,
        show,
        _start(args, path),
        checkpoint=args.checkpoint or Path("out") / "train" / name_of(args),
        resume=args.resume,
        log=args.log,
    )
    save(network, path, args.seed)
    written = path.with_name(f"{path.stem}_curve.json")
    written.write_text(json.dumps(curve, indent=1) + "\n", encoding="utf-8")
    return [*figures(network, config.trials), ("learning curve", str(written))]


def _config(args: argparse.Namespace) -> RLConfig:
    """Settings of the arguments.

    Raises:
        ValueError: A setting that does not exist or is no number, or one out of range.
    """
    config = preset(args.algo, args.start != _NO_START, args.randomize)
    tasks = tuple(expand_all(args.task, list(TRAINING_TASKS)))
    wanted = {"tasks": tasks} if args.steps is None else {"tasks": tasks, "steps": args.steps}
    numbers = {f.name: f.type for f in fields(RLConfig) if f.type in (int, float)}
    for name, value in args.set:
        if name not in numbers:
            raise ValueError(f"cannot set {name!r}; choose from {', '.join(numbers)}")
        if numbers[name] is int and not value.is_integer():
            raise ValueError(f"{name} must be a whole number, got {value:g}")
        wanted[name] = numbers[name](value)
    return replace(config, **wanted)


def _start(args: argparse.Namespace, path: Path) -> Network | None:
    from softrobot_env.training.artifacts import load_start

    if args.start == _NO_START or args.resume:
        return None
    if args.start == _START:
        return load_start(path)
    return load_for(Path(args.start), ARM, "softrobot train")[0]
