"""64 arms, each with its own stiffness and delay, simulated at once."""

from pathlib import Path

import gymnasium
import numpy as np

import softrobot_env  # noqa: F401  (registers the environments)
from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.envs.randomization import Randomization
from softrobot_env.rendering.figures import new_figure, save

envs = gymnasium.make_vec(
    "SoftRobot/ArmSwing-v0",
    num_envs=64,
    randomization=Randomization(youngs_modulus=(0.5, 1.5), delay=(0.0, 0.02)),
    **policy_environment("ppo_randomized"),
)
policy = make_policy("ppo_randomized", envs.unwrapped.task.robot, envs.unwrapped.control_period)
observations, drawn = envs.reset(seed=0)
largest, state = np.zeros(64), None
for _ in range(500):
    actions, state = policy.predict(observations, state)
    observations, rewards, terminated, truncated, infos = envs.step(actions)
    largest = np.maximum(largest, infos["error"])
print(f"largest error: {1e3 * np.median(largest):.2f} mm in the median of the robots")

figure, axes = new_figure(1, 1, (6, 4))
shown = axes[0, 0].scatter(
    drawn["variation_youngs_modulus"], 1e3 * largest, c=1e3 * drawn["variation_delay"]
)
figure.colorbar(shown, label="delay [ms]")
axes[0, 0].set(xlabel="Young's modulus over the nominal [1]", ylabel="largest error [mm]")
axes[0, 0].set(yscale="log", title="One network on 64 robots")
picture = save(figure, Path("out/examples/randomised_batch.png"))
