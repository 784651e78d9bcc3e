"""Arguments that several commands share."""

import argparse
import glob
import sys
from collections.abc import Callable, Iterable
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any

from softrobot_env.beams.registry import MUJOCO, PLANTS, BeamPlant
from softrobot_env.control.registry import EVERY_POLICY, FEEDBACKS, NETWORK, policy_environment
from softrobot_env.core.processes import Workers, parsed_workers
from softrobot_env.core.registry import is_path
from softrobot_env.hardware.tip import LAST_PORT
from softrobot_env.robots import ROBOTS, VARIATIONS, RobotParams
from softrobot_env.robots.artifacts import OUT
from softrobot_env.scene.config import DEFAULT_RULE, DEFAULT_SHARE, INTEGRATORS
from softrobot_env.scene.quadrature import RULES

#: The ideal rig, among the seeds of twins.
_NO_TWIN = "none"


def add_scene(parser: argparse.ArgumentParser) -> None:
    """Discretisation and integration, as `SceneConfig` has them."""
    group = parser.add_argument_group("scene")
    group.add_argument(
        "--control-period",
        type=positive,
        metavar="S",
        help="default: the policy's own where it has one, else 0.01 s, of the rig 0.02 s",
    )
    group.add_argument("--pieces", type=int, help="pieces of the robot; default: the robot's own")
    group.add_argument(
        "--rule",
        help=f"hinge rule out of {', '.join(RULES)}; default: {DEFAULT_RULE}",
    )
    group.add_argument("--timestep", type=positive, metavar="S", help="default: by rule")
    group.add_argument(
        "--accuracy",
        metavar="A",
        help="wanted accuracy in time of any point of the robot: m, or a share of its length; "
        f"default: {DEFAULT_SHARE}".replace("%", "%%"),
    )
    group.add_argument("--integrator", help=f"out of {', '.join(INTEGRATORS)}; default: by rule")


def add_workers(parser: argparse._ActionsContainer, note: str = "") -> None:
    """--workers, for `processes.using`; None unless given."""
    parser.add_argument(
        "--workers",
        type=_workers,
        metavar="N|ray[:ADDRESS]",
        help="run jobs in N processes, or on a Ray cluster: one started here, or the one at "
        f"HOST:PORT or auto{note}",
    )


