"""What users reach by name, one line each: `tests/test_ledger.py` tells what was lost.

`python scripts/ledger.py --write` writes tests/ledger.txt anew, after a loss was explained in
CHANGELOG.md, or something was added.
"""

import argparse
import ast
import gc
import json
import re
import tempfile
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from inspect import Parameter, signature
from pathlib import Path
from pkgutil import resolve_name

import gymnasium

import softrobot_env

ROOT = Path(softrobot_env.__file__).resolve().parents[1]
LEDGER = ROOT / "tests" / "ledger.txt"

#: Modules whose names users import, beside those that README, docs and examples name.
PUBLIC = (
    "softrobot_env.robots",
    "softrobot_env.tasks",
    "softrobot_env.twin",
    "softrobot_env.loads",
    "softrobot_env.envs.tracking",
    "softrobot_env.envs.vector",
    "softrobot_env.thesis.envs",
    "softrobot_env.envs.real",
    "softrobot_env.envs.randomization",
    "softrobot_env.envs.disturbances",
    "softrobot_env.control.registry",
    "softrobot_env.beams.pcc",
    "softrobot_env.beams.cosserat",
    "softrobot_env.beams.ancf",
    "softrobot_env.beams.registry",
    "softrobot_env.scene.config",
    "softrobot_env.scene.build",
    "softrobot_env.scene.statics",
    "softrobot_env.hardware.tip",
    "softrobot_env.recordings",
    "softrobot_env.training.rl_config",
    "softrobot_env.training.vec_env",
)

#: What registries are of whose names users write.
KINDS = {"robot", "gripper", "task", "grip task", "policy", "training", "benchmark"}
KINDS |= {"scene", "hinge rule", "tip source", "beam model", "method", "axes"}

#: Names in tables that are no `Registry`, by where they are.
TABLES = {
    "observable": "softrobot_env.envs.observations.table:OBSERVABLES",
    "reward": "softrobot_env.envs.rewards:REWARDS",
    "reward term": "softrobot_env.envs.rewards:TERMS",
    "variation": "softrobot_env.robots.variations:VARIATIONS",
    "plant": "softrobot_env.beams.registry:PLANTS",
    "reset option": "softrobot_env.envs.options:RESET_OPTIONS",
    "training setting": "softrobot_env.training.rl_config:NUMBERS",
    "excitation": "softrobot_env.identification.excitation:KINDS",
}

_SECTION = """name = "a"
[[section]]
length_m = 1.0
outer_radius_m = 0.1
youngs_modulus_Pa = 1e5
density_kg_m3 = 1e3
damping_time_s = 0.1
"""
_COMMANDS = 'rate_Hz = 1.0\n[commands]\nkind = "length"\ncolumns = ["a"]\nunit = "m"\n'
_SERVO = "[[tendons]]\nchannel = 0\ncenter_us = 1500\ngain_us_per_mm = 30\n"
_SERVO += "minimum_mm = -30\nmaximum_mm = 30\n"
_HARDWARE = 'name = "a"\nport = "b"\n'

#: Kind of file -> its reader, and a file with a key that none has, by the table it is in.
FILES = {
    "robot file": (
        "softrobot_env.robots:read_robot",
        {
            "": "zzz = 1",
            "section": 'name = "a"\n[[section]]\nzzz = 1',
            **{name: f"{_SECTION}[[{name}]]\nzzz = 1" for name in ("tendon", "disc", "sensor")},
            **{name: f"{_SECTION}[{name}]\nzzz = 1" for name in ("base", "head")},
        },
    ),
    "gripper file": (
        "softrobot_env.robots:read_gripper",
        {"": "zzz = 1", "finger": 'name = "a"\n[[finger]]\nzzz = 1'},
    ),
    "hardware robot file": (
        "softrobot_env.hardware.robot_file:read_robot_file",
        {
            "": f"{_HARDWARE}zzz = 1",
            "tendons": f"{_HARDWARE}[[tendons]]\nzzz = 1",
            "supervision": f"{_HARDWARE}{_SERVO}[supervision]\nzzz = 1",
        },
    ),
    "recording header": (
        "softrobot_env.recordings:read_header",
        {
            "": f"zzz = 1\n{_COMMANDS}",
            "commands": f"{_COMMANDS}zzz = 1",
            **{name: f"{_COMMANDS}[{name}]\nzzz = 1" for name in ("time", "frame")},
            "marker": f"{_COMMANDS}[[marker]]\nzzz = 1",
        },
    ),
}


def entries() -> list[str]:
    """All lines, in order."""
    parts = (commands(), environments(), registries(), tables(), keys(), scripts(), imports())
    return sorted({line for part in parts for line in part})


