"""Learning curves over seeds: what is trained, kept, and shown."""

import pytest
from rich.console import Console

pytest.importorskip("stable_baselines3")
pytest.importorskip("daqp")

from softrobot_env.benchmarks.learning import cases as learning_cases
from softrobot_env.benchmarks.learning.cases import CASES, CHAINS, load_run, run_chain
from softrobot_env.benchmarks.learning.plots import plot
from softrobot_env.benchmarks.learning.run import Row
from softrobot_env.benchmarks.learning.tables import tables

pytestmark = pytest.mark.slow  # its quick run is one of `make slow`


def row(policy, seed, swing, settling=0.2):
    curve = [{"steps": s, "reward": seed + s / 10, "max_mm": 10.0, "failures": 0} for s in (0, 5)]
    return Row(
        policy=policy,
        seed=seed,
        minutes=3.0,
        curve=curve if policy != "imitation" else [],
        swing_max=swing,
        lshape_max=2e-3,
        overshoot=0.05,
        settling_time=settling,
        worst_modulus=4e-3,
        worst=9e-3,
        failures=0,
        trials=45,
    )


def test_what_starts_from_a_network_comes_after_it():
    trained = [name for chain in CHAINS for name in chain]
    assert sorted(trained) == sorted(["imitation", *CASES])
    for chain in CHAINS:
        for name in chain:
            warm = name in CASES and CASES[name].warm
            assert not warm or "imitation" in chain[: chain.index(name)]


def test_finished_trainings_are_not_repeated(tmp_path, monkeypatch):
    run_chain(["ppo"], 1, tmp_path, quick=True)
    _, curve, minutes = load_run("ppo", 1, tmp_path)
    assert curve[-1]["steps"] >= curve[0]["steps"] and minutes > 0
    monkeypatch.setattr(learning_cases, "_train", pytest.fail)
    run_chain(["ppo"], 1, tmp_path, quick=True)


def test_tables_show_the_spread():
    rows = [row("ppo", 0, 1e-3), row("ppo", 1, 3e-3), row("ppo", 2, 2e-3, None)]
    console = Console(record=True, width=110, file=None)
    console.print(tables(rows))
    text = console.export_text()
    assert "2 (1 to 3)" in text and "1 never" in text and "3 seeds" in text


def test_curves_are_drawn(tmp_path):
    rows = [row(name, seed, 1e-3) for name in ("imitation", "ppo", "sac") for seed in range(3)]
    plot(rows, tmp_path / "learning.png")
    assert (tmp_path / "learning.png").stat().st_size > 10_000
