"""PPO in one file, in the style of CleanRL: many robots at once, with PyTorch only.

    python examples/cleanrl_ppo.py --env SoftRobot/ArmStep-v0 --steps 200000 --out out/ppo.pt

It is meant to be read and changed. The environment's observation vector is already of order 1, so
that no running means are needed: the saved weights are the whole policy.
"""

import argparse
from pathlib import Path

import gymnasium
import numpy as np
import torch
from numpy import ndarray
from torch import nn

from softrobot_env.training.artifacts import save_vector_policy

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--env", default="SoftRobot/ArmStep-v0")
parser.add_argument("--steps", type=int, default=200_000)
parser.add_argument("--envs", type=int, default=4)
parser.add_argument("--rollout", type=int, default=2048, help="steps of each environment")
parser.add_argument("--batch", type=int, default=64)
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--out", type=Path, default=Path("out/ppo.pt"))
args = parser.parse_args()
GAMMA, LAMBDA, CLIP, EPOCHS, RATE, NORM = 0.99, 0.95, 0.2, 10, 3e-4, 0.5

torch.manual_seed(args.seed)
torch.set_num_threads(1)
rng = np.random.default_rng(args.seed)
options = {"observe_as": "vector", "autoreset_mode": "SameStep"}
envs = gymnasium.make_vec(args.env, args.envs, "vector_entry_point", **options)
n_seen, n_inputs = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]


def network(outputs: int, gain: float) -> nn.Sequential:
    """Two hidden layers; small last weights, so that a policy starts near zero."""
    layers = [
        nn.Linear(n_seen, 64),
        nn.Tanh(),
        nn.Linear(64, 64),
        nn.Tanh(),
        nn.Linear(64, outputs),
    ]
    for layer, size in zip(layers[::2], (2**0.5, 2**0.5, gain), strict=True):
        nn.init.orthogonal_(layer.weight, size)
        nn.init.zeros_(layer.bias)
    return nn.Sequential(*layers)


actor, critic = network(n_inputs, 0.01), network(1, 1.0)
log_std = nn.Parameter(torch.zeros(n_inputs))
parameters = [*actor.parameters(), log_std, *critic.parameters()]
optimizer = torch.optim.Adam(parameters, lr=RATE, eps=1e-5)


def chosen(seen: torch.Tensor) -> torch.distributions.Normal:
    """Distribution of the actions."""
    return torch.distributions.Normal(actor(seen), log_std.exp())


def value(seen: ndarray) -> ndarray:
    """The critic's value."""
    with torch.no_grad():
        return critic(torch.as_tensor(seen)).squeeze(-1).numpy()


size = (args.rollout, args.envs)
seen, _ = envs.reset(seed=args.seed)
for update in range(max(1, round(args.steps / (args.rollout * args.envs)))):
    observations = np.zeros((*size, n_seen), np.float32)
    actions = np.zeros((*size, n_inputs), np.float32)
    rewards, ended, values, log_probs, errors = np.zeros((5, *size), np.float32)
    for t in range(args.rollout):
        with torch.no_grad():
            distribution = chosen(torch.as_tensor(seen))
            action = distribution.sample()
            log_probs[t] = distribution.log_prob(action).sum(-1).numpy()
        observations[t], actions[t], values[t] = seen, action.numpy(), value(seen)
        seen, reward, terminated, truncated, info = envs.step(np.clip(actions[t], -1, 1))
        rewards[t], ended[t] = reward, terminated | truncated
        errors[t] = info.get("final_info", info)["error"]
        if truncated.any():  # the time limit ended the episode, not the motion
            rewards[t] += GAMMA * truncated * value(info["final_obs"])

    advantages, last, ahead = np.zeros(size, np.float32), np.zeros(args.envs), value(seen)
    for t in reversed(range(args.rollout)):
        gain = rewards[t] + GAMMA * ahead * (1 - ended[t]) - values[t]
        advantages[t] = last = gain + GAMMA * LAMBDA * last * (1 - ended[t])
        ahead = values[t]

    kept = (observations, actions, log_probs, advantages, advantages + values)
    data = [torch.as_tensor(x.reshape(-1, *x.shape[2:])) for x in kept]
    for _ in range(EPOCHS):
        for batch in np.array_split(rng.permutation(len(data[0])), len(data[0]) // args.batch):
            o, a, before, gain, wanted = (x[batch] for x in data)
            gain = (gain - gain.mean()) / (gain.std() + 1e-8)
            ratio = (chosen(o).log_prob(a).sum(-1) - before).exp()
            better = torch.min(ratio * gain, ratio.clamp(1 - CLIP, 1 + CLIP) * gain).mean()
            loss = 0.5 * (critic(o).squeeze(-1) - wanted).square().mean() - better
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(parameters, NORM)
            optimizer.step()
    print(
        f"{(update + 1) * np.prod(size)} steps: error {1e3 * errors.mean():.3g} mm while exploring"
    )
envs.close()
args.out.parent.mkdir(parents=True, exist_ok=True)
torch.save(actor.state_dict(), args.out)

env = gymnasium.make(args.env, observe_as="vector")
# For `softrobot evaluate --policies FILE.npz` and `make_policy`.
save_vector_policy(args.out.with_name(f"{args.out.stem}_network.npz"), actor, env, args.seed)
seen, _ = env.reset(seed=args.seed + 1)
errors, over = [], False
while not over:
    with torch.no_grad():
        action = actor(torch.as_tensor(seen)).clamp(-1, 1).numpy()
    seen, _, terminated, truncated, info = env.step(action)
    errors.append(info["error"])
    over = terminated or truncated
print(f"mean error: {1e3 * np.mean(errors):.3g} mm {info.get('failure', '')}")
