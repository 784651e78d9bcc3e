"""What is previewed is what comes: references at their times, of a motion that is known."""

from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest

import softrobot_env  # noqa: F401  (registers the environments)
from softrobot_env.control.reduced import policy as reduced
from softrobot_env.control.reduced.environment import SAMPLES
from softrobot_env.control.registry import make_policy
from softrobot_env.control.scheduled.aiming import references_of
from softrobot_env.robots import RIG

HERE, SPEED = np.array([0.02, -0.01, 0.15]), np.array([0.03, 0.02, -0.01])


def test_scheduled_laws_see_each_preview_at_its_time():
    times = np.array([0.0, 0.01, 0.02, 0.04, 0.07])
    law = SimpleNamespace(
        times=times, planar=False, reach=0.3, first=0.5, period=0.01, force=0.0, offset=0.0
    )
    coming = HERE + times[:, None] * SPEED
    smoothing = np.concatenate([np.zeros(11), HERE])  # announced where it is: no jump
    found, velocity = references_of.py_func(law, HERE, coming[1:].ravel(), smoothing)
    np.testing.assert_allclose(found, coming, atol=1e-15)
    np.testing.assert_allclose(velocity, SPEED, rtol=1e-12)


def test_plans_on_learned_models_see_the_reference_when_their_actions_have_come(monkeypatch):
    """An action that is decided now acts on the sample after the model's lag."""
    seen = {}

    def noted(*arguments):
        seen["reference"] = arguments[7]
        return own(*arguments)

    own = reduced.program
    monkeypatch.setattr(reduced, "program", noted)
    policy = make_policy("ssm_lq", RIG, 0.01)
    coming = HERE[:2] + np.outer([0.0, *policy.preview], SPEED[:2])
    observation = {
        "tip_position": HERE[:2],
        "reference": coming[0],
        "reference_preview": coming[1:].ravel(),
        "previous_action": np.zeros(policy.sizes["previous_action"]),
    }
    policy.predict(observation, None)
    model = policy._model
    at = (model.lag + 1 + np.arange(SAMPLES)) * model.period
    np.testing.assert_allclose(seen["reference"], HERE[:2] + np.outer(at, SPEED[:2]), atol=1e-12)


def test_many_robots_see_their_own_references(request):
    period, ahead = 0.02, np.array([0.0, 0.033, 0.1])
    envs = gymnasium.make_vec(
        "SoftRobot/ArmSwing-v0",
        num_envs=2,
        vectorization_mode="vector_entry_point",
        observe="all",
        control_period=period,
        preview=tuple(ahead),
    )
    request.addfinalizer(envs.close)
    observation, info = envs.reset(seed=0)
    trajectory = envs.unwrapped.task.trajectory
    for _ in range(4):
        for k, time in enumerate(np.asarray(info["time"])):
            expected = trajectory.position(time + ahead)[:, [0, 2]].ravel()
            assert observation["reference_preview"][k] == pytest.approx(expected, abs=1e-12)
        observation, *_, info = envs.step(np.zeros(envs.action_space.shape, np.float32))
    assert np.ptp(observation["reference_preview"]) > 1e-3
