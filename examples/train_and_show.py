"""PPO learns a step of the tip from scratch; the policy is saved and shown. About two minutes."""

import os
from pathlib import Path

import gymnasium
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy

from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.evaluation.run import run_episode
from softrobot_env.rendering.curves import draw_tip, policy_curves
from softrobot_env.rendering.figures import new_figure, save
from softrobot_env.training.artifacts import save_vector_policy
from softrobot_env.training.vec_env import make_vec_env

TASK, STEPS = "SoftRobot/ArmStep-v0", int(os.environ.get("STEPS", 200_000))
folder = Path("out/examples")
folder.mkdir(parents=True, exist_ok=True)

# `observe_as="vector"` scales what the network sees: nothing else has to be normalised.
train_env = make_vec_env(TASK, 4, observe_as="vector")
model = PPO("MlpPolicy", train_env, n_steps=min(2048, STEPS), seed=0, device="cpu", verbose=1)
model.learn(STEPS)
mean, deviation = evaluate_policy(model, make_vec_env(TASK, observe_as="vector"))
print(f"return: {mean:.0f} +- {deviation:.0f}")

# A file that all commands and `make_policy` can load.
policy_file = str(folder / "ppo_step.npz")
save_vector_policy(policy_file, model, train_env)
env = gymnasium.make(TASK, **policy_environment(policy_file) | {"observe": "all"})
rollout = run_episode(env, make_policy(policy_file, env), seed=0)
print(f"mean error: {1e3 * rollout.error.mean():.2f} mm")
figure, axes = new_figure(3, 1, (7, 6))
draw_tip(axes[:, 0], policy_curves({"ppo": rollout}))
picture = save(figure, folder / "train_and_show.png")
