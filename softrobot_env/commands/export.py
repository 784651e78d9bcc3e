"""`softrobot export`: the registered scenes, or a robot's, as MJCF."""

import argparse

from rich.console import Console

from softrobot_env.commands.arguments import add_robot
from softrobot_env.commands.output import add_out, check_free
from softrobot_env.core.files import write_text
from softrobot_env.robots import find_robot
from softrobot_env.scene.build import scene_xml
from softrobot_env.scene.config import visible
from softrobot_env.scene.registry import SCENES, scene_of

EXAMPLE = """softrobot export --out assets --overwrite
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
    paths = {name: args.out / f"{name}.xml" for name in scenes}
    check_free(*paths.values(), overwrite=args.overwrite)
    for name, config in scenes.items():
        path = paths[name]
        write_text(path, scene_xml(config))
        Console().print(f"Wrote {path}")
    return 0
