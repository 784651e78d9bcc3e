"""`softrobot export`: the registered scenes as MJCF."""

import argparse

from rich.console import Console

from softrobot_env.commands.arguments import add_out
from softrobot_env.scene.build import scene_xml
from softrobot_env.scene.registry import SCENES

EXAMPLE = "softrobot export --out assets"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_out(parser, "out/assets")


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    args.out.mkdir(parents=True, exist_ok=True)
    for name, config in SCENES.items():
        path = args.out / f"{name}.xml"
        path.write_text(scene_xml(config), encoding="utf-8")
        Console().print(f"Wrote {path}")
    return 0
