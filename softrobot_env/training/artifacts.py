"""Files of trained networks, and the figures that are told of them."""

import json
from pathlib import Path

import numpy as np

from softrobot_env.learned.network import Network
from softrobot_env.learned.quasi_static import describe
from softrobot_env.paths import models_dir
from softrobot_env.robots import ARM
from softrobot_env.training.closed_loop_check import check

_START = "imitation.npz"


def save(network: Network, path: Path, seed: int) -> None:
    """Write a network in single precision, with the robot and the seed."""
    single = Network(
        tuple(weight.astype(np.float32) for weight in network.weights),
        tuple(bias.astype(np.float32) for bias in network.biases),
        network.inputs,
        network.outputs,
    )
    single.save(path, {**describe(ARM), "seed": seed})


def load_start(path: Path) -> Network:
    """The imitating network: the one in the folder of `path`, else the one shipped.

    Raises:
        FileNotFoundError: There is neither.
    """
    found = [p for p in (path.parent / _START, models_dir() / _START) if p.is_file()]
    if not found:
        raise FileNotFoundError(f"no {_START} to start from; make it: softrobot train imitation")
    return Network.load(found[0])[0]


def save_curve(curve: list[dict[str, float]], path: Path) -> Path:
    """Write a learning curve beside a network; returns where."""
    out = path.with_name(f"{path.stem}_curve.json")
    out.write_text(json.dumps(curve, indent=1) + "\n", encoding="utf-8")
    return out


def figures(
    network: Network, variations: tuple[dict[str, float], ...] = ({},)
) -> list[tuple[str, str]]:
    """Closed-loop figures for people, with robots and disturbances as `check` takes them."""
    out = [("parameters", str(len(network.parameters)))]
    for name, row in check(network, variations).items():
        text = f"max {row.max_mm:.2f} mm, mean {row.mean_mm:.2f} mm"
        if row.step_width is not None:
            text = f"overshoot {_text(row.overshoot_percent)} %, "
            text += f"settling {_text(row.settling_s)} s"
        out.append((name, row.failure or text))
    return out


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
