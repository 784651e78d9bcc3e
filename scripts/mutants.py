"""Seeded mutants: how many of some small faults do the tests find?

    python scripts/mutants.py draw mutants.json                 # from the sources of this tree
    nice -n 19 python scripts/mutants.py run mutants.json --tree TREE --minutes 60

A mutant is one changed operator, comparison or number, or one removed statement, in a function. It
is known by the function's name and the text of its statement, so that it can be made anew where
that stands now. The sources stay as they are: faults are made in a copy of the tree, whose tests
run in the tree's own environment (`make .venv/.setup-test`). `run` takes the mutants in their
order, those of compiled functions last, up to the time that is given, and goes on where it was
stopped. The tests of a mutant are those of the file of tests that has its module's name, and of
others that import the module or name the function.
"""

import argparse
import ast
import json
import os
import random
import re
import shutil
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

PACKAGE = "softrobot_env"

#: Files of tests of a mutant, and the longest that they may take [s]; who takes longer is found.
_FILES, _LONGEST = 3, 150.0

#: What is said of a fault with which not even the tests' imports work.
_NOT_BEGUN = "the tests do not begin"

_PAIRS = "Add Sub, Mult Div, Lt LtE, Gt GtE, Eq NotEq, Is IsNot, In NotIn, And Or"
_SWAPS = {}
for _one, _other in (map(ast.__dict__.get, pair.split()) for pair in _PAIRS.split(", ")):
    _SWAPS |= {_one: _other, _other: _one}
_SWAPS |= {ast.Pow: ast.Mult, ast.FloorDiv: ast.Div, ast.Mod: ast.FloorDiv, ast.MatMult: ast.Mult}


@dataclass
class Mutant:
    """A fault.

    Attributes:
        kind: "arithmetic", "comparison", "constant" or "removed".
        file: Where it was drawn.
        function: Name of its function, with those around it.
        statement: Text of its statement; of one with others in it, its first line.
        node: Number of the changed node in the statement.
        compiled: Whether the function is compiled.
        verdict: "killed", "survived", "not applicable", or "undecided" where tests take too long,
            as they do where much is compiled; None where it was not run.
        by: Test that found it, or why it is not applicable.
        seconds: That its tests took.
    """

    kind: str
    file: str
    function: str
    statement: str
    node: int
    compiled: bool = False
    verdict: str | None = None
    by: str = ""
    seconds: float = 0.0


def functions(tree: ast.AST, within: str = "") -> Iterator[tuple[str, ast.AST]]:
    """All functions and their names."""
    for node in ast.iter_child_nodes(tree):
        name = within
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            name = f"{within}.{node.name}" if within else node.name
            if isinstance(node, ast.FunctionDef):
                yield name, node
        yield from functions(node, name)


def is_compiled(function: ast.FunctionDef) -> bool:
    """Whether a decorator of ours or of Numba compiles it."""
    said = " ".join(ast.unparse(one) for one in function.decorator_list)
    return bool(re.search("kernel|jit|compiled|cfunc", said))


def statements(function: ast.AST) -> Iterator[tuple[list[ast.stmt], int]]:
    """Blocks and places in them of a function's statements, but for functions in it."""
    for field in ("body", "orelse", "finalbody", "handlers"):
        block = getattr(function, field, [])
        for place, node in enumerate(block):
            if isinstance(node, ast.stmt) and not isinstance(node, ast.FunctionDef | ast.ClassDef):
                yield block, place
            if not isinstance(node, ast.FunctionDef | ast.ClassDef):
                yield from statements(node)


def text_of(statement: ast.stmt) -> str:
    """Its text; of one with others in it, its first line."""
    text = ast.unparse(statement)
    return text.split("\n")[0] if hasattr(statement, "body") else text


def nodes(statement: ast.AST) -> list[ast.AST]:
    """Nodes of a statement but for the statements in it."""
    found = [statement]
    for child in ast.iter_child_nodes(statement):
        if not isinstance(child, ast.stmt | ast.JoinedStr | ast.ExceptHandler):
            found += nodes(child)
    return found


