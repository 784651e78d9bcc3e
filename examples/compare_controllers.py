"""Four controllers on the same path: error against the time per decision."""

from pathlib import Path

import gymnasium
import numpy as np

import softrobot_env  # noqa: F401  (registers the environments)
from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.evaluation.run import run_episode
from softrobot_env.rendering.figures import label_of, new_figure, save, style_of

figure, axes = new_figure(1, 1, (6, 4))
axis = axes[0, 0]
for name in ("feedforward_pi", "lqi", "lq_preview", "imitation"):
    env = gymnasium.make("SoftRobot/ArmSwing-v0", observe="all", **policy_environment(name))
    rollout = run_episode(env, make_policy(name, env), seed=0)
    error, cost = 1e3 * rollout.error.max(), 1e6 * np.median(rollout.policy_time)
    print(f"{name}: {error:.2f} mm, {cost:.1f} µs a decision")
    axis.plot(cost, error, linestyle="none", **style_of(name).points)
    axis.annotate(label_of(name), (cost, error), xytext=(6, 4), textcoords="offset points")
axis.set(xscale="log", yscale="log", xlabel="time of a decision [µs]")
axis.set(ylabel="largest error [mm]", title="What a smaller error costs")
axis.margins(x=0.3)
picture = save(figure, Path("out/examples/compare_controllers.png"))
