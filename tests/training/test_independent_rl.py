"""A learner written against Gymnasium alone, in the manner of CleanRL's continuous PPO.

Nothing in it knows this package: environments are made by id and wrapped by Gymnasium's wrappers.
"""

import gymnasium
import numpy as np
import pytest

torch = pytest.importorskip("torch")

import softrobot_env  # noqa: E402, F401  (registers the ids)

STEPS, GAMMA, LAMBDA, CLIP = 32, 0.99, 0.95, 0.2


def wrapped(env):
    """The usual wrappers of a vector environment."""
    wrappers = gymnasium.wrappers.vector
    env = wrappers.RecordEpisodeStatistics(wrappers.FlattenObservation(env))
    env = wrappers.ClipAction(env)
    return wrappers.NormalizeReward(wrappers.NormalizeObservation(env), gamma=GAMMA)


class Agent(torch.nn.Module):
    def __init__(self, env):
        super().__init__()
        inputs = int(np.prod(env.single_observation_space.shape))
        outputs = int(np.prod(env.single_action_space.shape))
        hidden = torch.nn.Linear(inputs, 64), torch.nn.Tanh(), torch.nn.Linear(64, 64)
        self.mean = torch.nn.Sequential(*hidden, torch.nn.Tanh(), torch.nn.Linear(64, outputs))
        self.value = torch.nn.Sequential(
            torch.nn.Linear(inputs, 64), torch.nn.Tanh(), torch.nn.Linear(64, 1)
        )
        self.log_deviation = torch.nn.Parameter(torch.full((outputs,), -1.0))

    def distribution(self, observation):
        return torch.distributions.Normal(self.mean(observation), self.log_deviation.exp())


def collect(env, agent, observation):
    """Observations, actions, log probabilities, returns and advantages of a rollout."""
    rows, values, rewards, ends = [], [], [], []
    for _ in range(STEPS):
        seen = torch.as_tensor(observation, dtype=torch.float32)
        with torch.no_grad():
            distribution = agent.distribution(seen)
            action = distribution.sample()
            values.append(agent.value(seen)[:, 0])
        rows.append((seen, action, distribution.log_prob(action).sum(1)))
        observation, reward, terminated, truncated, _ = env.step(action.numpy())
        rewards.append(torch.as_tensor(reward, dtype=torch.float32))
        ends.append(torch.as_tensor(terminated | truncated, dtype=torch.float32))
    with torch.no_grad():
        following = agent.value(torch.as_tensor(observation, dtype=torch.float32))[:, 0]
    advantage, advantages = torch.zeros_like(following), []
    for k in reversed(range(STEPS)):
        on = 1 - ends[k]
        delta = rewards[k] + GAMMA * following * on - values[k]
        advantage = delta + GAMMA * LAMBDA * on * advantage
        advantages.insert(0, advantage)
        following = values[k]
    seen, action, before = (torch.cat(x) for x in zip(*rows, strict=True))
    advantages = torch.cat(advantages)
    return observation, seen, action, before, advantages + torch.cat(values), advantages


def train(env, iterations):
    """Losses of PPO."""
    torch.manual_seed(0)
    agent = Agent(env)
    optimizer = torch.optim.Adam(agent.parameters(), lr=3e-4, eps=1e-5)
    observation, _ = env.reset(seed=0)
    losses = []
    for _ in range(iterations):
        observation, seen, action, before, returns, advantage = collect(env, agent, observation)
        advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        for _ in range(4):
            log = agent.distribution(seen).log_prob(action).sum(1)
            ratio = (log - before).exp()
            gain = torch.min(ratio * advantage, ratio.clamp(1 - CLIP, 1 + CLIP) * advantage)
            loss = -gain.mean() + 0.5 * (agent.value(seen)[:, 0] - returns).square().mean()
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
            optimizer.step()
        losses.append(loss.item())
    return losses


@pytest.mark.parametrize(
    "mode", ["vector_entry_point", pytest.param("sync", marks=pytest.mark.slow)]
)
def test_it_trains_on_the_batched_and_on_single_environments(mode):
    env = gymnasium.make_vec("SoftRobot/ArmStep-v0", num_envs=4, vectorization_mode=mode)
    losses = train(wrapped(env), 6)
    env.close()
    assert np.all(np.isfinite(losses)) and losses[-1] < losses[0]


def test_both_give_the_same_training():
    """Batched and single environments are the same, so the learner cannot tell them apart."""
    runs = []
    for mode in ("vector_entry_point", "sync"):
        env = gymnasium.make_vec("SoftRobot/ArmStep-v0", num_envs=2, vectorization_mode=mode)
        runs.append(train(wrapped(env), 3))
        env.close()
    np.testing.assert_allclose(runs[0], runs[1], rtol=1e-4)
