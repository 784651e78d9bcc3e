"""Train and save a policy with RLlib (`pip install "ray[rllib]" torch`).

python examples/rllib_ppo.py --env SoftRobot/ArmStep-v0 --rollouts 25 --out out/rllib
"""

import argparse
from pathlib import Path

import gymnasium
from ray.rllib.algorithms.ppo import PPOConfig
from ray.tune.registry import register_env


def make(config: dict) -> gymnasium.Env:
    """An environment; RLlib's processes call this."""
    import softrobot_env  # noqa: F401  (registers the ids)

    return gymnasium.make(**config)


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--env", default="SoftRobot/ArmStep-v0")
parser.add_argument("--rollouts", type=int, default=25)
parser.add_argument("--rollout", type=int, default=8192, help="steps of all environments")
parser.add_argument("--runners", type=int, default=0, help="processes that collect; 0: this one")
parser.add_argument("--out", type=Path, default=Path("out/rllib"))
args = parser.parse_args()

register_env("soft_robot", make)
config = (
    PPOConfig()
    .environment("soft_robot", env_config={"id": args.env, "observe_as": "vector"})
    .env_runners(num_env_runners=args.runners, num_envs_per_env_runner=4)
    .training(
        train_batch_size_per_learner=args.rollout,
        minibatch_size=64,
        num_epochs=10,
        lr=3e-4,
        grad_clip=0.5,
        lambda_=0.95,
        clip_param=0.2,
        use_kl_loss=False,
        vf_loss_coeff=0.5,
    )
)
algorithm = config.build_algo()
for k in range(args.rollouts):
    found = algorithm.train()["env_runners"]
    print(k, "return", found.get("episode_return_mean"))
print("saved to", algorithm.save_to_path(args.out.resolve()))
algorithm.stop()
