"""How commands declare arguments, and the arguments that several of them share."""

import glob
import re
import sys
from argparse import (
    SUPPRESS,
    Action,
    ArgumentTypeError,
    Namespace,
    _ActionsContainer,
)
from collections.abc import Callable, Collection, Iterable, Mapping
from math import inf, isfinite, nan
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from softrobot_env.beams.registry import MUJOCO, PLANTS, BeamPlant
from softrobot_env.control.registry import EVERY_POLICY, FEEDBACKS, NETWORK, policy_environment
from softrobot_env.core.processes import parsed_workers
from softrobot_env.core.registry import is_path
from softrobot_env.evaluation.report import REAL, VIRTUAL
from softrobot_env.hardware.tip import LAST_PORT
from softrobot_env.robots import ENTRIES, GRIPPERS, ROBOTS, VARIATIONS, RobotParams
from softrobot_env.robots.artifacts import OUT
from softrobot_env.tasks import EVERY_TASK, known_tasks, tasks_of, with_option
from softrobot_env.tasks.generic import GENERIC_TASKS

#: Values of arguments that are not given.
_NOT_GIVEN = (None, False, [])

#: Parsers to which arguments are added.
Parsers = _ActionsContainer

#: Values of --env: simulated, or over a serial line.
SIMULATED = "sim"
ENVIRONMENTS = (SIMULATED, VIRTUAL, REAL)

#: Name of the ideal rig among the seeds of twins.
_NO_TWIN = "none"

#: Renamed options, and their earlier names, which still work with a warning.
_RENAMED = {"--identified": "--learnt"}


def declare(parser: Parsers, text: str, **kinds: Any) -> None:
    """Add arguments, each declared by a line such as `--size W H (640 480)  of pictures`.

    A line holds the name, the metavar, the default, and after two or more spaces the help, which
    may continue on further lines that begin with no name. An option without a metavar is a switch.
    At the end of a metavar, ?, * and + give the number of values, as in `argparse`, and ! makes the
    argument required; an option with a metavar such as `NAME=...` may be given several times. A
    line such as `[scene]` begins a group, and words such as `<scene>` stand for arguments shared by
    commands.

    Args:
        parser: Where to add them.
        text: The lines.
        **kinds: By argument name, the converter from text, or all allowed values; by default those
            of `_KINDS`.
    """
    shared, lines = _shared(), []

    def said(found: re.Match) -> str:
        text = shared[found[1]]
        return text() if callable(text) else text

    text = re.sub("<([a-z!-]+)>", said, text)
    for line in filter(None, map(str.strip, text.splitlines())):
        if line.startswith(("--", "[")) or "  " in line:
            lines.append(line)
        else:
            lines[-1] += f" {line}"
    place = parser
    for line in lines:
        if line.startswith("["):
            place = parser.add_argument_group(line.strip("[]"))
        else:
            _declare_one(place, line, _KINDS | kinds)


def _declare_one(parser: Parsers, line: str, kinds: Mapping[str, Any]) -> None:
    declared, _, about = (part.strip() for part in line.partition("  "))
    declared, _, default = declared.removesuffix(")").partition(" (")
    name, *called = declared.split()
    if not called:
        parser.add_argument(name, action="store_true", help=about)
        return
    mark = called[-1][-1]
    called[-1] = called[-1].rstrip("?*+!")
    kind = kinds.get(name.lstrip("-").replace("-", "_")) or kinds.get(called[0], str)
    how: dict[str, Any] = {"type": kind, "metavar": called[0]}
    if isinstance(kind, Collection):
        how |= {"type": type(next(iter(kind))), "choices": tuple(kind)}
    if called[0].startswith("NAME="):
        how |= {"action": "append", "default": []}
    if len(called) > 1:
        how |= {"metavar": tuple(called), "nargs": len(called)}
    elif mark in "?*+":
        how["nargs"] = mark
    elif mark == "!":
        how["required"] = True
    if default:
        values = [how["type"](value) for value in default.split()]
        how["default"] = values if "nargs" in how else values[0]
        if "default:" not in about:
            about = "; ".join(filter(None, (about, f"default: {default}")))
    parser.add_argument(name, help=about, **how)
    if earlier := _RENAMED.get(name):
        hidden = {"help": SUPPRESS, "default": SUPPRESS}
        parser.add_argument(earlier, dest=name[2:], action=_Renamed, **hidden)


