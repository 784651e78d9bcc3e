"""Train, evaluate and save a policy with stable-baselines3.

    python examples/sb3_ppo.py --env SoftRobot/ArmStep-v0 --steps 200000 --out out/sb3

With `observe_as="vector"` the environment scales its observations, so that no running statistics
(`VecNormalize`) have to be saved with the model.
"""

import argparse
from pathlib import Path

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy

from softrobot_env.training.artifacts import save_vector_policy
from softrobot_env.training.vec_env import make_vec_env

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--env", default="SoftRobot/ArmStep-v0")
parser.add_argument("--steps", type=int, default=200_000)
parser.add_argument("--seed", type=int, default=0)
parser.add_argument("--out", type=Path, default=Path("out/sb3"))
args = parser.parse_args()

train_env = make_vec_env(args.env, 4, observe_as="vector")
model = PPO("MlpPolicy", train_env, seed=args.seed, device="cpu", verbose=1)
model.learn(args.steps)
args.out.mkdir(parents=True, exist_ok=True)
model.save(args.out / "model.zip")
# The same for `softrobot evaluate --policies out/sb3/sb3_ppo.npz` and `make_policy`.
save_vector_policy(args.out / "sb3_ppo.npz", model, train_env, args.seed)
train_env.close()

# From the file, in new environments: first the return, then the error.
model = PPO.load(args.out / "model.zip", device="cpu")
mean, deviation = evaluate_policy(model, make_vec_env(args.env, observe_as="vector"))
print(f"return: {mean:.1f} +- {deviation:.1f}")
env = gymnasium.make(args.env, observe_as="vector")
observation, info = env.reset(seed=1)
errors, over = [], False
while not over:
    action, _ = model.predict(observation, deterministic=True)
    observation, _, terminated, truncated, info = env.step(action)
    errors.append(info["error"])
    over = terminated or truncated
print(f"mean error: {1e3 * np.mean(errors):.3g} mm {info.get('failure', '')}")
