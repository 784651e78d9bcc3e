"""Refined runs of a scene: the same chain in ever finer steps, until two of them agree.

A chain whose fastest mode swings freely is integrated by the Runge-Kutta scheme of order four,
one whose fast modes creep (explicit steps would have to be tiny) by implicitfast, extrapolated to
zero timestep from three runs. Tendons that rub take discrete, extrapolated too: the others find the
friction as if the joints were undamped, and on a stiff overdamped chain are far off until the steps
resolve its fastest creep. None knows the rule that picks a scene's timestep. Steps are halved until
two successive results agree, or the next ones would cost more than `BUDGET`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import mujoco
import numpy as np
from scipy.linalg import eigh

from softrobot_env.benchmarks.accuracy.rows import distance, zero_timestep
from softrobot_env.benchmarks.scenes.draw import RandomScene, swing
from softrobot_env.benchmarks.stability.runs import mujoco_integrator
from softrobot_env.scene.build import Scene
from softrobot_env.scene.chain import posture
from softrobot_env.scene.timestep import linearize

#: Nominal cost [s] that the refined runs of a scene may have: of a step, not the clock's, so that
#: verdicts do not depend on the machine.
BUDGET = 10.0

#: Explicit steps are taken while they are not shorter than implicit ones by more than this factor.
_SHORTER = 4.0

#: First refined step, in first periods and in stability limits, and steps per control period at
#: least.
_OF_PERIOD, _OF_LIMIT, _LEAST = 1 / 60, 0.6, 4

#: First refined step in first periods where tendons rub and stick in turns.
_RUBBING = 1 / 400

#: [s], time constant of dry friction in refined runs. MuJoCo's friction is soft: a tendon that
#: should stick creeps for about that long, or for two timesteps if they are longer. So Coulomb's
#: law is met in the limit of short steps.
_FRICTION = 1e-9

#: MuJoCo's warnings of a diverged state. Accelerations are left out: those of small, stiff robots
#: exceed what it takes for sane (1e10 rad/s2).
_DIVERGED = (int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADQVEL))


@dataclass(frozen=True)
class Refined:
    """What refined runs say.

    Attributes:
        tips: (1 + periods, 3) [m] at the start and after each control period; None if no two of
            them ended.
        uncertainty: [m], distance between the two best; None without them.
        substeps: Steps per control period of the finest.
        method: "RK4", or "implicitfast extrapolated", "discrete extrapolated".
    """

    tips: np.ndarray | None
    uncertainty: float | None
    substeps: int
    method: str


def step_cost(nv: int, integrator: str) -> float:
    """Nominal time [s] of a step of a chain with nv degrees of freedom.

    Fitted to chains of 12 to 180 on one core of a server (`benchmarks.timing.step_cost`).
    """
    one = 1e-6 * (1.5 + 0.1 * nv + 0.016 * nv**2)
    return one * {"RK4": 3.0, "implicitfast": 1.0, "discrete": 1.0}.get(integrator, 2.0)


def start_posture(scene: Scene, drawn: RandomScene) -> np.ndarray:
    """Posture (nq,) in which a drawn scene starts."""
    kinds = 1 if scene.config.bending == "planar" else 3 if scene.config.torsion else 2
    return posture(scene.model, np.outer(scene.layout.weights, drawn.curvature[:kinds]))


def refine(
    scene: Scene, drawn: RandomScene, enough: Callable[[np.ndarray, float], bool]
) -> Refined:
    """Halve the timestep until results agree.

    Args:
        scene: The compiled scene, whose integrator, timestep and friction are changed.
        drawn: Where it starts and what drives it.
        enough: Whether tips (1 + periods, 3) [m] with an uncertainty [m] are good enough.
    """
    scene.model.tendon_solref_fri[:, 0] = _FRICTION
    method, substeps = _first(scene)
    return _ladder(scene, drawn, enough, method, substeps)


def _first(scene: Scene) -> tuple[str, int]:
    """Method, and its steps per control period in the coarsest of the refined runs."""
    chain, period = linearize(scene.model), scene.config.control_period
    fastest = float(eigh(chain.stiffness, chain.mass, eigvals_only=True)[-1]) ** 0.5
    creep = float(eigh(chain.damping, chain.mass, eigvals_only=True)[-1])
    implicit = max(2 / fastest, 2 * creep / fastest**2)
    steps = {"RK4": 2 / max(fastest, creep), "implicitfast": implicit}
    method = "RK4" if _SHORTER * steps["RK4"] >= steps["implicitfast"] else "implicitfast"
    step = min(_OF_LIMIT * steps[method], _OF_PERIOD / swing(scene.config.robot))
    if scene.config.robot.has_friction:
        method, step = "discrete", min(step, _RUBBING / swing(scene.config.robot))
    return method, max(_LEAST, ceil(period / step))


def _ladder(
    scene: Scene,
    drawn: RandomScene,
    enough: Callable[[np.ndarray, float], bool],
    method: str,
    substeps: int,
) -> Refined:
    name = method if method == "RK4" else f"{method} extrapolated"
    cost = step_cost(scene.model.nv, method)
    found, runs, spent = None, [], 0.0
    while spent + cost * substeps * len(drawn.controls) <= BUDGET:
        run = refined_run(scene, drawn, method, substeps)
        spent += cost * substeps * len(run)
        ended = len(run) > len(drawn.controls)
        runs = [*runs, run] if ended else []  # a failed step size ends a series
        found = _estimate(method, runs) or found
        if found is not None and enough(*found):
            break
        substeps *= 2
    tips, uncertainty = found or (None, None)
    return Refined(tips, uncertainty, substeps, name)


def _estimate(method: str, runs: list[np.ndarray]) -> tuple[np.ndarray, float] | None:
    """Best tips of successive refinements and how far they are from the next best."""
    if method == "RK4":
        return (runs[-1], distance(runs[-1], runs[-2])) if len(runs) > 1 else None
    if len(runs) < 3:
        return None
    best, second = zero_timestep(runs[-3:])
    if method != "discrete":
        return best, distance(best, second)
    if len(runs) < 4:  # friction makes the error no series in the step
        return None
    return best, distance(best, zero_timestep(runs[-4:-1])[0])


def refined_run(scene: Scene, drawn: RandomScene, integrator: str, substeps: int) -> np.ndarray:
    """Tips (1 + periods, 3) [m] of a run with fixed steps; fewer if it diverged."""
    model, period = scene.model, scene.config.control_period
    model.opt.timestep = period / substeps
    model.opt.integrator = mujoco_integrator(integrator)
    data = mujoco.MjData(model)
    data.qpos[:] = start_posture(scene, drawn)
    mujoco.mj_kinematics(model, data)
    tip = data.site("tip").xpos
    tips = [tip.copy()]
    for row in drawn.controls:
        data.ctrl[:] = row
        mujoco.mj_step(model, data, substeps)
        mujoco.mj_kinematics(model, data)
        if any(data.warning[kind].number for kind in _DIVERGED) or not np.all(np.isfinite(tip)):
            break
        tips.append(tip.copy())
    return np.array(tips)
