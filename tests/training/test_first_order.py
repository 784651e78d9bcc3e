"""First-order policy learning: its derivatives are those of episodes, and it learns."""

from dataclasses import replace

import numpy as np
import pytest
from support.commands import called

torch = pytest.importorskip("torch")

from softrobot_env.control.learned.neural import NeuralPolicy  # noqa: E402
from softrobot_env.envs.randomization import Randomization  # noqa: E402
from softrobot_env.envs.rewards import LogReward, RewardTerm  # noqa: E402
from softrobot_env.envs.tracking import TrackingEnv  # noqa: E402
from softrobot_env.evaluation.run import play  # noqa: E402
from softrobot_env.robots import ARM  # noqa: E402
from softrobot_env.tasks import make_task  # noqa: E402
from softrobot_env.training import first_order  # noqa: E402
from softrobot_env.training.first_order import (  # noqa: E402
    Course,
    FirstOrderConfig,
    Learner,
    train,
)

# Untrained policies drive a robot at random.
pytestmark = pytest.mark.filterwarnings("ignore::softrobot_env.scene.timestep.TimestepWarning")

#: Steps as long as asked for whatever their errors, so that those of two episodes are alike.
ALIKE = {"accuracy": 1e4, "timestep": 2e-3}

SHORT = replace(make_task("step", 0.05), duration=0.5)
TINY = FirstOrderConfig(steps=640, segments=1, hidden=(16,), horizon=16, kept=4, updates=2)


def episode(env, learner, discount):
    """Discounted rewards of an episode of the environment."""
    seen, _ = env.reset()
    total, weight, over = 0.0, 1.0, False
    while not over:
        with torch.no_grad():
            output = learner.policy(torch.tensor(seen, dtype=torch.float64)).numpy()
        seen, reward, _, over, _ = env.step(np.clip(output, -1, 1))
        total, weight = total + weight * reward, weight * discount
    return total


def put(learner, weights):
    torch.nn.utils.vector_to_parameters(weights, learner.policy.parameters())


@pytest.mark.parametrize("reward", ["log", "tracking"])
def test_derivatives_are_those_of_episodes(reward):
    """By the weights of a policy, of the rewards that its environment gives."""
    course = Course(replace(SHORT, duration=0.16), reward=reward, **ALIKE)
    learner = Learner([course], replace(TINY, deviation=0.0), 0)
    for parameter in learner.critic.parameters():
        torch.nn.init.zeros_(parameter)
    weights = torch.nn.utils.parameters_to_vector(learner.policy.parameters()).detach()
    weights += 0.1 * torch.randn_like(weights)
    put(learner, weights)
    batch = learner.record()
    total = learner.total(batch, learner.move(batch))
    total.backward()
    slope = torch.cat([p.grad.ravel() for p in learner.policy.parameters()])
    discount = TINY.discount
    assert total.item() == pytest.approx(
        (1 - discount) * episode(course.env, learner, discount), rel=1e-5
    )
    for _ in range(3):
        way, ends, step = torch.randn_like(weights), [], 1e-4
        for sign in (1, -1):
            put(learner, weights + sign * step * way)
            ends.append((1 - discount) * episode(course.env, learner, discount))
        found, wanted = float(slope @ way), (ends[0] - ends[1]) / (2 * step)
        assert found == pytest.approx(wanted, rel=1e-4, abs=1e-4 * float(slope.norm()))


def test_a_short_training_lessens_the_error():
    course, errors = Course(SHORT), []
    env = TrackingEnv(SHORT, observe="all")

    def watch(steps, network):
        policy = NeuralPolicy(ARM, env.control_period, network, view=course.env.reading)
        errors.append(np.mean([at.info["error"] for at in play(env, policy, 0)]))

    train([course], TINY, 0, watch=watch)
    assert errors[-1] < 0.7 * errors[0]


def test_a_training_depends_on_its_seed_alone():
    one, other = (train([Course(SHORT)], replace(TINY, steps=48), 1) for _ in range(2))
    np.testing.assert_array_equal(one.parameters, other.parameters)


@pytest.mark.parametrize(
    ("task", "options", "named"),
    [
        ("step", {"observe": ("reference", "tendon_tension")}, "tendon_tension"),
        ("step", {"randomization": Randomization(density=(0.9, 1.1))}, "randomization"),
        ("step", {"reward": LogReward(more=(RewardTerm("own", lambda o: 0.0),))}, "reward_own"),
        ("circle", {"robot": "rig"}, "servos"),
    ],
)
def test_what_has_no_derivatives_is_refused_by_name(task, options, named):
    with pytest.raises(ValueError, match=named):
        Course(task, **options)


def test_the_command_writes_a_policy(tmp_path, monkeypatch):
    monkeypatch.setattr(first_order, "figures", lambda *args, **kwargs: [])  # takes longer
    assert called("train shac --quick --task step --out", tmp_path) == 0
    policy = NeuralPolicy(ARM, 0.01, tmp_path / "shac.npz")
    assert len([*play(TrackingEnv(SHORT, observe=policy.requires), policy, 0)]) == 51
    assert called("train shac --quick --set robots=3 --out", tmp_path, "--overwrite") != 0
