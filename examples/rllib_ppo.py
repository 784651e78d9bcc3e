"""Train a policy with RLlib on a Ray cluster, and save it (`pip install "ray[rllib]" torch`).

python examples/rllib_ppo.py --env SoftRobot/ArmStep-v0 --rollouts 25 --out out/rllib.npz
"""

import argparse
from pathlib import Path

import gymnasium
import ray
import torch
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
from ray.tune.registry import register_env


def make(config: dict) -> gymnasium.Env | gymnasium.vector.VectorEnv:
    """One environment, or a batch of them in one simulation; RLlib's processes call this."""
    return (gymnasium.make_vec if "num_envs" in config else gymnasium.make)(**config)


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--env", default="SoftRobot/ArmStep-v0")
parser.add_argument("--rollouts", type=int, default=25)
parser.add_argument("--rollout", type=int, default=8192, help="steps of all environments")
parser.add_argument("--runners", type=int, default=0, help="processes that collect; 0: this one")
parser.add_argument("--robots", type=int, default=16, help="in the batch of each")
parser.add_argument("--address", help="of a Ray cluster; default: one on this machine")
parser.add_argument("--out", type=Path, default=Path("out/rllib.npz"))
args = parser.parse_args()

ray.init(address=args.address, log_to_driver=False)
register_env("soft_robot", make)
shown = {"id": f"softrobot_env:{args.env}", "observe_as": "vector"}  # the prefix registers the ids
layers = {"fcnet_hiddens": [64, 64], "fcnet_activation": "tanh"}
layers |= {"free_log_std": True, "vf_share_layers": False}
config = (
    PPOConfig()
    .environment("soft_robot", env_config=shown)
    .env_runners(
        num_env_runners=args.runners,
        num_envs_per_env_runner=args.robots,
        gym_env_vectorize_mode="vector_entry_point",
    )
    .training(train_batch_size_per_learner=args.rollout, minibatch_size=64, num_epochs=10, lr=3e-4)
    .training(grad_clip=0.5, lambda_=0.95, clip_param=0.2, use_kl_loss=False, vf_loss_coeff=0.5)
    .rl_module(model_config=DefaultModelConfig(**layers))
)
algorithm = config.build_algo()
for k in range(args.rollouts):
    found = algorithm.train()["env_runners"]
    print(k, "return", found.get("episode_return_mean"))

from softrobot_env.training.artifacts import save_vector_policy  # noqa: E402

module = algorithm.get_module()
acting = torch.nn.Sequential(module.encoder.actor_encoder.net.mlp, module.pi.net.mlp)
save_vector_policy(args.out, acting, gymnasium.make(**shown))
print(f"saved to {args.out}: softrobot evaluate --policies {args.out} runs it")
algorithm.stop()
