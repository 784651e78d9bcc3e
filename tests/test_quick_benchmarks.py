"""Every benchmark from the command line to its pictures: quick runs, nothing faked."""

import json

import pytest

from softrobot_env.cli import main
from softrobot_env.core.studies import BENCHMARKS

pytest.importorskip("matplotlib")

#: Extra package that a benchmark cannot do without.
NEEDS = dict.fromkeys(("learning", "ppo_defaults"), "stable_baselines3")


@pytest.mark.slow
@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_quick_benchmark_measures_writes_and_draws(name, tmp_path, monkeypatch, capsys):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name])
    monkeypatch.chdir(tmp_path)  # some keep finished trainings below the working directory
    assert main(["benchmark", name, "--quick", "--out", str(tmp_path / "out")]) == 0
    out = tmp_path / "out" / name
    rows = json.loads((out / "report.json").read_text())["rows"]
    assert rows and all(isinstance(row, dict) for row in rows)
    text = (out / "report.md").read_text()
    assert text.startswith(f"# Benchmark: {name}") and len(text.splitlines()) > 10
    assert "\u2026" not in text  # nothing is cut short
    drawn = BENCHMARKS[name]().draw is not None
    pictures = list(out.glob("*.png"))
    assert bool(pictures) == drawn and all(path.stat().st_size > 1000 for path in pictures)
    assert f"to {out}" in capsys.readouterr().out.replace("\n", "")
    if drawn:
        before = {path: path.read_bytes() for path in pictures}
        assert main(["benchmark", name, "--redraw", "--out", str(tmp_path / "out")]) == 0
        assert {path: path.read_bytes() for path in out.glob("*.png")} == before
