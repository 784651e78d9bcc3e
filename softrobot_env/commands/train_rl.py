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
    add_learning(group)
    group.add_argument("--name", help="of the file written; default: the algorithm's")
    group.add_argument(
        "--checkpoint",
        type=Path,
        metavar="DIR",
        help="folder of what --resume needs; default: out/train/NAME",
    )
    group.add_argument("--resume", action="store_true", help="go on with the checkpoint")
    group.add_argument("--log", type=Path, metavar="DIR", help="folder of TensorBoard's logs")


def add_learning(group: argparse._ActionsContainer) -> None:
    """Arguments that say what is learned, and how."""
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
    group.add_argument(
        "--backend",
        choices=("mujoco", "warp"),
        default="mujoco",
        help="what simulates: MuJoCo, or MuJoCo Warp on a graphics card (see docs/howto/gpu.md)",
    )
    group.add_argument("--device", help="of the backend warp: cuda:0 unless given, or cpu")
    group.add_argument("--steps", type=int, help="environment steps; default: by algorithm")
    group.add_argument(
        "--set",
        action="append",
        type=_setting,
        default=[],
        metavar="NAME=V1,V2",
        help="another number of training.rl_config.RLConfig, for instance rate=1e-4; with several "
        "values a run for each",
    )


def _setting(text: str) -> tuple[str, tuple[float, ...]]:
    """`name=number` or `name=number,number`."""
    name, _, values = text.partition("=")
    try:
        return name, tuple(dict.fromkeys(map(float, values.split(","))))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=NUMBER or N1,N2") from None


def values_of(args: argparse.Namespace) -> dict[str, tuple[float, ...]]:
    """Values of the settings of `--set`; of one that is given twice, the last."""
    return dict(args.set)


def given(args: argparse.Namespace) -> dict[str, Any]:
    """Settings among the arguments of `add_arguments` that are given, for `rl.config_of`.

    Of several values of one, the first.
    """
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    usual = vars(parser.parse_args([]))
    found = {name: getattr(args, name) for name in REINFORCEMENT if hasattr(args, name)}
    found["set"] = [(name, values[0]) for name, values in found["set"]]
    return {name: value for name, value in found.items() if value != usual[name]}
