"""Beam models and chains by the names that reports have, and what is read from them."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from numpy import ndarray
from scipy.linalg import eigh

from softrobot_env.beams.ancf import ANCF
from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.model import BeamModel
from softrobot_env.beams.pcc import PCC
from softrobot_env.evaluation.models.runs import best_of, converged
from softrobot_env.robots import RobotParams
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import RULES

_STEPS = 200


def make_beam(
    name: str,
    robot: RobotParams,
    pieces: int,
    loads: Sequence[Load] = (),
    space: str = "planar",
    **options: Any,
) -> BeamModel:
    """Build a beam model.

    Args:
        name: "pcc", or "pcc/" and the kind of its inertia; "cosserat"; "ancf" or "ancf2d".
        robot: The robot.
        pieces: Number of pieces.
        loads: Loads.
        space: "planar", "spatial" or "torsion": the cheapest version that can do this motion is
            taken. The Cosserat rod is always spatial.
        **options: Further options of the model, instead of those that follow from the others.
    """
    kind, _, inertia = name.partition("/")
    if kind == "pcc":
        own = {"axes": space} | ({"inertia": inertia} if inertia else {})
        return PCC(robot, pieces, loads=loads, **(own | options))
    if kind == "cosserat":
        return CosseratRod(robot, pieces, loads=loads, **options)
    own = {"dimension": 2 if space == "planar" else 3}
    model = ANCF(robot, pieces, loads=loads, **(own | options))
    model.warns = False  # what it errs by is what is studied
    return model


def chain_scene(robot: RobotParams, rule: str, n: int, **options: Any) -> Scene:
    """The MuJoCo chain with n joints of a hinge rule; `options` as those of `SceneConfig`."""
    return build_scene(SceneConfig(robot, pieces=n // len(RULES[rule]), rule=rule, **options))


def weightless(robot: RobotParams) -> RobotParams:
    """The robot without gravity."""
    return replace(robot, gravity=(0.0, 0.0, 0.0))


def mode_frequency(model: BeamModel, torsion: bool = False) -> float:
    """Lowest frequency [Hz] of the straight robot that moves its tip, or that twists it.

    From the eigenvalues of the linear model; the thesis' Fourier transform over two periods
    resolves half the frequency (audit).

    Raises:
        ValueError: The model has no such mode.
    """
    start = model.start()
    space, tangent = model.linearize(start), model.tangent(start.q)
    # The straight robot's matrices are symmetric, also with the printed moments.
    squares, modes = eigh(space.stiffness, space.mass)
    straight = _end_points(model, start.q)
    for square, mode in zip(squares, (tangent @ modes).T, strict=True):
        size = 1e-6 / np.max(np.abs(mode / model.data.scale))
        center, rim = _end_points(model, start.q + size * mode) - straight
        twists = abs(rim[1] - center[1]) > np.linalg.norm(center)
        if square > 0 and twists == torsion:
            return float(np.sqrt(square) / (2 * np.pi))
    raise ValueError("the model has no such mode")


def tip_twist(model: BeamModel, q: ndarray) -> float:
    """Angle [rad] by which the tip's section is turned about the straight robot's axis."""
    center, rim = _end_points(model, q)
    return float(np.arctan2(rim[1] - center[1], rim[0] - center[0]))


def _end_points(model: BeamModel, q: ndarray) -> ndarray:
    """Centre of the end and a point of its rim (2, 3) [m]."""
    rim = np.array([[0.0, 0.0], [model.robot.outer_radius, 0.0]])
    return model.positions(q, np.full(2, model.robot.length), rim)


def step_cost(
    model: mujoco.MjModel,
    posture: ndarray | None = None,
    ctrl: ndarray | None = None,
    repeats: int = 5,
) -> float:
    """Time [s] of one `mj_step` from a posture (nq,) under controls (nu,), else from the start."""
    data = mujoco.MjData(model)
    if posture is not None:
        data.qpos[:] = posture
    if ctrl is not None:
        data.ctrl[:] = ctrl
    mujoco.mj_step(model, data)
    return best_of(lambda: mujoco.mj_step(model, data, _STEPS), repeats)[0] / _STEPS


def zero_timestep(tips: Sequence[ndarray]) -> tuple[ndarray, ndarray]:
    """Limits of motions with timesteps h, h/2 and h/4, for an error series in h.

    Returns:
        The best estimate, and the one of the two finer motions alone.
    """
    found = dict(zip((1, 2, 4), tips, strict=True))
    return converged(found, 1), converged({n: found[n] for n in (2, 4)}, 1)
