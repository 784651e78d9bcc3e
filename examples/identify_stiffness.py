"""How stiff is a robot? Its commands are replayed with models until the tip fits the recording."""

from dataclasses import replace
from pathlib import Path

import gymnasium
from scipy.optimize import minimize_scalar

import softrobot_env  # noqa: F401  (registers the environments)
from softrobot_env.control.registry import make_policy
from softrobot_env.envs.recording import RecordEpisodes
from softrobot_env.evaluation.run import run_episode
from softrobot_env.identification.replay import error_rows, replay
from softrobot_env.rendering.figures import new_figure, save
from softrobot_env.robots import find_robot

# A robot that is 20 % softer than its file says is recorded on a path.
robot = find_robot("planar_finger")
env = gymnasium.make("SoftRobot/Track-v0", robot=robot, task="circle", observe="all")
recorder = RecordEpisodes(env)
softer = {"vary": {"youngs_modulus": 0.8}}
run_episode(recorder, make_policy("static", env), seed=0, options=softer)
recording = recorder.recording


def error(factor):
    """RMS distance [m] of the tips of a model whose modulus is `factor` times the file's."""
    sections = [
        replace(section, youngs_modulus=factor * section.youngs_modulus)
        for section in robot.sections
    ]
    return error_rows(replay(recording, robot.with_sections(*sections)))[0].rms


tried = [0.6, 0.7, 0.75, 0.85, 0.9, 1.0]
found = minimize_scalar(error, bounds=(0.5, 1.2), method="bounded", options={"xatol": 1e-3}).x
print(f"modulus: {found:.3f} times the file's")

figure, axes = new_figure(1, 1, (6, 4))
axes[0, 0].plot(tried, [1e3 * error(factor) for factor in tried], "o-")
axes[0, 0].axvline(found, linestyle=":")
axes[0, 0].set(xlabel="Young's modulus over the file's [1]", ylabel="RMS error of the tip [mm]")
axes[0, 0].set_title(f"The recording fits {found:.2f} times the modulus")
picture = save(figure, Path("out/examples/identify_stiffness.png"))
