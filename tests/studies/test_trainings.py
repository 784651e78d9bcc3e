"""What trainings are compared with, and in which order they are made."""

from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from studies.trainings import CASES, CHAINS, GOALS, Goal, goal_of, mean_error


def test_what_starts_from_a_network_comes_after_it():
    assert sorted(name for chain in CHAINS for name in chain) == sorted(["imitation", *CASES])
    for chain in CHAINS:
        for name in chain:
            warm = name in CASES and CASES[name][1]
            assert not warm or "imitation" in chain[: chain.index(name)]


def test_the_error_is_the_mean_of_all_instants_and_a_failure_is_infinite():
    env = gymnasium.make("SoftRobot/ArmStep-v0", observe_as="vector")
    still = SimpleNamespace(predict=lambda seen, state, *_: (np.zeros(3), state))
    env.reset()
    errors = [env.step(np.zeros(3))[4]["error"] for _ in range(500)]
    assert mean_error(env, still, 1) == pytest.approx(np.mean(errors))
    rates = env.unwrapped.vector_layout["curvature_rate"]

    def pump(seen, state, *_):  # the most change the way it bends
        return np.full(3, 1.0 if seen[rates].sum() >= 0 else -1.0), state

    assert mean_error(env, SimpleNamespace(predict=pump), 1) == np.inf


def test_goals_are_numbers_or_errors_of_policies():
    assert goal_of(GOALS["ArmStep"]) == 1e-3
    still = goal_of(Goal("SoftRobot/ArmStep-v0", "hold"))
    assert still == pytest.approx(0.05, rel=0.01)  # it stays where it is, 50 mm away
