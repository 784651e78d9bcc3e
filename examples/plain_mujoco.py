"""A robot as MJCF, stepped by MuJoCo alone: nothing of this package is needed to load it."""

from pathlib import Path

import mujoco
import numpy as np

from softrobot_env.rendering.figures import new_figure, save
from softrobot_env.robots import find_robot
from softrobot_env.scene.build import scene_xml
from softrobot_env.scene.registry import scene_of

folder = Path("out/examples")
folder.mkdir(parents=True, exist_ok=True)
(folder / "trunk.xml").write_text(scene_xml(scene_of(find_robot("hanging_trunk"))))

# From here on plain MuJoCo, with the timestep that the rule chose for the file.
model = mujoco.MjModel.from_xml_path(str(folder / "trunk.xml"))
data = mujoco.MjData(model)
data.ctrl[0] = 5.0  # [N]
end = model.nbody - 1
times, places = [], []
while data.time < 1.0:
    mujoco.mj_step(model, data)
    times.append(data.time)
    places.append(data.xpos[end].copy())
places = 1e3 * (np.array(places) - places[0])
print(f"the last link moved by {np.linalg.norm(places[-1]):.0f} mm")

figure, axes = new_figure(1, 1, (6, 4))
for values, name in zip(places.T, "xyz", strict=True):
    axes[0, 0].plot(times, values, label=name)
axes[0, 0].set(xlabel="time [s]", ylabel="motion of the last link [mm]")
axes[0, 0].set_title("One tendon pulled, in plain MuJoCo")
axes[0, 0].legend(frameon=False)
picture = save(figure, folder / "plain_mujoco.png")
