"""Pages of docs/reference, and the API reference, are those of the code."""

import ast
import re
from pathlib import Path

import gymnasium
import pytest

import reference
import softrobot_env  # noqa: F401  (registers the environments)
from softrobot_env.robots import read_robot

ROOT = Path(__file__).resolve().parents[2]
WRITTEN = reference.pages()
#: What of a robot is read before its other tables.
SECTION = """
[[section]]
length_m = 0.2
outer_radius_m = 0.02
youngs_modulus_Pa = 1e6
density_kg_m3 = 1000
damping_time_s = 0.02
"""
#: What it offers is described in the modules that define it.
NOT_LISTED = {"softrobot_env"}


@pytest.mark.parametrize("path", WRITTEN, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_no_page_is_stale(path):
    assert path.read_text(encoding="utf-8") == WRITTEN[path]


@pytest.mark.parametrize("name", reference.TABLES)
def test_the_keys_are_those_that_a_file_may_have(name, tmp_path):
    heading = reference.HEADINGS[name] if name not in ("", "base") else name and "[base]"
    rest = "" if name == "section" else SECTION
    text = f'name = "x"\n{heading}\nno_such_key = 1\n{rest}'
    (tmp_path / "robot.toml").write_text(text)
    with pytest.raises(ValueError, match="no_such_key is no key") as refused:
        read_robot(tmp_path / "robot.toml")
    known = re.search(r"allowed are (.*)", str(refused.value))[1].split(", ")
    page = (reference.REFERENCE / "robot_file.md").read_text().split("# Keys of a gripper file")[0]
    (part,) = (p for p in page.split("\n## ") if p.startswith(f"{reference.HEADINGS[name]}\n"))
    assert re.findall(r"^\| `(\w+)` \|", part, re.M) == known


def test_every_environment_has_a_page_and_a_picture():
    ids = {name for name in gymnasium.registry if name.startswith("SoftRobot/")}
    assert ids == set(reference.ABOUT)
    for path in WRITTEN:
        for link in re.findall(r"!\[.*?\]\((.*?)\)", path.read_text()):
            assert (path.parent / link).is_file()


def test_every_module_that_pages_import_is_in_the_api_reference():
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").glob("*.py")]
    texts = [page.read_text() for page in pages]
    code = [
        block for text in texts for block in re.findall(r"^```py.*?\n(.*?)^```", text, re.M | re.S)
    ]
    code += [page.read_text() for page in pages if page.suffix == ".py"]
    found = {
        node.module
        for block in code
        for node in ast.walk(ast.parse(block))
        if isinstance(node, ast.ImportFrom) and node.module.startswith("softrobot_env")
    }
    listed = (ROOT / "docs" / "api.md").read_text().split()
    assert len(found) > 20
    assert sorted(found - NOT_LISTED - set(listed)) == []
