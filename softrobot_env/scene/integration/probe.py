"""How accurate and how costly a scene is to simulate, measured in one hard motion.

All drives take random steps over half of their range, each held for a while, from the equilibrium
without tension on. The same motion is computed more accurately, and the points of the backbone are
compared.
"""

from dataclasses import dataclass, replace
from math import ceil, inf
from time import process_time

import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.core.equilibrium import EquilibriumError

from ..build import Scene
from ..statics import equilibrium
from ..timestep import TimestepChoice
from .integrator import Integration

#: [s], length of the motion and of one step of the drives, in control periods at least one.
DURATION, HELD = 2.0, 0.1

#: Evaluations of the forces, times the square of the degrees of freedom, after which a motion that
#: was hard enough ends: a few seconds, which only large or stiff chains take.
MOST_WORK = 2e7

#: Share [1] of the drives' range.
AMPLITUDE = 0.5

#: Factors by which the comparison is more accurate, or has shorter timesteps.
_SHARPER, _SHORTER = 1 / 16, 4


@dataclass(frozen=True)
class Probe:
    """What was measured.

    Attributes:
        error: [m], largest distance of a point of the backbone from the more accurate motion; inf
            where one of the two diverged.
        evaluations: Of the forces in a control period, in the mean.
        cost: [s], processor time of a control period, in the mean.
        duration: [s] of the motion.
    """

    error: float
    evaluations: float
    cost: float
    duration: float


def probe(scene: Scene, seed: int = 0) -> Probe:
    """Measure a scene.

    Args:
        scene: The scene; its model is shared, not changed.
        seed: Of the random steps.
    """
    choice = scene.timestep
    controls = controls_of(scene, seed)
    found, evaluations, cost = motion(scene, controls, MOST_WORK / scene.model.nv**2)
    truth, *_ = motion(replace(scene, timestep=_finer(choice)), controls[: len(found)])
    distance = np.linalg.norm(found - truth, axis=-1)
    error = float(distance.max()) if np.all(np.isfinite(distance)) else inf
    return Probe(error, evaluations, cost, len(found) * scene.config.control_period)


def _finer(choice: TimestepChoice) -> TimestepChoice:
    if choice.accuracy is not None:
        return replace(choice, accuracy=choice.accuracy * _SHARPER)
    return replace(choice, timestep=choice.timestep / _SHORTER, substeps=choice.substeps * _SHORTER)


def controls_of(scene: Scene, seed: int) -> ndarray:
    """Controls (periods, nu) of all control periods."""
    low, high = scene.model.actuator_ctrlrange.T
    middle = np.clip(0.0, low, high)
    period, rng = scene.config.control_period, np.random.default_rng(seed)
    held = max(1, round(HELD / period))
    shares = rng.uniform(-1, 1, (ceil(DURATION / period / held), scene.model.nu)) * AMPLITUDE
    steps = middle + np.where(shares > 0, (high - middle) * shares, (middle - low) * shares)
    return np.repeat(steps, held, axis=0)


def motion(scene: Scene, controls: ndarray, most: float = inf) -> tuple[ndarray, float, float]:
    """Run a scene under controls (periods, nu), from its rest, for as many evaluations at most.

    Returns:
        Positions (periods, bodies, 3) [m] of the links, evaluations of all forces in a control
        period and its processor time [s].
    """
    model, choice = scene.model.__copy__(), scene.timestep
    model.opt.timestep = choice.timestep
    data, integration = mujoco.MjData(model), Integration(model, choice)
    data.qpos[:] = _rest(model)
    mujoco.mj_forward(model, data)
    positions = np.empty((len(controls), model.nbody, 3))
    begin = process_time()
    for k, control in enumerate(controls):
        data.ctrl[:] = control
        integration.advance.locked(model._address, data._address, 0, integration.header)
        positions[k] = data.xpos
        if integration.evaluations[0] > most:
            break
    spent, periods = process_time() - begin, k + 1
    return positions[:periods], integration.evaluations[0] / periods, spent / periods


def _rest(model: mujoco.MjModel) -> ndarray:
    """Equilibrium (nq,) without drives; straight where there is none that is stable."""
    try:
        return equilibrium(model, np.clip(np.zeros(model.nu), *model.actuator_ctrlrange.T))
    except EquilibriumError:
        return model.qpos0.copy()
