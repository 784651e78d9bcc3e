"""Imports go down only, and heavy packages load where they are used.

A part is a folder or a module of the package's top level. `FOUNDATION` describes robots and tasks
and names things; the `MIDDLE` parts, models, scenes and machines, build on it alone; what is above
them is in `ALLOWED`. Each test goes through all sources and reports all that break its rule.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.processes import finished

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "softrobot_env"

#: Robots, tasks and what everybody needs. `loads` and `twin` are public names of modules of
#: `robots`.
FOUNDATION = {"core", "robots", "tasks", "compile", "registration", "loads", "twin"}
MIDDLE = ("beams", "scene", "sensing", "learned", "hardware", "recordings")
EVERYTHING = None  # imports what it likes

#: Part of the package -> parts it may import, besides itself.
ALLOWED = {
    "__init__": {"registration", "core"},
    **dict.fromkeys(FOUNDATION, FOUNDATION),
    **dict.fromkeys(MIDDLE, FOUNDATION),
    # Tasks for any robot look up its workspace when one is made.
    "tasks": FOUNDATION | {"scene"},
    # Static feedforward inverts the scene of a robot; sensors stand in for what policies read.
    "control": FOUNDATION | {"beams", "learned", "scene", "sensing"},
    "envs": FOUNDATION | {"scene", "sensing", "hardware", "recordings"},
    # Motions of scenes, and of environments that it is given; equilibria of beam models.
    "gradients": FOUNDATION | {"beams", "scene", "envs"},
    # Its runner makes environment and policy of a case, for every command, benchmark and training.
    "evaluation": FOUNDATION | {"beams", "control", "envs", "recordings", "scene"},
    "rendering": FOUNDATION | {"evaluation", "scene"},
    "cli": EVERYTHING,
    "commands": EVERYTHING,  # one module per command of the cli
    "__main__": EVERYTHING,
    "training": EVERYTHING,
    "identification": EVERYTHING,
    "thesis": EVERYTHING,
    "scripts": EVERYTHING,
}

HEAVY = {
    "torch",
    "mujoco_warp",
    "warp",
    "stable_baselines3",
    "serial",
    "cv2",
    "imageio",
    "matplotlib",
    "PIL",
}

#: Modules of these parts exist for a heavy package and are themselves imported where used.
HEAVY_AT_HOME = {
    "rendering": {"matplotlib", "imageio", "PIL"},
    "learned": {"torch"},
    "training": {"torch", "stable_baselines3"},
    "hardware": {"serial"},
}

#: Modules that exist for heavy packages and are themselves imported where used.
HEAVY_MODULES = {
    "softrobot_env/envs/simulation/warp_batch.py": {"torch", "mujoco_warp", "warp"},
    "softrobot_env/gradients/wrappers.py": {"torch"},
}

#: Parts that every `gymnasium.make` loads; scipy costs more than the rest of them together.
WITHOUT_SCIPY = FOUNDATION | {"__init__", "envs", "scene"}

#: Modules that may import by a name made at run time, and why.
LOADERS = {
    "softrobot_env/core/registry.py": "what registries name",
    "softrobot_env/envs/rendering.py": "MuJoCo's own modules for OpenGL",
    "scripts/ledger.py": "what users reach by name",
}

SOURCES = sorted((ROOT / PACKAGE).rglob("*.py")) + sorted((ROOT / "scripts").rglob("*.py"))


def part_of(path: Path) -> str:
    """First level of the package a file belongs to, or "scripts"."""
    relative = path.relative_to(ROOT)
    if relative.parts[0] == "scripts":
        return "scripts"
    return Path(relative.parts[1]).stem


PARTS = {part_of(path) for path in SOURCES}


def imported(path: Path, nodes) -> list[str]:
    """Absolute dotted names of the modules and attributes that import nodes name."""
    names = []
    package = path.relative_to(ROOT).parent.parts
    for node in nodes:
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = ".".join((*above, *([node.module] if node.module else [])))
            names += [f"{base}.{alias.name}" for alias in node.names]
    return names


def run_at_import(tree: ast.Module) -> list[ast.AST]:
    """Nodes that run when the module is imported: everything outside functions and typing."""
    found, waiting = [], [tree]
    while waiting:
        for child in ast.iter_child_nodes(waiting.pop()):
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
                continue
            if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
                continue
            found.append(child)
            waiting.append(child)
    return found


def parts_in(names: list[str]) -> set[str]:
    """Parts of this package among dotted names."""
    ours = [p for p in (name.split(".") for name in names) if p[0] == PACKAGE]
    # `from softrobot_env import __version__` names no part.
    return {p[1] for p in ours if len(p) > 1 and p[1] in PARTS}


@pytest.fixture(scope="module")
def sources():
    """Every source and its tree."""
    return {path: ast.parse(path.read_text()) for path in SOURCES}


def test_the_reader_sees_every_form_of_import():
    text = "import a.b, c\nfrom d import e\nfrom . import f\nfrom ..g import h\ndef i():\n import j"
    path = ROOT / PACKAGE / "envs" / "x.py"
    tree = ast.parse(text)
    found = " ".join(imported(path, ast.walk(tree)))
    assert found == "a.b c d.e softrobot_env.envs.f softrobot_env.g.h j"
    assert "j" not in imported(path, run_at_import(tree))


def offenders(sources, wrong) -> dict[str, list[str]]:
    """Sources and the names in them that are wrong there, by `wrong(path, tree)`."""
    found = {p.relative_to(ROOT).as_posix(): sorted(wrong(p, t)) for p, t in sources.items()}
    return {path: names for path, names in found.items() if names}


def test_no_name_is_defined_twice(sources):
    """Such as two helpers of a module, of which the second one takes the place of the first."""

    def twice(path, tree):
        for scope in (node for node in ast.walk(tree) if hasattr(node, "body")):
            body = scope.body if isinstance(scope, ast.Module | ast.ClassDef) else ()
            made = [n for n in body if isinstance(n, ast.FunctionDef | ast.ClassDef)]
            plain = [node.name for node in made if not node.decorator_list]
            yield from {name for name in plain if plain.count(name) > 1}

    assert not offenders(sources, twice)


def test_imports_go_down_only(sources):
    def up(path, tree):
        part = part_of(path)
        assert part in ALLOWED, f"{part!r} has no place in the import table"
        if ALLOWED[part] is EVERYTHING:
            return ()
        return parts_in(imported(path, ast.walk(tree))) - ALLOWED[part] - {part}

    assert not offenders(sources, up)


@pytest.fixture(scope="module")
def imports(sources) -> dict[str, set[str]]:
    """Module -> modules of ours that it imports, also within functions, but for types alone."""
    named = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in sources
        if part_of(path) != "scripts"
    }
    found = {}
    for module, path in named.items():
        names = set()
        for name in imported(path, but_for_types(sources[path])):
            while name and name not in named:  # of something in a module
                name = name.rpartition(".")[0]
            names.add(name)
        found[module] = names - {"", module}
    return found


def but_for_types(tree: ast.AST) -> Iterator[ast.AST]:
    """All nodes but those that run for type checkers alone."""
    for child in ast.iter_child_nodes(tree):
        if not (isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test)):
            yield child
            yield from but_for_types(child)


def in_circles(imports: dict[str, set[str]]) -> list[str]:
    """Who is left after those that import nobody left, and those whom nobody left imports."""
    left = dict(imports)
    while True:
        wanted = set().union(*left.values()) if left else set()
        ends = [name for name in left if name not in wanted or not left[name] & left.keys()]
        if not ends:
            return sorted(left)
        for name in ends:
            del left[name]


def test_no_modules_import_each_other(imports):
    assert len(imports) > 100
    assert not in_circles(imports)


def test_no_parts_import_each_other(imports):
    parts: dict[str, set[str]] = {}
    for module, names in imports.items():
        part = ([*module.split("."), "__init__"])[1]
        others = {([*name.split("."), "__init__"])[1] for name in names}
        parts.setdefault(part, set()).update(others - {part})
    assert not in_circles(parts)


def test_circles_are_found():
    chain = {"a": {"b"}, "b": {"c"}, "c": set()}
    assert not in_circles(chain)
    assert in_circles(chain | {"c": {"b"}}) == ["b", "c"]
    only_types = "if TYPE_CHECKING:\n import a\ndef f():\n import b"
    assert imported(ROOT / PACKAGE / "x.py", but_for_types(ast.parse(only_types))) == ["b"]


def test_nothing_imports_the_thesis(sources):
    """It is a plug-in as an outsider's: known by its entry points alone."""

    def own(path, tree):
        if part_of(path) in ("thesis", "scripts"):
            return ()
        return {n for n in named_in(path, tree) if n.startswith(f"{PACKAGE}.thesis")}

    assert not offenders(sources, own)


