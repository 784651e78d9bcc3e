"""A rod with three tendons, and recordings of robots as tests make them up."""

from collections.abc import Sequence
from os import environ
from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray

from softrobot_env.recordings import Commands, Header, Marker, Recording
from softrobot_env.robots import RobotParams, Tendon

AZIMUTHS = 2 * np.pi * np.arange(3) / 3
LENGTH = 0.2


def rod(radius: float, distance: float, modulus: float, density: float, **tendon) -> RobotParams:
    """A weightless rod of 0.2 m with tendons in channels at a distance, 120 degrees apart."""
    tendons = tuple(
        Tendon(f"t{k}", (distance * np.cos(a), distance * np.sin(a)), LENGTH, 0, 5.0, **tendon)
        for k, a in enumerate(AZIMUTHS)
    )
    size = {"length": LENGTH, "outer_radius": radius, "inner_radius": 0.0, "pieces": 8}
    material = {"youngs_modulus": modulus, "density": density, "damping_time": 0.05}
    return RobotParams("rod", tendons=tendons, poisson_ratio=0.3, **size, **material)


def recorded(
    commands: ndarray,
    kind: str = "tension",
    names: Sequence[str] = ("t0", "t1", "t2"),
    markers: ndarray | None = None,
    labels: Sequence[str] | None = None,
    times: ndarray | None = None,
    marker: Marker | None = None,
    **header,
) -> Recording:
    """Rows (t, n) of commands [N] or [m] in one run, and one marker, at the origin unless given.

    One row a second, at rest, unless times are given.
    """
    rows, names = len(commands), tuple(names)
    unit = {"tension": "N", "length": "m"}[kind]
    known = Commands(kind, names, unit, names, in_force="until" if times is None else "from")
    header = {"rate_Hz": 1.0, "static": True} | header if times is None else header
    return Recording(
        Header(known, (marker or Marker("x", "y", "z"),), **header),
        np.arange(rows) * 1.0 if times is None else np.asarray(times),
        np.asarray(commands),
        np.zeros((rows, 1, 3)) if markers is None else markers,
        np.full(rows, "") if labels is None else np.array(labels),
        np.zeros(rows, dtype=int),
    )


def real_recording(name: str) -> Path:
    """A file of recordings of real robots, which this repository does not contain.

    In the folder $SOFTROBOT_RECORDINGS, else ../shared/real beside the checkout; skips without.
    """
    beside = Path(__file__).resolve().parents[3] / "shared" / "real"
    path = Path(environ.get("SOFTROBOT_RECORDINGS", beside)) / name
    if not path.is_file():
        pytest.skip(f"no {path}: set SOFTROBOT_RECORDINGS to the folder of real recordings")
    return path
