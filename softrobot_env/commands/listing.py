"""`softrobot list`: everything available by name, including what other packages have registered."""

from argparse import Namespace
from collections.abc import Callable

from gymnasium.envs.registration import registry

from softrobot_env.control.registry import EVERY_POLICY, fitting_policies
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.core.studies import BENCHMARKS
from softrobot_env.rendering.tables import named_values
from softrobot_env.robots import ROBOTS, RobotParams, find_robot
from softrobot_env.tasks import Maker, defaults, tasks_of
from softrobot_env.tasks.generic import GENERIC_TASKS

from .output import say

EXAMPLE = """softrobot list
  softrobot list policies --robot my.toml"""

_FITS = "can drive it"


ARGUMENTS = """
    what WHAT?  only these, out of %(choices)s; default: all
    <robot> list what fits it, and why the rest does not; default: everything
"""


def run(args: Namespace) -> int:
    """Run the command."""
    lists = _EVERYTHING if args.robot is None else _OF_ROBOT
    if args.what is not None and args.what not in lists:
        raise ValueError(f"--robot lists {', '.join(lists)}, not {args.what}")
    of = () if args.robot is None else (find_robot(args.robot),)
    for robot in of:
        _require_scene(robot)
    for what in lists if args.what is None else (args.what,):
        title = what.capitalize() if args.robot is None else f"{what.capitalize()} of {of[0].name}"
        say(named_values(title, lists[what](*of)))
    return 0


def _require_scene(robot: RobotParams) -> None:
    """Refuse a robot of which no scene can be built, once rather than for each task.

    Raises:
        ValueError: See `build_scene`.
    """
    from softrobot_env.scene.build import build_scene  # takes time to load
    from softrobot_env.scene.registry import model_scene

    build_scene(model_scene(robot))


def _tasks() -> dict[str, str]:
    own = {f"of {name}": ", ".join(tasks_of(robot).own()) for name, robot in ROBOTS.items()}
    return {n: t for n, t in own.items() if t} | {"of any robot": ", ".join(GENERIC_TASKS)}


def _envs() -> dict[str, str]:
    tasks = {k: v.kwargs.get("task") for k, v in registry.items() if k.startswith("SoftRobot/")}
    return {name: f"task {task}" if task else "any robot and task" for name, task in tasks.items()}


#: What can be listed.
_EVERYTHING: dict[str, Callable[[], dict[str, str]]] = {
    "robots": lambda: {name: _described(robot) for name, robot in ROBOTS.items()},
    "tasks": _tasks,
    "policies": lambda: {"": ", ".join(EVERY_POLICY)},
    "envs": _envs,
    "benchmarks": lambda: {"": ", ".join(BENCHMARKS) or "none: they come with the repository"},
}


def _policies_of(robot: RobotParams) -> dict[str, str]:
    fits = {name: reason or _FITS for name, reason in fitting_policies(robot).items()}
    return dict(sorted(fits.items(), key=lambda policy: policy[1] != _FITS))


#: What can be listed of one robot.
_OF_ROBOT: dict[str, Callable[[RobotParams], dict[str, str]]] = {
    "tasks": lambda robot: {name: _offered(make) for name, make in tasks_of(robot).items()},
    "policies": _policies_of,
}


def _offered(make: Maker) -> str:
    try:
        make()
    except (ValueError, EquilibriumError) as error:
        return str(error)
    return f"options {', '.join(defaults(make))}" if defaults(make) else "no options"


def _described(robot: RobotParams) -> str:
    if not robot.tendons:
        return "no tendons"
    moves = "planar" if robot.is_planar else "spatial"
    count = len(robot.tendons)
    tendons = "1 tendon" if count == 1 else f"{count} tendons"
    return f"{moves}, {tendons} driven by {robot.drive.kind}"


KINDS = {"what": _EVERYTHING}
