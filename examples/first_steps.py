"""A controller drives the arm along a path; plots of tip and error, and a moving picture."""

from pathlib import Path

import gymnasium

import softrobot_env  # noqa: F401  (registers the environments)
from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.evaluation.run import run_episode
from softrobot_env.rendering.curves import draw_tip, policy_curves
from softrobot_env.rendering.figures import new_figure, save
from softrobot_env.rendering.video import record, write_video

# A policy declares the environment it needs: its control period and how far it looks ahead.
needs = policy_environment("lq_adaptive") | {"observe": "all", "render_mode": "rgb_array"}
env = gymnasium.make("SoftRobot/ArmLShape-v0", **needs)
policy = make_policy("lq_adaptive", env)

rollout = run_episode(env, policy, seed=0)
print(f"largest error: {1e3 * rollout.error.max():.2f} mm")

# Over time: both coordinates of the tip, and its distance from the target.
figure, axes = new_figure(3, 1, (7, 6))
draw_tip(axes[:, 0], policy_curves({"lq_adaptive": rollout}))
picture = save(figure, Path("out/examples/first_steps.png"))

# The same as a moving picture, which needs OpenGL.
write_video("out/examples/first_steps.gif", record(env, policy, fps=5), fps=5)
