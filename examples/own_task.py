"""Your own path and reward, for any robot."""

from pathlib import Path

import gymnasium

from softrobot_env import register_task
from softrobot_env.control.registry import make_policy
from softrobot_env.evaluation.run import run_episode
from softrobot_env.rendering.curves import draw_path, policy_curves
from softrobot_env.rendering.figures import new_figure, save
from softrobot_env.tasks.generic import laps, site_of
from softrobot_env.tasks.smooth_paths import figure_eight


def flat_eight(robot, size=0.4, speed=None):
    """An eight, half as high as wide; `size` is a share of the tip's reach in all directions."""
    ground = site_of(robot).ground
    along, across = size * ground.radius * ground.axes
    path = figure_eight(tuple(ground.middle), tuple(along), tuple(across / 2))
    return laps("flat_eight", robot, path, speed, size=size)


class Thrifty(gymnasium.Wrapper):
    """The task's reward minus a cost of pulling."""

    def step(self, action):
        observation, reward, terminated, truncated, info = self.env.step(action)
        cost = 0.1 * float((action**2).mean())
        return observation, reward - cost, terminated, truncated, info | {"reward_cost": -cost}


register_task("flat_eight", flat_eight)
env = gymnasium.make("SoftRobot/Track-v0", robot="planar_finger", task="flat_eight", observe="all")
env = Thrifty(env)
rollout = run_episode(env, make_policy("static", env.unwrapped), seed=0)
print(f"mean error {1e3 * rollout.error.mean():.2f} mm, return {rollout.reward.sum():.0f}")

figure, axes = new_figure(1, 1, (5, 4))
draw_path(axes[0, 0], policy_curves({"static": rollout}), rollout.reference)
axes[0, 0].set_title("The finger on a path of one's own")
picture = save(figure, Path("out/examples/own_task.png"))
