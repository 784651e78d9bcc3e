"""`softrobot robot-file`: robots of one's own, described by TOML files."""

import argparse
from pathlib import Path
from types import SimpleNamespace

from rich.console import Console

from softrobot_env.commands.subcommands import Command, add_commands
from softrobot_env.robots import read_robot
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.registry import scene_of

EXAMPLE = "softrobot robot-file check my.toml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command: its commands with theirs."""
    add_commands(parser, FILE_COMMANDS, "file_command")


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    return args.file_command_run(args)


def _add_file(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="a robot file")


def _check(args: argparse.Namespace) -> int:
    """Read a file, build its scene and say what it is."""
    robot = read_robot(args.file)
    config = scene_of(robot)
    model = build_scene(config).model
    text = (
        f"{args.file}: good: robot {robot.name}, {robot.length:g} m in "
        f"{len(robot.backbone.sections)} section(s), {len(robot.tendons)} tendon(s) driven by "
        f"{robot.drive.kind}, {len(robot.discs)} disc(s), "
        f"{len(robot.sensors)} sensor(s), {config.bending}, {model.nv} DOFs"
    )
    Console(soft_wrap=True, highlight=False, markup=False).print(text)
    return 0


_CHECK = SimpleNamespace(EXAMPLE=EXAMPLE, add_arguments=_add_file, run=_check)

#: The commands of `softrobot robot-file`.
FILE_COMMANDS = {"check": Command(_CHECK, "say whether a robot file is good, or what is wrong")}