def _workers(text: str) -> Workers:
    try:
        return parsed_workers(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def scene_options(args: argparse.Namespace) -> dict[str, object]:
    """Keyword arguments of an environment from `add_scene`."""
    names = ("control_period", "pieces", "rule", "timestep", "integrator", "accuracy")
    given = {name: getattr(args, name) for name in names}
    return {name: value for name, value in given.items() if value is not None}


def add_robot(parser: argparse.ArgumentParser, note: str) -> None:
    """--robot, for `find_robot`; None unless given."""
    parser.add_argument(
        "--robot",
        metavar="ROBOT",
        help=f"a robot file (*.toml), or a robot out of {', '.join(ROBOTS)}; {note}",
    )


def add_plant(parser: argparse.ArgumentParser) -> None:
    """--plant, and the arguments of `add_scene`."""
    add_scene(parser)
    parser.add_argument(
        "--plant",
        choices=PLANTS,
        default=MUJOCO,
        help="what is simulated: MuJoCo's chain or a beam model; default: mujoco",
    )


def plant_options(args: argparse.Namespace, policy: str, robot: RobotParams) -> dict[str, object]:
    """Keyword arguments of an environment for a policy of a robot, from `add_plant`.

    Raises:
        ValueError: An option of the MuJoCo chain together with a beam model.
    """
    if args.plant == MUJOCO:
        return policy_environment(policy, robot) | scene_options(args)
    given = {name: getattr(args, name) for name in ("rule", "timestep", "integrator", "accuracy")}
    foreign = [f"--{name}" for name, value in given.items() if value]
    if foreign:
        raise ValueError(f"{', '.join(foreign)}: only with --plant {MUJOCO}")
    period = {} if args.control_period is None else {"control_period": args.control_period}
    plant = BeamPlant(args.plant, args.pieces)
    return policy_environment(policy, robot) | {"plant": plant, **period}


def add_feedback(parser: argparse._ActionsContainer) -> None:
    """--feedback."""
    parser.add_argument(
        "--feedback",
        choices=FEEDBACKS,
        default=FEEDBACKS[0],
        help="what policies measure: the full state; or tip and curvatures with an observer for "
        "the rates; or curvature sensors alone, calibrated by `softrobot train sensors`; "
        "default: state",
    )
    parser.add_argument(
        "--sensors",
        type=Path,
        metavar="FILE",
        help="calibration for --feedback sensors; default: beside the robot's file, or where "
        "policies look, that of the rig's twin 0",
    )


def add_twin(parser: argparse._ActionsContainer, several: bool = False) -> None:
    """--twin, a list of one seed or of several; None unless given."""
    parser.add_argument(
        "--twin",
        nargs="+" if several else 1,
        type=twin,
        metavar="SEED",
        help="the rig that is simulated: seed of a digital twin, a rig with errors of "
        f"manufacturing, servos and camera that no policy is told, or {_NO_TWIN} for an ideal "
        "one without them, which stands where the one-piece model of the policies says; default: "
        "0",
    )


def add_learnt(parser: argparse._ActionsContainer) -> None:
    """--learnt FILE, None unless given."""
    parser.add_argument(
        "--learnt",
        type=Path,
        metavar="FILE",
        help="identified parameters that policies of the rig act on, a file of "
        "`softrobot train rig_nn --twin SEED`; default: the one shipped, of twin 0, whichever rig "
        "is driven",
    )


def files_among(given: Iterable[Any]) -> set[Path]:
    """Files that jobs may depend on: those given, by name or as what is in them, what was
    learned beside them, and what was learned where trainings write."""
    found = set(OUT.glob("*.npz"))
    for one in given:
        if isinstance(one, list | tuple):
            found |= files_among(one)
        elif isinstance(one, str | Path):
            name = str(one).rpartition(":")[0] or str(one)
            module = sys.modules.get(name)
            file = Path(getattr(module, "__file__", None) or name)
            if file.is_file():
                found |= {file, *file.parent.glob(f"{glob.escape(file.stem)}.*")}
    return found


def positive(text: str) -> float:
    """A positive number."""
    return number(text, lambda value: 0 < value < inf, "a positive number")


def size(text: str) -> int:
    """A number of pixels."""
    return int(number(text, lambda v: v >= 1 and v == int(v), "a whole number of pixels"))


def port(text: str) -> int:
    """Number of a port that something can be sent to."""
    if not text.isdecimal() or not 1 <= int(text) <= LAST_PORT:
        raise argparse.ArgumentTypeError(f"must be from 1 to {LAST_PORT}, not {text}")
    return int(text)


def twin(text: str) -> int | None:
    """Seed of a twin, None for an ideal rig."""
    if text == _NO_TWIN:
        return None
    return seed(text, f"a seed, a whole number of zero or more, or {_NO_TWIN}")


def seed(text: str, what: str = "a whole number of zero or more") -> int:
    """A whole number, zero or more."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not {what}")
    return int(text)


def seeds(text: str) -> tuple[int, ...]:
    """Seeds from `0..4` (the last one too) or `0,3,5`."""
    first, dots, last = text.partition("..")
    found = range(seed(first), seed(last) + 1) if dots else map(seed, text.split(","))
    chosen = tuple(dict.fromkeys(found))
    if not chosen:
        raise argparse.ArgumentTypeError(f"{text!r} is not FIRST..LAST or A,B,...")
    return chosen


def number(text: str, allowed: Callable[[float], bool], what: str) -> float:
    """A number that is allowed; what else there is is told to be not `what`."""
    try:
        value = float(text)
    except ValueError:
        value = nan
    if not allowed(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not {what}")
    return value


def variation(text: str) -> tuple[str, list[float]]:
    """`name=1,2,3` as the name of a variation and its values."""
    name, values = named_values(text, VARIATIONS)
    return name, [_varied(name, value) for value in values]


def named_values(text: str, known: Iterable[str] | None = None) -> tuple[str, list[str]]:
    """`name=1,2,3` as a name, one of those known if they are given, and its values."""
    name, _, values = text.partition("=")
    if not values or (known is not None and name not in known):
        told = "" if known is None else f" with NAME out of {', '.join(known)}"
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=V1,V2,...{told}")
    return name, values.split(",")


def _varied(name: str, text: str) -> float:
    what = f"a factor on {name}" if VARIATIONS[name].is_factor else f"a value of {name}"
    value = number(text, isfinite, what)
    try:
        return VARIATIONS[name].check(value)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not {what}: {error}") from error


def names_or_all(known: list[str]) -> Callable[[str], str]:
    """Converter that accepts the known names and "all", and lists them otherwise."""

    def convert(text: str) -> str:
        if text != "all" and text not in known:
            raise argparse.ArgumentTypeError(
                f"unknown name {text!r}; choose from {', '.join(known)}, all"
            )
        return text

    return convert


def policy(text: str) -> str:
    """A policy's name, or the path of one's own."""
    if not is_path(text) and not text.endswith(NETWORK) and text not in EVERY_POLICY:
        raise argparse.ArgumentTypeError(
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
