"""Code of README.md and docs/ runs: imports and command lines always, whole pages where slow."""

import argparse
import ast
import os
import re
import shlex
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

from softrobot_env.cli import build_parser, main
from softrobot_env.core.studies import BENCHMARKS

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    path
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
    if not {"results", "models", "api", "demo"} & set(path.relative_to(ROOT).parts)
]
#: Pages whose Python is not run from top to bottom, and why.
NOT_RUN = {
    "docs/howto/gpu.md": "needs a graphics card",
    "docs/howto/hardware.md": "needs a robot",
    "docs/howto/motors.md": "needs a robot",
    "docs/howto/own_task.md": "is run by tests/commands/test_any_robot.py",
    "docs/howto/twelve_tasks.md": "is run by tests/docs/test_twelve_tasks.py",
}
#: What a page's Python needs to have been done, in fewer steps.
BEFORE = {
    "docs/howto/own_robot.md": "export --robot hanging_trunk --out out",
    "docs/howto/policies.md": "train lq_preview --robot my.toml --quick",
}
#: What trainings take, and what they take here.
SHORTER = {"200_000": "256"}


def blocks(path, language):
    return re.findall(rf"^```{language}\n(.*?)^```", path.read_text(), re.M | re.S)


def lacks_jax(code):
    """Whether it needs JAX, which is not installed."""
    return "import jax" in code and find_spec("jax") is None


def name(path):
    return path.relative_to(ROOT).as_posix()


def test_pages_have_code():
    assert sum(len(blocks(path, "python")) for path in PAGES) > 15
    assert sum(len(blocks(path, "bash")) for path in PAGES) > 10
    assert set(NOT_RUN) <= {name(path) for path in PAGES}


def test_imports_work():
    found = {
        ast.unparse(node)
        for path in PAGES
        for block in blocks(path, "python")
        for node in ast.walk(ast.parse(block))
        if isinstance(node, ast.Import | ast.ImportFrom)
    }
    for line in found:
        if "stable_baselines3" in line or "training" in line:
            pytest.importorskip("stable_baselines3")
        if lacks_jax(line):
            continue
        exec(compile(line, "docs", "exec"), {})


@pytest.mark.parametrize("path", PAGES, ids=name)
def test_command_lines_are_understood(path):
    parser = build_parser()
    for block in blocks(path, "bash"):
        for line in block.splitlines():
            program, *words = shlex.split(line, comments=True) or [""]
            if program == "softrobot":
                parser.parse_args(words)  # ends with status 2 where it is not


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", [p for p in PAGES if blocks(p, "python") and name(p) not in NOT_RUN], ids=name
)
def test_python_runs(path, tmp_path, monkeypatch):
    if "stable_baselines3" in path.read_text():
        pytest.importorskip("stable_baselines3")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").mkdir()
    (tmp_path / "my.toml").write_text(blocks(ROOT / "README.md", "toml")[0])
    if name(path) in BEFORE:
        assert main(shlex.split(BEFORE[name(path)])) == 0
    known = {}
    for block in blocks(path, "python"):
        if lacks_jax(block):
            continue
        for long, short in SHORTER.items():
            block = block.replace(long, short)
        exec(compile(block, name(path), "exec"), known)


@pytest.mark.slow
def test_exported_robot_is_drawn_by_mujoco_alone(tmp_path, monkeypatch):
    page = ROOT / "docs" / "howto" / "own_robot.md"
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(BEFORE[name(page)])) == 0
    attach = next(code for code in blocks(page, "python") if "world.attach" in code)
    code = attach + blocks(page, "py")[0]
    # In a process of its own: MuJoCo chooses its OpenGL when it is imported.
    environment = {"MUJOCO_GL": "egl"} | os.environ
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)
    assert len(np.unique(plt.imread("attached.png").reshape(-1, 3), axis=0)) > 1000


def test_relative_links_of_the_readme_lead_somewhere():
    links = re.findall(r"\]\(([^)#:]+)\)", (ROOT / "README.md").read_text())
    assert len(links) > 20
    assert [link for link in links if not (ROOT / link).exists()] == []


def test_moving_pictures_of_the_readme_are_small():
    links = re.findall(r"\]\(([^)]+\.gif)\)", (ROOT / "README.md").read_text())
    assert len(links) == 3
    assert sum((ROOT / link).stat().st_size for link in links) < 3e6


def test_every_model_card_has_a_page():
    pages = ROOT / "docs" / "models"
    index = (pages / "index.md").read_text().splitlines()
    for card in (ROOT / "models").glob("*.md"):
        assert f"../../models/{card.name}" in (pages / card.name).read_text()
        assert card.stem in index


def test_every_command_and_benchmark_is_on_the_page_of_commands():
    page = (ROOT / "docs" / "howto" / "commands.md").read_text()
    parser = build_parser()
    (choices,) = [a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    missing = [name for name in choices if f"softrobot {name}" not in page]
    missing += [name for name in BENCHMARKS if f"softrobot benchmark {name}" not in page]
    assert missing == []


def test_every_place_on_the_map_exists():
    found = re.findall(r"`([\w/]+\.py)(?:: ([\w.]+))?`", (ROOT / "docs" / "layout.md").read_text())
    assert len(found) > 30
    for file, place in found:
        path = ROOT / file if (ROOT / file).exists() else ROOT / "softrobot_env" / file
        text = path.read_text()
        for one in place.split(".") if place else ():
            assert re.search(rf"^ *(?:(?:def|class) {one}\b|{one}(?:: .+)? = )", text, re.M), place
