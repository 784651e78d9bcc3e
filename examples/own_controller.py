"""Your own controller: inverse statics, corrected by an integral of the tip's error."""

from pathlib import Path

import gymnasium
import numpy as np

import softrobot_env  # noqa: F401  (registers the environments)
from softrobot_env.control.registry import make_policy
from softrobot_env.evaluation.run import run_episode
from softrobot_env.rendering.curves import draw_tip, varied_curves
from softrobot_env.rendering.figures import add_legend, new_figure, save


class Shifted:
    """Gives the static policy a reference shifted by the accumulated error."""

    requires = ("tip_position", "reference", "previous_action")

    def __init__(self, static, gain):
        self.static, self.gain = static, gain

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        shift = np.zeros_like(observation["reference"]) if state is None else state
        error = observation["reference"] - observation["tip_position"]
        shift = np.clip(shift + self.gain * error, -0.02, 0.02)
        asked = observation | {"reference": observation["reference"] + shift}
        return self.static.predict(asked)[0], shift


env = gymnasium.make(
    "SoftRobot/Track-v0", robot="planar_finger", task="figure_eight", observe="all"
)
static = make_policy("static", env)
softer = {"vary": {"youngs_modulus": 0.8}}  # the robot differs from the policy's model
rollouts = {
    "static": run_episode(env, static, seed=0, options=softer),
    "shifted": run_episode(env, Shifted(static, gain=0.1), seed=0, options=softer),
}
for name, rollout in rollouts.items():
    print(f"{name}: mean error {1e3 * rollout.error.mean():.2f} mm")

figure, axes = new_figure(3, 1, (7, 6))
draw_tip(axes[:, 0], varied_curves(rollouts))
add_legend(figure, axes[0, 0])
picture = save(figure, Path("out/examples/own_controller.png"))
