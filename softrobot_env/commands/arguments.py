"""Commands under a parser, and the arguments that several of them share."""

import glob
import sys
from argparse import (
    SUPPRESS,
    Action,
    ArgumentParser,
    ArgumentTypeError,
    Namespace,
    RawDescriptionHelpFormatter,
    _ActionsContainer,
)
from collections.abc import Callable, Iterable, Mapping
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any, NoReturn

from softrobot_env.beams.registry import MUJOCO, PLANTS, BeamPlant
from softrobot_env.control.registry import EVERY_POLICY, FEEDBACKS, NETWORK, policy_environment
from softrobot_env.core.processes import parsed_workers
from softrobot_env.core.registry import is_path
from softrobot_env.hardware.tip import LAST_PORT
from softrobot_env.robots import ROBOTS, VARIATIONS, RobotParams
from softrobot_env.robots.artifacts import OUT
from softrobot_env.scene.config import DEFAULT_RULE, DEFAULT_SHARE, INTEGRATORS
from softrobot_env.scene.quadrature import RULES

#: A command: a module or an object, which has `EXAMPLE` for people, `add_arguments(parser)` and
#: `run(args)`, which returns the exit status; and what it does.
Command = tuple[Any, str]


class Parser(ArgumentParser):
    """Says in one line what is wrong with arguments."""

    def parse_known_args(self, *arguments: Any, **more: Any) -> tuple[Any, list[str]]:
        """Refuse unknown arguments here: argparse would let the uppermost parser do it."""
        found, unknown = super().parse_known_args(*arguments, **more)
        if unknown:
            self.error(f"unrecognized arguments: {' '.join(unknown)}")
        return found, unknown

    def error(self, message: str) -> NoReturn:
        """End the program with status 2."""
        text = " ".join(message.split())
        self.exit(2, f"{self.prog}: {text}; see {self.prog} --help\n")


def add_commands(
    parser: ArgumentParser, commands: Mapping[str, Command], dest: str = SUPPRESS
) -> None:
    """Add commands with their arguments and examples; without one the parser's help is printed.

    Args:
        parser: Where to add them.
        commands: By name.
        dest: Attribute of the parsed arguments that holds the name; `run` holds the module's.
    """

    def show_help(_: Namespace) -> int:
        parser.print_help()
        return 0

    parser.set_defaults(run=show_help)
    added = parser.add_subparsers(dest=dest, metavar="COMMAND")
    for name, (module, text) in commands.items():
        command = added.add_parser(
            name,
            help=text,
            description=text,
            epilog=f"example:\n  {module.EXAMPLE}",
            formatter_class=RawDescriptionHelpFormatter,
        )
        command.set_defaults(run=getattr(module, "run", None))
        module.add_arguments(command)


#: Values of arguments that are not given.
_NOT_GIVEN = (None, False, [])

#: Where arguments are added.
Parsers = _ActionsContainer

#: How an option is declared that may be given several times.
SEVERAL = {"action": "append", "default": []}


def add(
    parser: Parsers, declared: str, text: str | None = None, kind: Any = None, **more: Any
) -> None:
    """Add an argument.

    Args:
        parser: Where.
        declared: Its name and, separated by spaces, what its values are called; an option without
            is a switch, unless `more` says what it takes.
        text: For people.
        kind: Makes a value of a text; by what it is called in `_KINDS` unless given.
        **more: As of `ArgumentParser.add_argument`.
    """
    name, *called = declared.split()
    if called:
        kind = kind or _KINDS.get(called[0])
        more = {"metavar": called[0] if len(called) == 1 else tuple(called), "type": kind} | more
        more |= {"nargs": len(called)} if len(called) > 1 else {}
    elif not more:
        more = {"action": "store_true"}
    elif kind is not None:
        more["type"] = kind
    parser.add_argument(name, help=text, **more)


def flags(args: Namespace, names: Iterable[str]) -> str:
    """Those among arguments that are given, as they are written."""
    given = [name for name in names if vars(args).get(name) not in _NOT_GIVEN]
    return ", ".join(f"--{name.replace('_', '-')}" for name in given)


