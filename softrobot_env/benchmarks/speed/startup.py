"""What a user waits for: imports, the first environment, a rendered frame."""

import json
import subprocess
import sys
from time import perf_counter

from softrobot_env.envs.rendering.renderer import RenderError
from softrobot_env.envs.tracking import TrackingEnv

#: Runs in a fresh interpreter, so that nothing is loaded before it is timed.
_SCRIPT = """
import json, time
begin = time.perf_counter()
import gymnasium, mujoco
basis = time.perf_counter()
import softrobot_env
package = time.perf_counter()
env = gymnasium.make("SoftRobot/ArmSwing-v0")
first = time.perf_counter()
gymnasium.make("SoftRobot/ArmSwing-v0")
second = time.perf_counter()
print(json.dumps({
    "import mujoco, gymnasium": basis - begin,
    "import softrobot_env (after them)": package - basis,
    "gymnasium.make, first": first - package,
    "gymnasium.make, again": second - first,
}))
"""

_FRAMES = 40


def startup_times(repeats: int) -> dict[str, float]:
    """Least time [s] of each part of the start over several fresh interpreters."""
    command = [sys.executable, "-c", _SCRIPT]
    done = [subprocess.run(command, capture_output=True, check=True) for _ in range(repeats)]
    runs = [json.loads(one.stdout) for one in done]
    return {name: min(run[name] for run in runs) for name in runs[0]}


def frame_time() -> float | None:
    """Mean time [s] of one offscreen frame of 640 x 480, None without OpenGL."""
    env = TrackingEnv("swing", render_mode="rgb_array")
    env.reset()
    try:
        env.render()
    except RenderError:
        return None
    begin = perf_counter()
    for _ in range(_FRAMES):
        env.render()
    mean = (perf_counter() - begin) / _FRAMES
    env.close()
    return mean
