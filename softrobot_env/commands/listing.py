"""`softrobot list`: the robots, tasks and policies there are, with those of other packages."""

import argparse
from collections.abc import Mapping

from rich.console import Console

from softrobot_env.commands.arguments import add_robot
from softrobot_env.control.registry import EVERY_POLICY, fitting_policies
from softrobot_env.rendering.tables import named_values
from softrobot_env.robots import ROBOTS, RobotParams, find_robot
from softrobot_env.tasks import Maker, defaults, tasks_of
from softrobot_env.tasks.generic import GENERIC_TASKS

EXAMPLE = """softrobot list
  softrobot list --robot my.toml"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    add_robot(parser, "what it can be given, and why not the rest; default: all there is")


def run(args: argparse.Namespace) -> int:
    """Run the command."""
    for title, rows in _everything() if args.robot is None else _of(find_robot(args.robot)):
        Console().print(named_values(title, rows))
    return 0


def _everything() -> list[tuple[str, dict[str, str]]]:
    own = {f"of {name}": _names(tasks_of(robot).own()) for name, robot in ROBOTS.items()}
    return [
        ("Robots", {name: _told(robot) for name, robot in ROBOTS.items()}),
        ("Tasks", {n: t for n, t in own.items() if t} | {"of any robot": ", ".join(GENERIC_TASKS)}),
        ("Policies", {"": ", ".join(EVERY_POLICY)}),
    ]


def _of(robot: RobotParams) -> list[tuple[str, dict[str, str]]]:
    fits = {name: reason or "can drive it" for name, reason in fitting_policies(robot).items()}
    return [
        (f"Tasks of {robot.name}", {n: _options(make) for n, make in tasks_of(robot).items()}),
        (f"Policies for {robot.name}", dict(sorted(fits.items(), key=_refused))),
    ]


def _refused(policy: tuple[str, str]) -> bool:
    return policy[1] != "can drive it"


def _names(makers: Mapping[str, Maker]) -> str:
    return ", ".join(makers)


def _options(make: Maker) -> str:
    return f"options {', '.join(defaults(make))}" if defaults(make) else "no options"


def _told(robot: RobotParams) -> str:
    if not robot.tendons:
        return "no tendons"
    moves = "planar" if robot.is_planar else "spatial"
    count = len(robot.tendons)
    tendons = "1 tendon" if count == 1 else f"{count} tendons"
    return f"{moves}, {tendons} driven by {robot.drive.kind}"
