"""Steps per second of many arms on MuJoCo Warp, where there is a CUDA device."""

from importlib.util import find_spec
from time import perf_counter

import numpy as np

from softrobot_env.benchmarks.speed.rows import Row, step_row
from softrobot_env.envs.vector import VectorTrackingEnv

WHAT = "warp env.step"

#: Robots at once.
COUNTS = (256, 1024, 4096, 16384)

#: Control periods of a block, and blocks.
_STEPS, _BLOCKS = 50, 5


def run(quick: bool, device: str = "cuda:0", counts: tuple[int, ...] = COUNTS) -> list[Row]:
    """Rows by number of robots; or one row that says why nothing was measured."""
    missing = _missing(device)
    if missing is not None:
        return [Row(WHAT, f"not measured: {missing}")]
    return [_timed(count, device, 1 if quick else _BLOCKS) for count in counts]


def _missing(device: str) -> str | None:
    """What keeps a device from being measured."""
    if find_spec("torch") is not None and device != "cpu":
        import torch

        if not torch.cuda.is_available():
            return "no CUDA device"
    if find_spec("mujoco_warp") is None or find_spec("torch") is None:
        return "no MuJoCo Warp"
    return None


def _timed(count: int, device: str, blocks: int) -> Row:
    """Row of the arm's environment, with actions and observations on the device."""
    import torch

    env = VectorTrackingEnv(count, "swing", backend="warp", device=device, observe_as="vector")
    env.reset(seed=0)
    actions = torch.zeros((count, len(env.input_scale)), device=device)
    times = []
    for _ in range(1 + blocks):  # the first one loads what Warp and PyTorch compile
        begin = perf_counter()
        for _ in range(_STEPS):
            told = env.step(actions)
        told[1].sum().item()  # waits for the device
        times.append((perf_counter() - begin) / _STEPS)
    name = "cpu" if device == "cpu" else torch.cuda.get_device_name(device)
    return step_row(WHAT, f"arm on {name}", float(np.min(times[1:])), None, count=count)