class _Renamed(Action):
    """Accepts an option by its earlier name, with a warning that has the new one."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: Any = None) -> None:
        print(f"softrobot: warning: {option} is --{self.dest} now", file=sys.stderr)
        setattr(namespace, self.dest, values)


def flags(args: Namespace, names: Iterable[str]) -> str:
    """The arguments among these that were given, as written on the command line."""
    given = [name for name in names if vars(args).get(name) not in _NOT_GIVEN]
    return ", ".join(f"--{name.replace('_', '-')}" for name in given)


_TWIN = """the rig that is simulated: seed of a digital twin, a rig with errors of manufacturing,
    servos and camera that are unknown to policies, or none for an ideal rig without them, which
    rests where the one-piece model of the policies predicts; default: 0
"""

#: Arguments shared by several commands.
_SHARED = {
    "feedback": f"""
        --feedback FEEDBACK ({FEEDBACKS[0]})  what policies measure: the full state; or tip and
        curvatures with an observer for the rates; or curvature sensors alone, calibrated by
        `softrobot train sensors`; out of %(choices)s
        --sensors FILE  calibration for --feedback sensors; default: beside the robot's file, or
        where policies look, that of the rig's twin 0
        --predict T1,T2  known delays of actions [s], as by --vary delay=T1,T2, for which policies
        compensate; 0, the default, is none; one for a picture
    """,
    "identified": """
        --identified FILE  identified parameters that policies of the rig act on, a file of
        `softrobot train rig_nn --twin SEED`; default: the one shipped, of twin 0, whichever rig
        is driven
    """,
    "no-plots": "--no-plots  skip the plots",
    "overwrite": "--overwrite  replace the results of an earlier run",
    "plant": f"""
        --plant PLANT ({MUJOCO})  simulated model: MuJoCo's chain or a beam model, out of
        %(choices)s
    """,
    "port": "--port PORT  serial port; default: the robot file's",
    "twin": f"--twin SEED|{_NO_TWIN}  {_TWIN}",
    "twins": f"--twin TWIN+  {_TWIN}",
    "workers": """
        --workers N|ray[:ADDRESS]  run jobs in N processes, or on a Ray cluster: one started
        here, or the one at HOST:PORT or auto""",
}


def _scene() -> str:
    """Arguments of scenes, for commands that simulate: their registries take time to load."""
    from softrobot_env.scene.config import DEFAULT_RULE, DEFAULT_SHARE, INTEGRATORS
    from softrobot_env.scene.quadrature import RULES

    return f"""
        [scene]
        --control-period S  default: the policy's own where it has one, else 0.01 s, of the rig
        0.02 s
        --pieces PIECES  pieces of the robot; default: the robot's own, or by accuracy where its
        file says none
        --rule RULE  hinge rule out of {", ".join(RULES.registered())}; default: {DEFAULT_RULE}
        --timestep S  default: by rule
        --accuracy A  wanted accuracy of any point of the robot: m, or a share of its length;
        default: {str(DEFAULT_SHARE).replace("%", "%%")}
        --integrator INTEGRATOR  out of {", ".join(INTEGRATORS)}; default: by rule
    """


def _shared() -> dict[str, str | Callable[[], str]]:
    """Arguments shared by several commands; names in registries require loading plug-ins."""
    robot = f"a robot file (*.toml), or a robot out of {', '.join(ROBOTS)};"
    options = {name: tasks for name, tasks in with_option(EVERY_TASK).items() if tasks}
    return _SHARED | {
        "scene": _scene,
        "robot": f"--robot ROBOT  {robot}",
        "robot!": f"--robot ROBOT!  {robot}",
        "grippers": ", ".join(GRIPPERS),
        "options": "; ".join(f"{name} of {', '.join(tasks)}" for name, tasks in options.items()),
        "policies": "; ".join(
            f"of the {own.robot.name}: {', '.join(own.policies)}; default: {own.policy}"
            for own in ENTRIES.values()
            if own.policies
        ),
        "task": f"""
            --task TASK  {_task_help()}; default: swing of the arm, circle of --robot
            --option NAME=VALUE  an option of the task, in SI units, out of
            {", ".join(options)}
            --step-width M  as --option step_width=...
        """,
        "variations": ", ".join(VARIATIONS),
    }


def command(
    example: str, text: str, run: Callable[[Namespace], int], **kinds: Any
) -> SimpleNamespace:
    """A command, see `registry.Command`, with its arguments in the format of `declare`."""
    return SimpleNamespace(EXAMPLE=example, ARGUMENTS=text, KINDS=kinds, run=run)


def _task_help() -> str:
    """Help text for --task."""
    own = {name: ", ".join(tasks_of(robot).own()) for name, robot in ROBOTS.items()}
    named = "".join(f"of the {name}: {tasks}; " for name, tasks in own.items() if tasks)
    return (
        f"{named}of any --robot: {', '.join(GENERIC_TASKS.registered())}; or one's own, "
        "package.module:name or file.py:name"
    )


def of_text(make: Callable[[str], Any]) -> Callable[[str], Any]:
    """Converter for a parser, from a function that raises ValueError."""

    def convert(text: str) -> Any:
        try:
            return make(text)
        except ValueError as error:
            raise ArgumentTypeError(str(error)) from None

    return convert


#: Arguments of a scene.
SCENE = ("control_period", "pieces", "rule", "timestep", "integrator", "accuracy")


def scene_options(args: Namespace) -> dict[str, object]:
    """Keyword arguments of an environment, from the arguments of a scene."""
    return {name: getattr(args, name) for name in SCENE if getattr(args, name) is not None}


def plant_options(
    args: Namespace, policy: str, robot: RobotParams, delay: float
) -> dict[str, object]:
    """Keyword arguments of an environment for a robot's policy, from those of scene and plant.

    Raises:
        ValueError: An option of the MuJoCo chain together with a beam model.
    """
    own, given = policy_environment(policy, robot, delay), scene_options(args)
    if args.plant == MUJOCO:
        return own | given
    if foreign := flags(args, ("rule", "timestep", "integrator", "accuracy")):
        raise ValueError(f"{foreign}: only with --plant {MUJOCO}")
    given["plant"] = BeamPlant(args.plant, given.pop("pieces", None))
    return own | given


#: Arguments on which no job depends.
_ELSEWHERE = {"workers", "out", "overwrite", "record", "no_plots", "redraw", "save_rollouts"}
_ELSEWHERE |= {"log", "command_line", "run"}


def study_of(args: Namespace) -> tuple[str, set[Path]]:
    """What the jobs of a command depend on: its arguments as text, and files.

    The files are those given, by name or by their contents, the learned files next to them, and
    those where trainings write.
    """
    given = {name: value for name, value in vars(args).items() if name not in _ELSEWHERE}
    return str(sorted(given.items(), key=str)), _files_among(given.values())


def _files_among(given: Iterable[Any]) -> set[Path]:
    found = set(OUT.glob("*.npz"))
    for one in given:
        if isinstance(one, list | tuple):
            found |= _files_among(one)
        elif isinstance(one, str | Path):
            name = str(one).rpartition(":")[0] or str(one)
            file = Path(getattr(sys.modules.get(name), "__file__", None) or name)
            if file.is_file():
                found |= {file, *file.parent.glob(f"{glob.escape(file.stem)}.*")}
    return found


def number(
    what: str, allowed: Callable[[Any], bool], make: Callable[[str], Any] = float
) -> Callable[[str], Any]:
    """Converter from text to an allowed number; any other is refused as not `what`."""

    def convert(text: str) -> Any:
        try:
            value = make(text)
        except ValueError:
            value = nan
        if not allowed(value):
            raise ArgumentTypeError(f"{text!r} is not {what}")
        return value

    return convert


positive = number("a positive number", lambda value: 0 < value < inf)
not_negative = number("a number of zero or more", lambda value: 0 <= value < inf)
whole = number("a whole number, 1 or more", lambda value: value >= 1, int)
fps = number("a number of frames per second from 0.1 to 1000", lambda value: 0.1 <= value <= 1000)
port = number(f"a port from 1 to {LAST_PORT}", lambda value: 1 <= value <= LAST_PORT, int)
seed = number("a whole number of zero or more", lambda value: value >= 0, int)


def size(text: str) -> int:
    """A converter, see `number`, of the side of a picture."""
    from softrobot_env.envs.config import MOST_PIXELS  # takes time to load

    what = f"a whole number of pixels, {MOST_PIXELS} at most"
    return number(what, lambda value: 1 <= value <= MOST_PIXELS, int)(text)


_seed_of_twin = number(
    f"a seed, a whole number of zero or more, or {_NO_TWIN}", lambda value: value >= 0, int
)


def twin(text: str) -> int | None:
    """Seed of a twin, None for an ideal rig."""
    return None if text == _NO_TWIN else _seed_of_twin(text)


def seeds(text: str) -> tuple[int, ...]:
    """Seeds from `0..4` (the last one too) or `0,3,5`."""
    first, dots, last = text.partition("..")
    found = range(seed(first), seed(last) + 1) if dots else map(seed, text.split(","))
    chosen = tuple(dict.fromkeys(found))
    if not chosen:
        raise ArgumentTypeError(f"{text!r} is not FIRST..LAST or A,B,...")
    return chosen


def variation(text: str) -> tuple[str, list[float]]:
    """`name=1,2,3` as the name of a variation and its values."""
    name, values = named_values(text, VARIATIONS)
    return name, [_varied(name, value) for value in values]


def named_values(text: str, known: Iterable[str] | None = None) -> tuple[str, list[str]]:
    """`name=1,2,3` as a name, which must be one of `known` if given, and its values."""
    name, _, values = text.partition("=")
    if not values or (known is not None and name not in known):
        names = "" if known is None else f" with NAME out of {', '.join(known)}"
        raise ArgumentTypeError(f"{text!r} is not NAME=V1,V2,...{names}")
    return name, values.split(",")


def option(text: str) -> tuple[str, list[float]]:
    """`name=1,2,3` as the name of an option of tasks and its values."""
    name, values = named_values(text)
    a_number = number("a number", isfinite)
    # Whole numbers stay integers.
    return name, [int(value) if value.isdecimal() else a_number(value) for value in values]


def _varied(name: str, text: str) -> float:
    what = f"a factor on {name}" if VARIATIONS[name].is_factor else f"a value of {name}"
    value = number(what, isfinite)(text)
    try:
        return VARIATIONS[name].check(value)
    except ValueError as error:
        raise ArgumentTypeError(f"{text!r} is not {what}: {error}") from error


def policy(text: str) -> str:
    """A policy's name, or the path of your own."""
    if not is_path(text) and not text.endswith(NETWORK) and text not in EVERY_POLICY:
        raise ArgumentTypeError(
            f"unknown policy {text!r}; choose from {', '.join(EVERY_POLICY)}, or give "
            f"package.module:name, file.py:name or the file{NETWORK} of a trained network"
        )
    return text


