"""The real rig's interface without hardware: the firmware runs on a simulated robot.

It runs in real time behind a serial port, and needs a C++ compiler and Linux or macOS.
"""

from pathlib import Path

from softrobot_env.commands.robot.virtual import virtual_process
from softrobot_env.control.registry import make_policy
from softrobot_env.envs.real import RealRigEnv
from softrobot_env.evaluation.run import run_episode
from softrobot_env.rendering.curves import draw_tip, policy_curves
from softrobot_env.rendering.figures import new_figure, save
from softrobot_env.tasks.registry import make_task

task = make_task("triangle", period=5.0)
with virtual_process(0) as virtual:  # for a real rig: RealRigEnv(task, robot_file="rig.toml")
    env = RealRigEnv(task, robot_file=virtual.file, tip=virtual.tip, observe="all")
    rollout = run_episode(env, make_policy("hybrid", env), seed=0)
    env.close()
print(f"mean error {1e3 * rollout.error.mean():.2f} mm, {rollout.failure or 'no failure'}")

figure, axes = new_figure(3, 1, (7, 6))
draw_tip(axes[:, 0], policy_curves({"hybrid": rollout}), plane="xy")
picture = save(figure, Path("out/examples/virtual_rig.png"))
