"""`softrobot export`: the registered scenes, or a robot's, as MJCF."""

import argparse

from rich.console import Console

from softrobot_env.commands.arguments import add_out, add_robot
from softrobot_env.robots import find_robot
from softrobot_env.scene.build import scene_xml
from softrobot_env.scene.config import visible
from softrobot_env.scene.registry import SCENES, scene_of
from softrobot_env.writing import write_text

EXAMPLE = """softrobot export --out assets
  softrobot export --robot my.toml --out out"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_out(parser, "out/assets")
    add_robot(parser, "default: all registered scenes")


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    scenes = SCENES
    if args.robot is not None:
        scene = scene_of(find_robot(args.robot))
        scenes = {scene.robot.name: scene, f"{scene.robot.name}_view": visible(scene)}
    args.out.mkdir(parents=True, exist_ok=True)
    for name, config in scenes.items():
        path = args.out / f"{name}.xml"
        write_text(path, scene_xml(config))
        Console().print(f"Wrote {path}")
    return 0
