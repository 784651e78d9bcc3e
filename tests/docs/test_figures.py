"""Figures of README.md and docs/ come from the committed reports, and are not typed."""

import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
spec = importlib.util.spec_from_file_location("figures", ROOT / "scripts" / "figures.py")
figures = importlib.util.module_from_spec(spec)
spec.loader.exec_module(figures)

#: Text between marks, code, links and comments, whose numbers are not typed results.
NOT_TYPED = re.compile(
    r"<!-- figures\s.*?<!-- end -->|<!--.*?-->|^```.*?^```|`[^`\n]*`|\]\([^)]*\)", re.S | re.M
)
#: A number and what makes it a measurement.
MEASURED = re.compile(r"\d[\d .,]*(?:mm|µs|ms|%|times|steps a second)(?!\w)")

#: How many numbers with units the running text of a page of docs/ still has: settings, quotations
#: of the thesis, what tests measure, and results to be taken from reports. It may only fall.
LEFT = {
    "clients.md": 1,
    "explanation/chain.md": 7,
    "explanation/time.md": 8,
    "howto/beams.md": 3,
    "howto/contacts.md": 7,
    "howto/environments.md": 2,
    "howto/gripper.md": 11,
    "howto/identification.md": 10,
    "howto/own_robot.md": 3,
    "howto/policies.md": 13,
    "howto/reduced_models.md": 1,
    "howto/several_robots.md": 1,
    "results/accuracy.md": 3,
    "results/index.md": 1,
    "results/learning.md": 3,
    "results/link.md": 6,
    "results/policies.md": 1,
    "results/rig.md": 9,
    "results/robots.md": 11,
    "results/sections.md": 1,
    "results/sensing.md": 13,
    "results/speed.md": 1,
    "results/stability.md": 8,
    "thesis_audit.md": 40,
}


def typed(text):
    return [found[0] for found in MEASURED.finditer(NOT_TYPED.sub("", text))]


def typed_tables(text):
    lines = NOT_TYPED.sub("", text).splitlines()
    return [line for line in lines if line.startswith("|") and re.search(r"\|[^|a-z]*\d", line)]


@pytest.mark.parametrize("path", figures.pages(), ids=lambda path: path.name)
def test_no_figure_is_stale(path):
    text = path.read_text()
    assert figures.fill(text) == text


def test_no_figure_of_the_readme_is_typed():
    assert typed((ROOT / "README.md").read_text()) == []


def test_no_more_figures_are_typed():
    docs = ROOT / "docs"
    found = {p.relative_to(docs).as_posix(): typed(p.read_text()) for p in figures.pages()[1:]}
    assert {page: len(x) for page, x in found.items() if x} == LEFT


@pytest.mark.parametrize(
    "path", sorted((ROOT / "docs" / "results").glob("*.md")), ids=lambda path: path.name
)
def test_no_table_of_results_is_typed(path):
    assert typed_tables(path.read_text()) == []


def test_typed_figures_are_found():
    assert typed("errs by 0.5 mm") and not typed("<!-- figures {a: b} -->0.5 mm<!-- end -->")
    assert typed_tables("| a | 0.5 |") and not typed_tables("| a | the same |")


def test_templates():
    made = figures.filled(
        "each seed = 0, 1\na\n{seed}: {ppo_defaults case=ArmStep seed={seed}: error mm 3}"
    )
    errors = [r["error"] for r in figures.rows("ppo_defaults") if r["case"] == "ArmStep"]
    assert made.splitlines() == ["a", *(f"{k}: {1e3 * errors[k]:.3g}" for k in (0, 1))]
    assert (
        figures.figure("ppo_defaults case=ArmStep", "largest error mm 3")
        == f"{1e3 * max(errors):.3g}"
    )
    assert figures.figure("ppo_defaults", "count error d") == "12"
    assert figures.significant(28_037.6, 2) == "28 000"


@pytest.mark.parametrize(
    "source, shown, message",
    [
        ("nothing", "error", "no report"),
        ("ppo_defaults case=ArmStep", "error", "3 rows"),
        ("ppo_defaults case=other", "error", "no row"),
        ("ppo_defaults case=ArmStep", "speed", "no row"),
    ],
)
def test_refused(source, shown, message):
    with pytest.raises(ValueError, match=message):
        figures.figure(source, shown)