def kind_of(node: ast.AST, is_first: bool) -> str | None:
    """How a node can be changed."""
    if isinstance(node, ast.BinOp | ast.AugAssign) and type(node.op) in _SWAPS:
        return "arithmetic"
    if isinstance(node, ast.BoolOp) or (isinstance(node, ast.Compare) and len(node.ops) == 1):
        return "comparison"
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return "constant"
    said = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    return "removed" if is_first and (said or isinstance(node, ast.Raise)) else None


def change(block: list[ast.stmt], place: int, number: int, kind: str) -> None:
    """Make the fault of a statement's node."""
    node = nodes(block[place])[number]
    if kind == "removed":
        block[place] = ast.copy_location(ast.Pass(), node)
    elif kind == "constant":
        value = node.value
        node.value = not value if isinstance(value, bool) else value + 1
    elif isinstance(node, ast.Compare):
        node.ops = [_SWAPS[type(node.ops[0])]()]
    else:
        node.op = _SWAPS[type(node.op)]()


def draw(tree: Path, count: int, seed: int) -> list[Mutant]:
    """Mutants of each kind alike, no two of one statement."""
    by_kind: dict[str, list[Mutant]] = {}
    for path in sorted((tree / PACKAGE).rglob("*.py")):
        file = path.relative_to(tree / PACKAGE).as_posix()
        for name, function in functions(ast.parse(path.read_text())):
            for block, place in statements(function):
                text = text_of(block[place])
                for number, node in enumerate(nodes(block[place])):
                    kind = kind_of(node, number == 0)
                    if kind is not None:
                        mutant = Mutant(kind, file, name, text, number, is_compiled(function))
                        by_kind.setdefault(kind, []).append(mutant)
    rng, drawn, seen = random.Random(seed), [], set()
    while len(drawn) < count:
        mutant = rng.choice(by_kind[sorted(by_kind)[len(drawn) % len(by_kind)]])
        key = mutant.file, mutant.function, mutant.statement
        if key not in seen:
            seen.add(key)
            drawn.append(mutant)
    return drawn


def made(mutant: Mutant, tree: Path) -> tuple[Path, str] | None:
    """The file in which a mutant's statement stands now, and its changed source; None where it
    stands nowhere. Of several places the one with most of the name, then of the file's name."""
    last, places = mutant.function.split(".")[-1], []
    for path in sorted((tree / PACKAGE).rglob("*.py")):
        module = ast.parse(path.read_text())
        for name, function in functions(module):
            found = statements(function) if name.split(".")[-1] == last else ()
            there = [one for one in found if text_of(one[0][one[1]]) == mutant.statement]
            if there:
                rank = name == mutant.function, path.stem == Path(mutant.file).stem
                places.append((rank, path, module, there[0]))
    if not places:
        return None
    _, path, module, (block, place) = max(places, key=lambda one: one[0])
    change(block, place, mutant.node, mutant.kind)
    return path, ast.unparse(module)


def tests_of(mutant: Mutant, path: Path, tree: Path) -> list[str]:
    """Files of tests that concern a mutant, those that do most first."""
    module = ".".join(path.relative_to(tree).with_suffix("").parts).removesuffix(".__init__")
    parts = mutant.function.split(".")
    names = [name for name in parts if not name.startswith("_")] or parts
    ranked = []
    for test in sorted((tree / "tests").rglob("test_*.py")):
        where = test.relative_to(tree / "tests")
        if where.parts[0] in ("clients", "cluster", "gpu", "docs", "benchmarks", "studies"):
            continue
        text = test.read_text()
        rank = 3 * (where.stem == f"test_{path.stem}" or where.stem == f"test_{path.parent.name}")
        rank += 2 * bool(re.search(rf"\b{re.escape(module)}\b", text))
        rank += 2 * any(re.search(rf"\b{name}\b", text) for name in names)
        rank += where.parts[0] == module.split(".")[1]
        if rank:
            ranked.append((-rank, len(text), str(test)))
    return [name for _, _, name in sorted(ranked)[:_FILES]]


