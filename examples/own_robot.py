"""A robot from a file: the reach of its tip, and a controller on a path in its workspace."""

from pathlib import Path

import gymnasium

import softrobot_env  # noqa: F401  (registers the environments)
from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.evaluation.run import run_episode
from softrobot_env.rendering.curves import draw_tip, policy_curves
from softrobot_env.rendering.figures import new_figure, save
from softrobot_env.rendering.workspace import draw_workspace
from softrobot_env.robots import find_robot

ROBOT = """
name = "my_trunk"
gravity_m_s2 = [0, 0, -9.81]
base = { position_m = [0, 0, 0.6], direction = [0, 0, -1] }

[[section]]
length_m = 0.20
outer_radius_m = [0.030, 0.022]
youngs_modulus_Pa = 4.0e5
poisson_ratio = 0.45
density_kg_m3 = 1070
damping_time_s = 0.03

[[tendon]]
name = ["a1", "a2", "a3"]
ends_at_section = 1
radius_m = 0.02
tension_limit_N = 40
"""
folder = Path("out/examples")
folder.mkdir(parents=True, exist_ok=True)
(folder / "my_trunk.toml").write_text(ROBOT)
robot = find_robot(str(folder / "my_trunk.toml"))
draw_workspace(robot, folder)

# Without any training: inverse statics of the robot's own chain.
needs = policy_environment("static", robot) | {"observe": "all"}
env = gymnasium.make("SoftRobot/Track-v0", robot=robot, task="circle", **needs)
rollout = run_episode(env, make_policy("static", env), seed=0)
print(f"mean error: {1e3 * rollout.error.mean():.2f} mm")
figure, axes = new_figure(4, 1, (7, 8))
draw_tip(axes[:, 0], policy_curves({"static": rollout}), plane="xyz")
picture = save(figure, folder / "own_robot.png")
