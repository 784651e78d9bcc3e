"""Figures of README.md and docs/ come from the committed reports, and are not typed."""

import gzip
import importlib.util
import json
from pathlib import Path

import pytest

import softrobot_env.robots
from softrobot_env.core import sources

ROOT = Path(__file__).resolve().parents[2]
spec = importlib.util.spec_from_file_location("figures", ROOT / "scripts" / "figures.py")
figures = importlib.util.module_from_spec(spec)
spec.loader.exec_module(figures)


def shown(path):
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("path", figures.pages(), ids=shown)
def test_no_figure_is_stale(path):
    text = path.read_text()
    assert figures.fill(text) == text


@pytest.mark.parametrize("path", figures.pages(), ids=shown)
def test_no_figure_is_typed(path):
    assert figures.typed(path.read_text()) == []


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("It errs by 0.5 mm.", ["0.5"]),
        ("| `mpc` | 12 |", ["12"]),
        ("- 30 000 steps, `0.3 mm` off", ["30 000", "0.3"]),
        ("82 of 84 goals, 1e-3 of the length", ["82", "84", "1e-3"]),
        ("<!-- figures {laws met=True: count met} of 84 -->82 of 84<!-- end -->", ["84"]),
        ("<!-- figures {laws met=True: count met} -->82<!-- end --> of 84", ["84"]),
        ("| place | printed | used |\n|---|---|---|\n| Tab. 6.1 | 25 mm | 12 mm |", ["12"]),
    ],
)
def test_a_typed_figure_is_found(text, found):
    assert figures.typed(text) == found


@pytest.mark.parametrize(
    "text",
    [
        "`softrobot render --fps 12`, Python 3.11, sec. 6.6.1, Figs. 5.10, 5.11 and 5.14, (2.91)",
        "```python\nsteps = 200_000\n```\n[results](results/2026.md), the twins 0 to 3, seed 0",
        "1. first\n2. float32 in 3-D, 1/m, 2026",
        "<!-- figures {laws met=True: count met} -->82<!-- end -->",
        "<!-- figures\n| lap of 1 s |\n| {rig policy=hybrid period=1.0 twin=: e_mean mm} |\n-->",
    ],
)
def test_what_is_no_typed_figure(text):
    assert figures.typed(text) == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("It errs by 0.5 mm.", "typed figure '0.5'"),
        ("<!-- figures {laws met=True: count met} -->81<!-- end -->", "stale"),
        ("<!-- figures {laws met=maybe: count met} -->81<!-- end -->", "no row of 'laws'"),
        ("<!-- figures {code robots.ARM: lenght} -->1<!-- end -->", "has no 'lenght'"),
    ],
)
def test_the_check_fails(tmp_path, monkeypatch, capsys, text, said):
    page = tmp_path / "page.md"
    page.write_text(text)
    figures.rows("laws")  # is kept
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    monkeypatch.setattr(figures, "pages", lambda: [page])
    monkeypatch.setattr(figures.sys, "argv", ["figures.py", "--check"])
    assert figures.main() == 1
    assert said in capsys.readouterr().out
    assert page.read_text() == text


@pytest.fixture
def results(tmp_path, monkeypatch):
    """Adds reports to a folder of them: `results(name, **meta)`."""
    monkeypatch.setattr(figures, "ROOT", tmp_path)
    monkeypatch.setattr(figures, "pages", list)
    figures.content.cache_clear()

    def add(name, file="report.json", **meta):
        folder = tmp_path / "docs" / "results" / name
        folder.mkdir(parents=True)
        opener = gzip.open if file.endswith("gz") else open
        with opener(folder / file, "wt", encoding="utf-8") as report:
            json.dump({"meta": {"command": f"softrobot {name}"} | meta, "rows": []}, report)

    yield add
    figures.content.cache_clear()


def said(monkeypatch, capsys, *words):
    """Exit status, and lines that are printed."""
    monkeypatch.setattr(figures.sys, "argv", ["figures.py", *words])
    return figures.main(), capsys.readouterr().out.splitlines()


def test_reports_older_than_their_code_are_named(results, monkeypatch, capsys):
    module = "softrobot_env.tasks.spec"
    digest = sources.digest(sources._place(module))
    old = {f"softrobot_env.gone_{k}": digest for k in range(4)}
    results("new", sources={module: digest}, seconds=5.0)
    assert said(monkeypatch, capsys, "--check", "--fresh") == (0, [])
    results("changed", sources={module: digest[::-1]}, seconds=70.2)
    results("unknown", command="python x.py --overwrite")
    results("packed", "report.json.gz", sources={module: digest} | old, seconds=2.0)
    names = "softrobot_env.gone_0, softrobot_env.gone_1, softrobot_env.gone_2, ..."
    commands = [
        "softrobot packed --overwrite && gzip -nf docs/results/packed/report.json",
        "softrobot changed --overwrite",
        "python x.py --overwrite",
    ]
    lines = [
        f"docs/results/packed: older than 4 of its sources ({names}): {commands[0]} (2 CPU s)",
        f"docs/results/changed: older than 1 of its sources ({module}): {commands[1]} (70 CPU s)",
        f"docs/results/unknown: of unknown age: {commands[2]}",
    ]
    assert said(monkeypatch, capsys, "--check") == (0, lines)
    assert said(monkeypatch, capsys, "--check", "--fresh") == (1, lines)
    assert said(monkeypatch, capsys, "--stale") == (0, commands)
    assert said(monkeypatch, capsys, "--stale", "unknown", "new") == (0, commands[2:])
    assert said(monkeypatch, capsys, "--stale", "nothing") == (1, [])


def test_other_sources():
    arm = softrobot_env.robots.ARM
    assert figures.figure("code robots.ARM", "length mm") == f"{1e3 * arm.length:g}"
    assert figures.figure("code robots.find_robot(arm)", "tendons.0.tension_limit") == "80"
    assert figures.figure("code thesis.tasks._step", "step_width mm") == "50"
    assert figures.figure("code thesis.figures.FIGURES task=swing controller=LQI", "e_max mm")
    assert figures.figure("code thesis.figures.TRIANGLE 0=hybrid 1=5.0", "value.0 mm") == "2.9"


def test_quoted_figures_have_a_source_and_are_used():
    pages = "".join(path.read_text() for path in figures.pages())
    for name, entry in figures.quoted().items():
        assert entry["source"]
        assert f"{{quoted {name}:" in pages


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
    ("source", "shown", "message"),
    [
        ("nothing", "error", "no report"),
        ("laws", "", "no field"),
        ("quoted nobody", "error", "has no 'error'"),
        ("code robots.NOBODY", "length", "has no 'length'"),
        ("ppo_defaults case=ArmStep", "error", "3 rows"),
        ("ppo_defaults case=other", "error", "no row"),
        ("ppo_defaults case=ArmStep", "speed", "no row"),
    ],
)
def test_refused(source, shown, message):
    with pytest.raises(ValueError, match=message):
        figures.figure(source, shown)