class Runner:
    """Runs tests on mutants of a copy of a tree.

    Args:
        tree: The tree.
        folder: For the copy.
    """

    def __init__(self, tree: Path, folder: Path) -> None:
        self._python = tree / ".venv" / "bin" / "python"
        aside = shutil.ignore_patterns(".git", ".venv", "out")
        self._tree = Path(shutil.copytree(tree, folder / "tree", ignore=aside))
        self._sound: dict[str, bool] = {}

    def run(self, mutant: Mutant) -> None:
        """Find the verdict."""
        begin, found = time.monotonic(), made(mutant, self._tree)
        if found is None:
            mutant.verdict, mutant.by = "not applicable", "the statement stands nowhere"
            return
        path, source = found
        tests = tests_of(mutant, path, self._tree)
        if not tests:
            mutant.verdict, mutant.by = "survived", "no test names it"
            return
        failed = self._failed_of(path, source, tests)
        while failed not in (None, "time", _NOT_BEGUN) and not self._passes(failed):
            # It fails without the mutant, too.
            tests = [x for x in tests if x != str(self._tree / failed)]
            tests += ["--deselect", failed] if "::" in failed else []
            failed = self._failed_of(path, source, tests)
        mutant.verdict = {None: "survived", "time": "undecided"}.get(failed, "killed")
        mutant.by, mutant.seconds = failed or "", round(time.monotonic() - begin, 1)

    def _passes(self, test: str) -> bool:
        if test not in self._sound:
            self._sound[test] = self._failed([test]) is None
        return self._sound[test]

    def _failed_of(self, path: Path, source: str, tests: list[str]) -> str | None:
        """As `_failed`, with another source of a module."""
        own = path.read_text()
        path.write_text(source)
        try:
            return self._failed(tests)
        finally:
            path.write_text(own)

    def _failed(self, tests: list[str]) -> str | None:
        """The first test that fails, "time" where they take too long; None if all pass."""
        environment = os.environ | {"PYTHONPATH": str(self._tree)}
        environment |= dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
        words = ["-x", "-q", "--no-header", "-p", "no:cacheprovider", "--tb=no", "-rfE"]
        words += ["-m", "not slow and not cluster and not gpu and not realtime"]
        command = [str(self._python), "-m", "pytest", *words, *tests]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
        own = {"cwd": self._tree, "env": environment, "start_new_session": True}
        with subprocess.Popen(command, **own, **pipes) as process:
            try:
                said, _ = process.communicate(timeout=_LONGEST)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, 9)
                return "time"
        first = re.search(r"^(?:FAILED|ERROR) (\S+::\S+|\S+)", said, re.M)
        if process.returncode in (0, 5):
            return None
        return first[1] if first else _NOT_BEGUN


def main() -> None:
    """Draw, run or count."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=("draw", "run", "show"))
    parser.add_argument("file", type=Path, help="JSON file of mutants")
    parser.add_argument("--tree", type=Path, default=Path(__file__).resolve().parents[1])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=37)
    parser.add_argument("--minutes", type=float, default=60.0, help="that a run may take")
    parser.add_argument("--drawn", type=Path, help="file of the mutants that a new file takes over")
    args = parser.parse_args()
    tree = args.tree.resolve()
    if args.what == "draw":
        save(args.file, draw(tree, args.count, args.seed))
    new = args.drawn is not None and not args.file.is_file()
    mutants = [Mutant(**m) for m in json.loads((args.drawn if new else args.file).read_text())]
    if new:
        mutants = [replace(m, verdict=None, by="", seconds=0.0) for m in mutants]
    if args.what == "run":
        until = time.monotonic() + 60 * args.minutes
        with tempfile.TemporaryDirectory() as folder:
            runner = Runner(tree, Path(folder))
            for mutant in sorted(mutants[: args.count], key=lambda mutant: mutant.compiled):
                if mutant.verdict is None and time.monotonic() < until:
                    runner.run(mutant)
                    save(args.file, mutants)
    print(dict(Counter(str(mutant.verdict) for mutant in mutants)))


def save(path: Path, mutants: list[Mutant]) -> None:
    """Write mutants."""
    aside = path.with_suffix(".new")
    aside.write_text(json.dumps([asdict(mutant) for mutant in mutants], indent=1) + "\n")
    aside.replace(path)


if __name__ == "__main__":
    main()
