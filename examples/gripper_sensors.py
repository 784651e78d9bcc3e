"""Three fingers close on a bar; the readings of their curvature sensors meanwhile."""

from pathlib import Path

import gymnasium
import numpy as np

import softrobot_env  # noqa: F401  (registers the environments)
from softrobot_env.rendering.figures import new_figure, save

env = gymnasium.make("SoftRobot/GripperEnclose-v0", observe=("sensors", "curvature"))
observation, info = env.reset(seed=0, options={"diameter": 0.06})
straight, times, readings, over = observation["sensors"], [], [], False
while not over:
    observation, reward, terminated, truncated, info = env.step(np.zeros(3, np.float32))
    times.append(info["time"])
    readings.append(observation["sensors"] - straight)
    over = terminated or truncated
print(f"enclosed: {info['success']}")

figure, axes = new_figure(1, 1, (7, 4))
axes[0, 0].plot(times, np.array(readings)[:, :3])
axes[0, 0].set(xlabel="time [s]", ylabel="change of the light [1]")
axes[0, 0].set_title("The first finger bends, and its sensors lose light")
axes[0, 0].legend(["base", "middle", "tip"], frameon=False)
picture = save(figure, Path("out/examples/gripper_sensors.png"))
