"""Error against run time of the models of one robot, at rest and in a demanding motion.

The chain and PCC only bend (and twist); the Cosserat rod also shears and stretches. Each is
compared with the limit of infinitely fine models of the same physics, and rows give the distance
between the two limits.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from time import process_time
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.core.interfaces import ProgressCallback, quiet
from softrobot_env.core.motion import IntegrationError
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.registry import scene_of

from .runs import (
    Excitation,
    Limit,
    Simulated,
    beam_of,
    best_of,
    distance,
    excitation,
    extrapolate,
    unwarned,
)

#: Length [s] of the motion, full and quick, and number of poses compared at rest.
DURATIONS, POSES = (2.0, 0.4), (8, 3)

#: Pieces over the robot's own, coarse to fine, of which a quick run omits the last ones; and those
#: of the limits, full and quick.
SIZES = {"mujoco_chain": (0.5, 1, 2, 4), "pcc": (1, 2, 4), "cosserat": (2, 4, 8)}
_LIMIT_SIZES = {"bending": ((2, 4, 8), (1, 2, 4)), "shear": ((4, 8, 16), (2, 4, 8))}

#: Accuracies of our own integrator over the length, timesteps [s] of MuJoCo's, and tolerances of
#: the beams' adapted steps; then those of the limits.
SHARES, TIMESTEPS, TOLERANCES = (1e-2, 1e-3, 1e-4), (5e-3, 2e-3, 1e-3, 5e-4), (1e-2, 1e-3, 1e-4)
_SHARP, _SHARP_TIMESTEP, _SHARP_TOLERANCE = 1e-5, 1e-4, 1e-6

_METHOD, _THEIRS = "sdirk4", "implicitfast"  # for the beam models, and MuJoCo's

#: An integrator's name, its setting, and the options of a model that has it.
Setting = tuple[str, float, dict[str, Any]]

_FAILURES = (EquilibriumError, IntegrationError)


@dataclass(frozen=True)
class AccuracyRow:
    """A measurement; None where a field does not apply.

    Attributes:
        kind: "rest", "motion", "limit" (its uncertainty, or the distance of two limits) or "note"
            (what was omitted, and why).
        model, n: The model and its number of pieces.
        integrator, setting: Its name, and its timestep [s], accuracy [m] or tolerance [1].
        e_mean, e_max: [m], distance of the tips from the limit.
        share: e_max over the robot's length [1].
        cost: [s], processor time of an equilibrium, or of a second of motion.
        physics: "bending" or "shear".
        note: The limit used for comparison, or why there is no figure.
    """

    kind: str
    model: str
    n: int | None = None
    integrator: str | None = None
    setting: float | None = None
    e_mean: float | None = None
    e_max: float | None = None
    share: float | None = None
    cost: float | None = None
    physics: str | None = None
    note: str | None = None


@dataclass(frozen=True)
class Contestant:
    """A model with one resolution; `build` creates it with the options of one of its settings."""

    name: str
    n: int
    build: Callable[..., Simulated]
    settings: tuple[Setting, ...]

    @property
    def physics(self) -> str:
        """The physics it converges to."""
        return "shear" if self.name == "cosserat" else "bending"


@unwarned()
def measure(
    robot: RobotParams, quick: bool = False, progress: ProgressCallback = quiet
) -> list[AccuracyRow]:
    """Errors and times of the models of a robot.

    Args:
        robot: The robot.
        quick: Fewer resolutions, and a shorter motion.
        progress: Called with (description, done, total).
    """
    config = replace(scene_of(robot), sensors=())
    moved = excitation(build_scene(config), DURATIONS[quick])
    poses = _held(chain(config, robot.pieces), moved.poses)[: POSES[quick]]
    contestants, rows = _contestants(config, quick)
    known = {each.physics: _LIMIT_SIZES[each.physics][quick] for each in contestants}
    limits: dict[tuple[str, str], Limit] = {}
    total = len(known) + len(contestants)
    for done, (physics, sizes) in enumerate(known.items()):
        progress(f"limit of {physics}", done, total)
        fine = {n: _sharp(config, physics, n) for n in (k * robot.pieces for k in sizes)}
        tasks: dict[str, Callable[[Simulated], ndarray]] = {
            "rest": lambda model: model.poses(poses),
            "motion": lambda model: model.motion(moved),
        }
        for kind, act in tasks.items():
            try:
                limit = extrapolate(lambda n, act=act, f=fine: act(f[n]), list(fine), "limit")
            except (*_FAILURES, ValueError) as error:
                text = f"no limit to compare with: {error}"
                rows.append(AccuracyRow("note", f"{kind}, {physics}", physics=physics, note=text))
                continue
            limits[kind, physics] = limit
            rows.append(_gap(f"{kind}, {physics}: uncertainty", limit.uncertainty, robot, limit))
    for done, each in enumerate(contestants, len(known)):
        progress(f"{each.name}, {each.n} pieces", done, total)
        for kind in ("rest", "motion"):
            if (kind, each.physics) in limits:
                limit = limits[kind, each.physics]
                rows += _measured(kind, each, limit, poses, moved, 2 if quick else 4)
    for kind in ("rest", "motion"):
        pair = [limits[key] for key in ((kind, "bending"), (kind, "shear")) if key in limits]
        if len(pair) == 2:
            gap = distance(*(limit.tips for limit in pair))
            rows.append(_gap(f"{kind}: what shear and stretch change", gap, robot, pair[1]))
    return rows


def chain(config: SceneConfig, pieces: int, **options: Any) -> Simulated:
    """The MuJoCo chain with some pieces; options of `SceneConfig`, no timestep beyond a period."""
    if "timestep" in options:
        options["timestep"] = min(options["timestep"], config.control_period)
    return Simulated(build_scene(replace(config, pieces=pieces, **options)), config.robot)


def _beam(config: SceneConfig, name: str, pieces: int, tolerance: float) -> Simulated:
    model = beam_of(config, name, pieces)
    return Simulated(model, config.robot, {"method": _METHOD, "tolerance": tolerance})


def _sharp(config: SceneConfig, physics: str, pieces: int) -> Simulated:
    """A model whose error in time is far below that of all others."""
    if physics == "shear":
        return _beam(config, "cosserat", pieces, _SHARP_TOLERANCE)
    if config.robot.holds:  # which our own integrator does not support
        return chain(config, pieces, integrator="discrete", timestep=_SHARP_TIMESTEP)
    return chain(config, pieces, accuracy=_SHARP * config.robot.length)


def _held(model: Simulated, poses: ndarray) -> ndarray:
    """The inputs, out of (k, n_inputs), under which a robot comes to rest."""
    found = []
    for u in poses:
        try:
            model.poses(u[None])
        except EquilibriumError:
            continue
        found.append(u)
    return np.array(found).reshape(-1, poses.shape[1])


def _contestants(config: SceneConfig, quick: bool) -> tuple[list[Contestant], list[AccuracyRow]]:
    """All models and resolutions that support this robot, and notes on the others."""
    length = config.robot.length
    ours = [("extrapolation", a * length, {"accuracy": a * length}) for a in SHARES]
    theirs = [(_THEIRS, h, {"timestep": h, "integrator": _THEIRS}) for h in TIMESTEPS]
    settings = {"mujoco_chain": theirs if config.robot.holds else ours + theirs}
    found, notes = [], []
    for name, factors in SIZES.items():
        sizes = dict.fromkeys(max(1, round(k * config.robot.pieces)) for k in factors)
        for n in list(sizes)[: -1 if quick else None]:
            build: Callable[..., Simulated] = partial(chain, config, n)
            if name != "mujoco_chain":
                build = partial(_beam, config, name, n)
            mine = settings.get(name) or [(_METHOD, t, {"tolerance": t}) for t in TOLERANCES]
            try:
                build(**mine[0][2])
            except ValueError as error:
                notes.append(AccuracyRow("note", name, n, note=f"left out: {error}"))
                continue
            found.append(Contestant(name, n, build, tuple(mine)))
    return found, notes


def _measured(
    kind: str, each: Contestant, limit: Limit, poses: ndarray, moved: Excitation, repeats: int
) -> Iterator[AccuracyRow]:
    """A row for each setting in motion, and one at rest, where settings do not matter."""
    at_rest = kind == "rest"
    for integrator, setting, options in each.settings[-1:] if at_rest else each.settings:
        row = AccuracyRow(kind, each.name, each.n, physics=each.physics)
        if not at_rest:
            row = replace(row, integrator=integrator, setting=setting)
        try:
            model = each.build(**options)
            act, first, whole = model.poses, poses[:1], poses
            if not at_rest:
                act = partial(model.motion, start=model.start(moved.rest))
                first, whole = replace(moved, controls=moved.controls[:1]), moved
            act(first)  # compiles
            time, tips = best_of(partial(act, whole), repeats, process_time)
        except _FAILURES as error:
            yield replace(row, note=f"failed: {error}")
            continue
        errors = np.linalg.norm(tips - limit.tips, axis=1)
        values = {"e_mean": float(errors.mean()), "e_max": float(errors.max())}
        values["share"] = values["e_max"] / model.robot.length
        cost = time / (len(poses) if at_rest else moved.duration)
        yield replace(row, cost=cost, note=limit.text, **values)


def _gap(what: str, gap: float, robot: RobotParams, limit: Limit) -> AccuracyRow:
    return AccuracyRow("limit", what, e_max=gap, share=gap / robot.length, note=limit.text)