def add_scene(parser: ArgumentParser) -> None:
    """Discretisation and integration, as `SceneConfig` has them."""
    group = parser.add_argument_group("scene")
    period = "default: the policy's own where it has one, else 0.01 s, of the rig 0.02 s"
    share = f"{DEFAULT_SHARE}".replace("%", "%%")
    add(group, "--control-period S", period)
    add(group, "--pieces PIECES", "pieces of the robot; default: the robot's own", int)
    add(group, "--rule RULE", f"hinge rule out of {', '.join(RULES)}; default: {DEFAULT_RULE}")
    add(group, "--timestep S", "default: by rule")
    add(
        group,
        "--accuracy A",
        "wanted accuracy in time of any point of the robot: m, or a share of its length; default: "
        + share,
    )
    add(group, "--integrator INTEGRATOR", f"out of {', '.join(INTEGRATORS)}; default: by rule")


def add_workers(parser: Parsers, note: str = "") -> None:
    """--workers, for `processes.using`; None unless given."""
    add(
        parser,
        "--workers N|ray[:ADDRESS]",
        "run jobs in N processes, or on a Ray cluster: one started here, or the one at HOST:PORT "
        f"or auto{note}",
        of_text(parsed_workers),
    )


def of_text(make: Callable[[str], Any]) -> Callable[[str], Any]:
    """What makes a value of a text, for a parser, by what raises ValueError."""

    def convert(text: str) -> Any:
        try:
            return make(text)
        except ValueError as error:
            raise ArgumentTypeError(str(error)) from None

    return convert


#: Arguments of `add_scene`.
SCENE = ("control_period", "pieces", "rule", "timestep", "integrator", "accuracy")


def scene_options(args: Namespace) -> dict[str, object]:
    """Keyword arguments of an environment from `add_scene`."""
    return {name: getattr(args, name) for name in SCENE if getattr(args, name) is not None}


def add_robot(parser: Parsers, note: str, **more: Any) -> None:
    """--robot, for `find_robot`; None unless given."""
    known = f"a robot file (*.toml), or a robot out of {', '.join(ROBOTS)}; {note}"
    add(parser, "--robot ROBOT", known, **more)


def add_plant(parser: Parsers) -> None:
    """--plant."""
    text = "what is simulated: MuJoCo's chain or a beam model; default: mujoco"
    add(parser, "--plant", text, choices=PLANTS, default=MUJOCO)


def plant_options(args: Namespace, policy: str, robot: RobotParams) -> dict[str, object]:
    """Keyword arguments of an environment for a policy of a robot, of `add_scene`, `add_plant`.

    Raises:
        ValueError: An option of the MuJoCo chain together with a beam model.
    """
    own, given = policy_environment(policy, robot), scene_options(args)
    if args.plant == MUJOCO:
        return own | given
    if foreign := flags(args, ("rule", "timestep", "integrator", "accuracy")):
        raise ValueError(f"{foreign}: only with --plant {MUJOCO}")
    given["plant"] = BeamPlant(args.plant, given.pop("pieces", None))
    return own | given


def add_feedback(parser: Parsers) -> None:
    """--feedback."""
    add(
        parser,
        "--feedback",
        "what policies measure: the full state; or tip and curvatures with an observer for the "
        "rates; or curvature sensors alone, calibrated by `softrobot train sensors`; default: "
        "state",
        choices=FEEDBACKS,
        default=FEEDBACKS[0],
    )
    add(
        parser,
        "--sensors FILE",
        "calibration for --feedback sensors; default: beside the robot's file, or where policies "
        "look, that of the rig's twin 0",
    )


def add_twin(parser: Parsers, nargs: int | str = 1) -> None:
    """--twin, a list of one seed or of several; None unless given."""
    add(
        parser,
        "--twin SEED",
        "the rig that is simulated: seed of a digital twin, a rig with errors of manufacturing, "
        f"servos and camera that no policy knows, or {_NO_TWIN} for an ideal one without them, "
        "which stands where the one-piece model of the policies says; default: 0",
        twin,
        nargs=nargs,
    )


def add_identified(parser: Parsers) -> None:
    """--identified FILE, None unless given."""
    add(
        parser,
        "--identified FILE",
        "identified parameters that policies of the rig act on, a file of `softrobot train rig_nn "
        "--twin SEED`; default: the one shipped, of twin 0, whichever rig is driven",
    )
    parser.add_argument(
        "--learnt", dest="identified", help=SUPPRESS, default=SUPPRESS, action=_Renamed
    )


