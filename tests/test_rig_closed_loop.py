"""The thesis' hybrid on a twin of the rig: the slow triangle of Tab. 5.2."""

import pytest

from softrobot_env.control.registry import make_policy
from softrobot_env.envs.rig import RigEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.robots import RIG


def errors(policy):
    """Error [m] on the laps of 5 s, after the approach."""
    env = RigEnv("triangle", period=5.0, twin=0, observe="all")
    rollout = run_episode(env, make_policy(policy, RIG, env.control_period), seed=0)
    assert rollout.failure is None
    return rollout.error[rollout.time > env.task.trajectory.approach]


@pytest.fixture(scope="module")
def parts():
    """Mean errors [m] of the network alone and of the model alone."""
    return [errors(policy).mean() for policy in ("rig_nn", "inverse_dynamics")]


@pytest.mark.parametrize("policy", ["hybrid", "hybrid_flexible"])
def test_the_hybrid_is_better_than_its_parts(parts, policy):
    """The thesis has 2.9 mm in the mean and 8.9 mm at most, 4.5 and 19.7 mm for the parts.

    Half of the dynamic part would leave 3 mm or more, another sign or a turn of the network by 0.12
    rad 8 mm or more.
    """
    network, model = parts
    error = errors(policy)
    assert error.mean() < 3.5e-3 and error.max() < 8.9e-3
    assert error.mean() < 0.55 * network and error.mean() < 0.2 * model