def test_controllers_never_see_a_twin(sources):
    """What is wrong with a rig is for the environments alone.

    A twin is in `robots/twin.py`, has the public name `softrobot_env.twin`, and whoever imports
    one of its names may pass it on: modules of that name and all that it defines are banned, in
    imports as in paths that a registry loads.
    """
    tree = ast.parse((ROOT / PACKAGE / "robots" / "twin.py").read_text())
    banned = {"twin"} | {
        node.name for node in tree.body if isinstance(node, ast.ClassDef | ast.FunctionDef)
    }
    assert {"Twin", "sampled_twin"} < banned

    def seen(path, tree):
        if part_of(path) not in ("control", "learned", "beams"):
            return ()
        ours = (name for name in named_in(path, tree) if name.startswith(PACKAGE))
        return {name for name in ours if banned & set(name.split("."))}

    assert not offenders(sources, seen)


def named_in(path: Path, tree: ast.Module) -> list[str]:
    """What a source imports, and what it names for registries to load."""
    loaded = [text.replace(":", ".") for text in paths_in(tree)]
    return imported(path, ast.walk(tree)) + loaded


def paths_in(tree: ast.Module) -> list[str]:
    """Texts that name a module of the package or something in one."""
    constants = (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant))
    texts = (value for value in constants if isinstance(value, str))
    return [text for text in texts if re.fullmatch(rf"{PACKAGE}(\.\w+)+(:\w+)?", text)]