def task_name(text: str) -> str:
    """A task's name, or the path of your own."""
    if not is_path(text) and text not in known_tasks():
        known = ", ".join(known_tasks())
        raise ArgumentTypeError(
            f"unknown task {text!r}; choose from {known}, or give package.module:name or "
            "file.py:name"
        )
    return text


def or_all(convert: Callable[[str], str]) -> Callable[[str], str]:
    """Converter that also accepts "all"."""
    return lambda text: text if text == "all" else convert(text)


def expand_all(names: list[str], known: list[str]) -> list[str]:
    """The names, with "all" standing for every known one."""
    return list(known) if "all" in names else list(dict.fromkeys(names))


#: Converters or allowed values, by the argument's name or metavar.
_KINDS = {
    "policies": or_all(policy),
    "timeout": number("a number of seconds up to 600", lambda value: 0 <= value <= 600),
    "tasks": or_all(task_name),
    "A,B": lambda text: tuple(map(str.strip, text.split(","))),
    "A..B|A,B": seeds,
    "ENV": ENVIRONMENTS,
    "FEEDBACK": FEEDBACKS,
    "N": seed,
    "N|ray[:ADDRESS]": of_text(parsed_workers),
    "PLANT": PLANTS,
    "POLICY": policy,
    "SEED": seed,
    "SEED|none": lambda text: [twin(text)],
    "TASK": task_name,
    "TWIN": twin,
    "T1,T2": lambda text: [not_negative(part) for part in text.split(",")],
    "V1,V2": lambda text: [positive(part) for part in text.split(",")],
    "W": size,
    "X": float,
    **dict.fromkeys(("option", "NAME=VALUE"), option),
    **dict.fromkeys(("randomize", "vary"), variation),
    **dict.fromkeys(("FILE", "DIR", "PATH", "TOML"), Path),
    "FPS": fps,
    **dict.fromkeys(("KG", "M", "S"), positive),
    **dict.fromkeys(("LEVELS", "PIECES", "POINTS", "STEPS"), int),
}