def commands() -> Iterator[str]:
    """Words, options and choices of the command line."""
    from softrobot_env.cli import build_parser

    yield from _of_parser(build_parser(), "command softrobot")


def _of_parser(parser: argparse.ArgumentParser, said: str) -> Iterator[str]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, inner in action.choices.items():
                yield f"{said} {name}"
                yield from _of_parser(inner, f"{said} {name}")
            continue
        names = action.option_strings or [action.dest.upper()]
        yield from (f"{said} {name}" for name in names)
        yield from (f"{said} {names[-1]} {choice}" for choice in action.choices or ())


def environments() -> Iterator[str]:
    """Ids, and keyword arguments of `gymnasium.make` and `make_vec`."""
    for name, spec in gymnasium.registry.items():
        if name.startswith("SoftRobot/"):
            yield f"environment {name}"
            yield from (f"make {name} {argument}" for argument in _arguments(spec.entry_point))
            if spec.vector_entry_point is not None:
                many = _arguments(spec.vector_entry_point)
                yield from (f"make_vec {name} {argument}" for argument in many)


def _arguments(entry_point: str) -> Iterator[str]:
    """Keyword arguments of a class: those of `__init__`, what `takes` names, and of its bases."""
    for kind in resolve_name(entry_point).__mro__:
        parameters = list(signature(kind.__init__).parameters.values())[1:]
        named = (Parameter.KEYWORD_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
        yield from (p.name for p in parameters if p.kind in named)
        if not any(p.kind is Parameter.VAR_KEYWORD for p in parameters):
            return
        yield from getattr(kind, "takes", ())


def registries() -> Iterator[str]:
    """Names in every registry, wherever it is, and options of tasks."""
    from softrobot_env.core.registry import Registry, load_plugins
    from softrobot_env.robots import ROBOTS
    from softrobot_env.tasks import defaults, tasks_of

    load_plugins()
    for path in (ROOT / "softrobot_env").rglob("*.py"):
        if re.search(r"\bRegistry\(", path.read_text()):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            import_module(name.removesuffix(".__init__"))
    for one in gc.get_objects():
        if isinstance(one, Registry) and one.kind in KINDS:
            yield from (f"{one.kind} {name}" for name in one.registered())
    for robot in ROBOTS.registered():
        with suppress(ValueError):  # it has no tendons
            for name, make in tasks_of(robot).registered().items():
                yield f"task {name} of {robot}"
                yield from (f"task {name} of {robot}: {option}" for option in defaults(make))


def tables() -> Iterator[str]:
    """Names in tables that are no registries."""
    for kind, place in TABLES.items():
        yield from (f"{kind} {name}" for name in resolve_name(place))


def keys() -> Iterator[str]:
    """Keys of files, as the message about a key that there is not names them."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "file.toml")
        for kind, (reader, texts) in FILES.items():
            for table, text in texts.items():
                file.write_text(text)
                try:
                    resolve_name(reader)(file)
                except ValueError as error:
                    allowed = str(error).partition("allowed are ")[2]
                    assert allowed, f"{kind} [{table}]: {error}"
                    yield from (f"{kind} [{table}] {key}" for key in allowed.split(", "))


def scripts() -> Iterator[str]:
    """Console scripts."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    yield from (f"script {name}" for name in project["scripts"])


def imports() -> Iterator[str]:
    """What README, docs and examples import, public modules and what these list in `__all__`."""
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "docs").rglob("*.ipynb")]
    texts = [path.read_text() for path in (ROOT / "examples").glob("*.py")]
    for page in pages:
        said = page.read_text()
        if page.suffix == ".ipynb":
            cells = json.loads(said)["cells"]
            said = "".join(f"```python\n{''.join(c['source'])}\n```\n" for c in cells)
        texts += re.findall(r"^```python\n(.*?)^```", said, re.M | re.S)
    for text in texts:
        with suppress(SyntaxError):  # magic words of a notebook
            for node in ast.walk(ast.parse(text)):
                yield from _imported(node)
    for name in PUBLIC:
        yield f"import {name}"
        yield from (f"import {name}:{x}" for x in getattr(import_module(name), "__all__", ()))


def _imported(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("softrobot_env"):
        yield from (f"import {node.module}:{alias.name}" for alias in node.names)
    elif isinstance(node, ast.Import):
        ours = [alias.name for alias in node.names if alias.name.startswith("softrobot_env")]
        yield from (f"import {name}" for name in ours)


def main() -> None:
    """Print or write the ledger."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path, nargs="?", const=LEDGER, metavar="FILE")
    chosen = parser.parse_args()
    text = "\n".join(entries()) + "\n"
    print(text, end="") if chosen.write is None else chosen.write.write_text(text)


if __name__ == "__main__":
    main()