def test_heavy_packages_load_where_they_are_used(sources):
    def top(path, tree):
        part = part_of(path)
        banned = HEAVY - HEAVY_AT_HOME.get(part, set())
        banned |= {"scipy"} if part in WITHOUT_SCIPY else set()
        banned -= HEAVY_MODULES.get(str(path.relative_to(ROOT)), set())
        return {name.split(".")[0] for name in imported(path, run_at_import(tree))} & banned

    assert not offenders(sources, top)


def test_only_registries_load_by_names_made_at_run_time(sources):
    """Paths written as one text are found by search and by tests; composed ones are not."""
    banned = {"import_module", "__import__", "run_module", "run_path", "exec_module"}

    def made(_, tree):
        names = {getattr(node, "id", getattr(node, "attr", None)) for node in ast.walk(tree)}
        names |= {node.name for node in ast.walk(tree) if isinstance(node, ast.alias)}
        return names & banned

    assert set(offenders(sources, made)) == set(LOADERS)


def test_what_registries_name_is_written_whole(sources):
    """`load` takes texts of registries, never one that is put together."""
    composed = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path, tree in sources.items()
        if part_of(path) != "scripts"
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and node.args
        if isinstance(node.args[0], ast.JoinedStr | ast.BinOp)
        if ast.unparse(node.func).split(".")[-1] == "load"
        if PACKAGE in ast.unparse(node.args[0])
    ]
    assert not composed


@pytest.mark.parametrize(
    ("module", "banned"),
    [
        ("softrobot_env", {"mujoco", "scipy", "numba", *HEAVY}),
        ("softrobot_env.tasks", {"mujoco", "scipy", "numba", *HEAVY}),
        ("softrobot_env.envs.tracking", {"scipy", "numba", *HEAVY}),
    ],
)
def test_importing_stays_light(module, banned):
    code = f"import sys, {module}; print(*{{m.split('.')[0] for m in sys.modules}})"
    result = finished("-W", "error", "-c", code, cwd=ROOT, check=True)
    loaded = set(result.stdout.split())
    assert "softrobot_env" in loaded
    assert not loaded & banned
