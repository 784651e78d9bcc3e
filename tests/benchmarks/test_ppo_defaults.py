"""PPO as stable-baselines3 comes: what is compared, and how it is shown."""

from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from rich.console import Console

pytest.importorskip("stable_baselines3")

from softrobot_env.benchmarks.ppo_defaults.cases import CASES, Case, goal_of, mean_error
from softrobot_env.benchmarks.ppo_defaults.plots import plot
from softrobot_env.benchmarks.ppo_defaults.run import Row
from softrobot_env.benchmarks.ppo_defaults.tables import tables


def row(case, seed, error, goal=1e-3, policy=None):
    curve = [(0, 0.1), (8192, None), (204_800, error)]
    return Row(case, seed, 204_800, error, goal, policy, 1.5, curve)


def test_the_error_is_the_mean_of_all_instants_and_a_failure_is_infinite():
    env = gymnasium.make("SoftRobot/ArmStep-v0", observe_as="vector")
    still = SimpleNamespace(predict=lambda seen, state, deterministic: (np.zeros(3), state))
    env.reset()
    errors = [env.step(np.zeros(3))[4]["error"] for _ in range(500)]
    assert mean_error(env, still, 1) == pytest.approx(np.mean(errors))
    full = SimpleNamespace(predict=lambda seen, state, deterministic: (_pump(env, seen), state))
    assert mean_error(env, full, 1) == np.inf


def _pump(env, seen):
    """The most change the way it bends."""
    rates = env.unwrapped.vector_layout["curvature_rate"]
    return np.full(3, 1.0 if seen[rates].sum() >= 0 else -1.0)


def test_goals_are_numbers_or_errors_of_policies():
    assert goal_of(CASES["ArmStep"]) == 1e-3
    still = goal_of(Case("SoftRobot/ArmStep-v0", "hold"))
    assert still == pytest.approx(0.05, rel=0.01)  # it stays where it is, 50 mm away


def test_tables_and_pictures_say_what_was_met(tmp_path):
    rows = [row("ArmStep", 0, 0.8e-3), row("ArmStep", 1, 2e-3)]
    rows += [row("RigReach", 0, None, 0.02, "rig_nn")]
    assert [one.good for one in rows] == [True, False, False]
    console = Console(record=True, width=110, file=None)
    console.print(tables(rows))
    text = console.export_text()
    assert "0.8" in text and "rig_nn" in text and text.count("NO") == 2
    plot(rows, tmp_path / "ppo_defaults.png")
    assert (tmp_path / "ppo_defaults.png").stat().st_size > 10_000
