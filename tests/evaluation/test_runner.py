"""One runner from a case to record and row: it runs what one would run by hand."""

from dataclasses import replace

import numpy as np
import pytest

from softrobot_env.control.registry import make_policy
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.evaluation.runner import Case, run
from softrobot_env.robots.twin import rig3d_twin
from softrobot_env.tasks import make_task
from softrobot_env.thesis.envs import RigEnv

LSHAPE = Case(make_task("lshape"), "feedforward", duration=2.0, scene={"control_period": 0.05})


def test_a_case_of_the_arm_is_run_as_by_hand():
    case = replace(LSHAPE, variation={"youngs_modulus": 0.75})
    outcome = run(case)
    env = TrackingEnv("lshape", observe="all", control_period=0.05)
    policy = make_policy("feedforward", env.task.robot, 0.05)
    options = {"vary": {"youngs_modulus": 0.75}, "duration": 2.0}
    by_hand = run_episode(env, policy, seed=0, options=options)
    np.testing.assert_array_equal(outcome.rollout.tip, by_hand.tip)
    row = outcome.row()
    assert (row.task, row.policy, row.plant) == ("lshape", "feedforward", "mujoco")
    assert row.variation == {"youngs_modulus": 0.75} and row.failure is None
    assert row.e_max == by_hand.error.max() and outcome.decision_period == 0.05


def test_a_case_of_the_rig_is_run_on_its_twin():
    case = Case(make_task("reach", hold=0.1), "inverse_dynamics", twin=3)
    outcome = run(case)
    env = RigEnv(case.task, twin=rig3d_twin(3), observe="all")
    policy = make_policy("inverse_dynamics", env.task.robot, env.control_period)
    by_hand = run_episode(env, policy, seed=0)
    np.testing.assert_array_equal(outcome.rollout.tip, by_hand.tip)


def test_plants_and_observers_are_those_of_the_case():
    case = Case(make_task("lshape"), "lqi", plant="pcc", feedback="output", duration=0.1)
    outcome = run(case)
    assert case.environment().model is None  # no MuJoCo
    assert "curvature_rate" not in case.make_policy(0.001).requires
    assert outcome.row().plant == "pcc" and outcome.decision_period == pytest.approx(0.001)


def test_an_environment_that_is_given_stays_open():
    env = LSHAPE.environment()
    outcome = run(LSHAPE, env, make_policy("hold", env.task.robot, 0.05))
    assert np.ptp(outcome.rollout.action, axis=0).max() < 1e-6  # the policy given, not the case's
    env.reset(seed=0)
    env.step(np.zeros(env.action_space.shape, np.float32))


def test_long_episodes_tell_how_far_they_are(monkeypatch):
    monkeypatch.setattr("softrobot_env.evaluation.run._REPORT_EVERY", 0.0)
    reported, brief = [], replace(LSHAPE, duration=0.4, scene={"control_period": 0.1})
    run(brief, progress=reported.append)
    assert reported == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])


def test_labels_tell_task_rig_policy_and_variation():
    case = Case(make_task("step", 0.1), "lqi", variation={"youngs_modulus": 0.5})
    assert case.label == "step 100 mm, lqi, E x 0.5"
    reach = Case(make_task("triangle", period=1.0), "hybrid", twin=2)
    assert reach.label == "triangle 1 s, twin 2, hybrid"
