"""Every public module, class, function and method says what it is."""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import softrobot_env

ROOT = Path(softrobot_env.__file__).parent


def is_public(path: Path) -> bool:
    names = path.relative_to(ROOT).with_suffix("").parts
    return all(not name.startswith("_") or name.startswith("__") for name in names)


@cache
def trees() -> dict[Path, ast.Module]:
    files = filter(is_public, sorted(ROOT.rglob("*.py")))
    return {path: ast.parse(path.read_text()) for path in files}


@cache
def classes() -> list[ast.ClassDef]:
    return [x for tree in trees().values() for x in ast.walk(tree) if isinstance(x, ast.ClassDef)]


def functions(node: ast.Module | ast.ClassDef) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Public ones; a property's setter is told of by the property."""
    for child in node.body:
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            setter = any(
                isinstance(x, ast.Attribute) and x.attr in ("setter", "deleter")
                for x in child.decorator_list
            )
            if not child.name.startswith("_") and not setter:
                yield child


def is_inherited(owner: ast.ClassDef, name: str) -> bool:
    """Whether a method of that name is documented in a base class of ours."""
    bases = {ast.unparse(base).split("[")[0].split(".")[-1] for base in owner.bases}
    ours = [x for x in classes() if x.name in bases and x is not owner]
    return any(
        any(f.name == name and ast.get_docstring(f) for f in functions(base))
        or is_inherited(base, name)
        for base in ours
    )


def undocumented(tree: ast.Module) -> Iterator[str]:
    """Names of what has no docstring."""
    if not ast.get_docstring(tree) and tree.body:
        yield "the module"
    yield from (f.name for f in functions(tree) if not ast.get_docstring(f))
    for owner in (x for x in tree.body if isinstance(x, ast.ClassDef)):
        if owner.name.startswith("_"):
            continue
        if not ast.get_docstring(owner):
            yield owner.name
        for method in functions(owner):
            if not ast.get_docstring(method) and not is_inherited(owner, method.name):
                yield f"{owner.name}.{method.name}"


def test_all_that_is_public_has_a_docstring():
    missing = [
        f"{p.relative_to(ROOT)}: {x}" for p, tree in trees().items() for x in undocumented(tree)
    ]
    assert not missing, "\n".join(missing)


def test_what_lacks_a_docstring_is_found():
    source = "class A:\n    def f(self): ...\n    def _g(self): ...\ndef h(): ...\ndef _i(): ..."
    assert list(undocumented(ast.parse(source))) == ["the module", "h", "A", "A.f"]
