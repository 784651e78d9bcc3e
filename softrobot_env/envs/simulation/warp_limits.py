"""Limits of the backend "warp", checked before anything is built, without heavy imports."""

import re
from collections.abc import Iterable
from dataclasses import replace
from importlib.util import find_spec
from math import ceil
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from softrobot_env.core.extras import install_command
from softrobot_env.robots.variations import VARIATIONS
from softrobot_env.scene.build import Scene
from softrobot_env.scene.config import DEFAULT_SHARE
from softrobot_env.scene.tendons import is_ideal
from softrobot_env.scene.timestep import EXTRAPOLATION

from ..randomization import Randomization
from .batch import VARIED

if TYPE_CHECKING:  # takes seconds to load
    from .warp_batch import WarpBatch

#: Its integrators.
INTEGRATORS = (EXTRAPOLATION, "implicitfast", "discrete")

#: Length of a step of the extrapolation, over the first period, unless a timestep is given.
STEP_SHARE = 1 / 150

_BACKEND = "backend 'warp'"


def checked_device(device: str | None) -> str:
    """The requested device, by default the first CUDA device.

    Raises:
        ImportError: The extra is not installed.
        ValueError: There is no such device; the message names the available ones.
    """
    missing = [name for name in ("mujoco_warp", "torch") if find_spec(name) is None]
    if missing:
        raise ImportError(f"{_BACKEND} needs {', '.join(missing)}: {install_command('gpu')}")
    import torch

    there = [f"cuda:{k}" for k in range(torch.cuda.device_count())]
    wanted = (there or ["cuda:0"])[0] if device is None else device
    wanted = "cuda:0" if wanted == "cuda" else wanted
    if not isinstance(wanted, str) or wanted not in [*there, "cpu"]:
        known = re.fullmatch(r"cuda:\d+", str(wanted))
        what = f"there is no CUDA device {wanted!r}" if known else f"unknown device {wanted!r}"
        raise ValueError(f"{what}; choose from {', '.join([*there, 'cpu'])} (cpu is for tests)")
    return wanted


def check_options(threads: int, integrator: str | None, accuracy: float | str) -> None:
    """Raise ValueError for arguments of an environment that the backend does not support."""
    if threads:
        raise ValueError(f"{_BACKEND} takes no threads, they are MuJoCo's: choose a device")
    if integrator not in (None, *INTEGRATORS):
        raise ValueError(
            f"{_BACKEND} has the integrators {', '.join(INTEGRATORS)}, got {integrator!r}"
        )
    if accuracy != DEFAULT_SHARE:
        raise ValueError(
            f"{_BACKEND} takes no accuracy, its steps have one length: give a timestep"
        )


def check_varied(scene: Scene, names: Iterable[str]) -> None:
    """Raise ValueError for variations of robots, by name, that the backend does not support."""
    checks = {"tendon_friction": _check_friction, "tendon_radius": _check_radius}
    for name in names:
        one = VARIATIONS[name]
        fields = {*one.scales, *one.shifts}
        if name in checks:
            checks[name](scene)
        elif one.apply is not None and (one.switches or not fields or not fields <= {*VARIED}):
            raise ValueError(f"{_BACKEND} cannot vary {name!r}: leave it out, or the backend")


def _check_friction(scene: Scene) -> None:
    if scene.timestep.integrator != EXTRAPOLATION:
        raise ValueError(
            f"{_BACKEND} has friction of tendons with integrator {EXTRAPOLATION!r} alone, not with "
            f"{scene.timestep.integrator!r}"
        )


def _check_radius(scene: Scene) -> None:
    if not VARIATIONS["tendon_radius"].is_of_fields(scene.config.robot):
        raise ValueError(
            f"{_BACKEND} can vary tendon_radius where all tendons are straight; robot "
            f"{scene.name!r} has others"
        )


def check_robot(scene: Scene, randomization: Randomization | None) -> None:
    """Raise ValueError for robots that the backend cannot simulate."""
    model, name = scene.model, scene.name
    if scene.config.robot.has_capstan_friction:
        raise ValueError(
            f"{_BACKEND} has no friction along tendons (friction_coefficient, feed_line of robot "
            f"{name!r}), only on processors"
        )
    if scene.config.robot.has_friction:
        _check_friction(scene)
    if not is_ideal(model):
        raise ValueError(
            f"{_BACKEND} has servos of any force, spools of one radius and wires of one stiffness; "
            f"the drive of robot {name!r} has a gain, a wire_diameter or seating"
        )
    if model.nq != model.nv:
        raise ValueError(
            f"{_BACKEND} takes chains of hinges; robot {name!r} has ball joints, as it bends and "
            "twists alike and has no channels"
        )
    if np.any(model.actuator_trntype != mujoco.mjtTrn.mjTRN_TENDON):
        raise ValueError(f"{_BACKEND} takes drives of tendons alone; robot {name!r} has others")
    check_varied(scene, () if randomization is None else randomization.varied)


def make_batch(scene: Scene, count: int, device: str) -> "WarpBatch":
    """Simulations of a scene that `check_robot` has accepted.

    Args:
        scene: The scene.
        count: Number of simulations.
        device: See `checked_device`.
    """
    from .warp_batch import WarpBatch

    choice, period = scene.timestep, scene.config.control_period
    if choice.integrator == EXTRAPOLATION and scene.config.timestep is None:
        substeps = ceil(period / min(choice.timestep, STEP_SHARE * choice.first_period) - 1e-9)
        scene = replace(
            scene, timestep=replace(choice, timestep=period / substeps, substeps=substeps)
        )
    return WarpBatch(scene, count, device)
