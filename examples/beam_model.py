"""A beam model alone: the arm as pieces of constant curvature, at rest and released."""

from pathlib import Path

import numpy as np

from softrobot_env.beams.pcc import PCC
from softrobot_env.rendering.figures import new_figure, save
from softrobot_env.robots import ARM

arm = PCC(ARM, pieces=6, axes="planar")
stations = np.linspace(0, ARM.length, 60)
figure, axes = new_figure(1, 2, (9, 4))
for tension in (0.0, 4.0, 8.0, 12.0):
    pulled = np.array([tension, 0, tension, 0, tension, 0])
    rest = arm.equilibrium(pulled)
    shape = 1e3 * arm.positions(rest, stations)
    axes[0, 0].plot(shape[:, 0], shape[:, 2])
    axes[0, 0].annotate(f"{tension:.0f} N", shape[-1, [0, 2]])
axes[0, 0].set(xlabel="x [mm]", ylabel="z [mm]", aspect="equal", title="At rest")

motion = arm.simulate(3.0, np.array([10.0, 0, 10.0, 0, 10.0, 0]), samples=0.01)
tip = 1e3 * arm.tip(motion.q)
axes[0, 1].plot(np.linspace(0, 3, len(tip)), tip[:, 0])
axes[0, 1].set(xlabel="time [s]", ylabel="tip x [mm]", title="After a step of 10 N")
print(f"the tip ends at x = {tip[-1, 0]:.1f} mm")
picture = save(figure, Path("out/examples/beam_model.png"))
