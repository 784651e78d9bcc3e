"""Arguments of `softrobot train` that only reinforcement learning has."""

import argparse
from pathlib import Path
from typing import Any

from softrobot_env.commands.arguments import names_or_all
from softrobot_env.training.registry import REINFORCEMENT
from softrobot_env.training.rl_config import (
    IMITATION,
    ROBOT_TASKS,
    SCRATCH_SETTINGS,
    TRAINING_TASKS,
)

ALGORITHMS = tuple(SCRATCH_SETTINGS)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments that only reinforcement learning has."""
    group = parser.add_argument_group("reinforcement learning")
    group.add_argument("--algo", choices=ALGORITHMS, help="algorithm of stable-baselines3, as NAME")
    group.add_argument(
        "--task",
        nargs="+",
        type=names_or_all([*TRAINING_TASKS, *ROBOT_TASKS]),
        default=["all"],
        metavar="TASK",
        help=f"out of {', '.join(TRAINING_TASKS)} (references drawn at random), of other robots "
        f"than the arm out of {', '.join(ROBOT_TASKS)}; default: all",
    )
    group.add_argument(
        "--start",
        default=IMITATION,
        metavar="NETWORK",
        help="file of a network to start from, imitation (the one in --out, else where "
        "policies look) or none; default: imitation",
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


def given(args: argparse.Namespace) -> dict[str, Any]:
    """Settings among the arguments of `add_arguments` that are given, for `rl.config_of`."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    usual = vars(parser.parse_args([]))
    found = {name: getattr(args, name) for name in REINFORCEMENT}
    return {name: value for name, value in found.items() if value != usual[name]}