class _Renamed(Action):
    """Takes an option by its earlier name, and says how it is called now."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option: Any = None) -> None:
        print(f"softrobot: warning: {option} is --{self.dest} now", file=sys.stderr)
        setattr(namespace, self.dest, values)


def add_line(parser: Parsers, robot_file: str) -> None:
    """--robot-file, and --port in its place."""
    add(parser, "--robot-file FILE", robot_file)
    add(parser, "--port PORT", "serial port; default: the robot file's", str)


#: Arguments that no job depends on.
_ELSEWHERE = {"workers", "out", "overwrite", "record", "no_plots", "redraw", "save_rollouts"}
_ELSEWHERE |= {"log", "command_line", "run"}


def study_of(args: Namespace) -> tuple[str, set[Path]]:
    """What the jobs of a command depend on: arguments in words, and files.

    Files are those given, by name or as what is in them, what was learned beside them, and what
    was learned where trainings write.
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


#: The ideal rig, among the seeds of twins.
_NO_TWIN = "none"


def positive(text: str) -> float:
    """A positive number."""
    return number(text, lambda value: 0 < value < inf, "a positive number")


def whole(text: str, what: str = "a whole number, 1 or more") -> int:
    """A whole number, 1 or more."""
    return int(number(text, lambda v: v >= 1 and v == int(v), what))


def size(text: str) -> int:
    """A number of pixels."""
    return whole(text, "a whole number of pixels")


def port(text: str) -> int:
    """Number of a port that something can be sent to."""
    if not text.isdecimal() or not 1 <= int(text) <= LAST_PORT:
        raise ArgumentTypeError(f"must be from 1 to {LAST_PORT}, not {text}")
    return int(text)


def twin(text: str) -> int | None:
    """Seed of a twin, None for an ideal rig."""
    if text == _NO_TWIN:
        return None
    return seed(text, f"a seed, a whole number of zero or more, or {_NO_TWIN}")


def seed(text: str, what: str = "a whole number of zero or more") -> int:
    """A whole number, zero or more."""
    if not text.isdecimal():
        raise ArgumentTypeError(f"{text!r} is not {what}")
    return int(text)


def seeds(text: str) -> tuple[int, ...]:
    """Seeds from `0..4` (the last one too) or `0,3,5`."""
    first, dots, last = text.partition("..")
    found = range(seed(first), seed(last) + 1) if dots else map(seed, text.split(","))
    chosen = tuple(dict.fromkeys(found))
    if not chosen:
        raise ArgumentTypeError(f"{text!r} is not FIRST..LAST or A,B,...")
    return chosen


def number(text: str, allowed: Callable[[float], bool], what: str) -> float:
    """A number that is allowed; any other is refused as not `what`."""
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not allowed(value):
        raise ArgumentTypeError(f"{text!r} is not {what}")
    return value


def variation(text: str) -> tuple[str, list[float]]:
    """`name=1,2,3` as the name of a variation and its values."""
    name, values = named_values(text, VARIATIONS)
    return name, [_varied(name, value) for value in values]


def named_values(text: str, known: Iterable[str] | None = None) -> tuple[str, list[str]]:
    """`name=1,2,3` as a name, one of those known if they are given, and its values."""
    name, _, values = text.partition("=")
    if not values or (known is not None and name not in known):
        names = "" if known is None else f" with NAME out of {', '.join(known)}"
        raise ArgumentTypeError(f"{text!r} is not NAME=V1,V2,...{names}")
    return name, values.split(",")


def _varied(name: str, text: str) -> float:
    what = f"a factor on {name}" if VARIATIONS[name].is_factor else f"a value of {name}"
    value = number(text, isfinite, what)
    try:
        return VARIATIONS[name].check(value)
    except ValueError as error:
        raise ArgumentTypeError(f"{text!r} is not {what}: {error}") from error


def policy(text: str) -> str:
    """A policy's name, or the path of one's own."""
    if not is_path(text) and not text.endswith(NETWORK) and text not in EVERY_POLICY:
        raise ArgumentTypeError(
            f"unknown policy {text!r}; choose from {', '.join(EVERY_POLICY)}, or give "
            f"package.module:name, file.py:name or the file{NETWORK} of a trained network"
        )
    return text


def or_all(convert: Callable[[str], str]) -> Callable[[str], str]:
    """Converter that accepts "all" as well."""
    return lambda text: text if text == "all" else convert(text)


def expand_all(names: list[str], known: list[str]) -> list[str]:
    """The names, with "all" standing for every known one."""
    return list(known) if "all" in names else list(dict.fromkeys(names))


#: What values are, by what they are called.
_KINDS = {"S": positive, "SEED": seed, "POLICY": policy}
_KINDS |= dict.fromkeys(("FILE", "DIR", "PATH", "TOML"), Path)
