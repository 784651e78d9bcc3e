"""A random scene as an environment would step it, and how far it is from its refined runs."""

from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from softrobot_env.benchmarks.accuracy.rows import distance
from softrobot_env.benchmarks.scenes.draw import RandomScene
from softrobot_env.benchmarks.scenes.refined import Refined, refine, start_posture, step_cost
from softrobot_env.benchmarks.scenes.rows import Row, row_of
from softrobot_env.benchmarks.stability.runs import neutral_scene, silent_warnings
from softrobot_env.benchmarks.verdicts import verdict_of, with_warning
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.simulation import Simulation

#: A truth is good enough if it is known to this share of the accuracy asked for, or of the error.
_CLEAR, _CLEARLY_WRONG = 0.25, 0.1

#: Nominal cost [s] above which the package's own run is not made.
_DEAREST = 10.0


@dataclass(frozen=True)
class OwnRun:
    """What the package does by itself.

    Attributes:
        scene: The compiled scene; None if it was refused.
        warning: What a `TimestepWarning` said, or None.
        tips: (1 + periods, 3) [m]; None if the run failed or was not made.
        failure: Why it failed, or None.
        wall_time: [s] of the steps.
        estimate: [m], the package's own estimate of the error in time; None if it gives none.
    """

    scene: Scene | None
    warning: str | None = None
    tips: np.ndarray | None = None
    failure: str | None = None
    wall_time: float | None = None
    estimate: float | None = None


def judge(drawn: RandomScene, **forced: Any) -> Row:
    """Run a scene and judge it.

    Args:
        drawn: The scene.
        **forced: Fields of its `SceneConfig` to set, such as a timestep.
    """
    drawn = replace(drawn, config=replace(drawn.config, **forced))
    with silent_warnings():
        own, warning = with_warning(lambda: _own_run(drawn))
        own = replace(own, warning=warning)
        truth = _truth(drawn, own)
    error = None if own.tips is None or truth.tips is None else distance(own.tips, truth.tips)
    asked, length = drawn.config.wanted_accuracy, drawn.config.robot.length
    verdict = verdict_of(error, asked, length, failure=own.failure, warning=warning)
    return row_of(drawn, own, truth, verdict, error, asked)


def _own_run(drawn: RandomScene) -> OwnRun:
    try:
        scene = build_scene(drawn.config)
    except Exception as error:  # what a user sees instead of a scene, whatever it is
        return OwnRun(None, failure=f"{type(error).__name__}: {error}")
    choice = scene.timestep
    cost = step_cost(scene.model.nv, choice.integrator) * choice.substeps * len(drawn.controls)
    if cost > _DEAREST:
        return OwnRun(scene)
    simulation = Simulation(scene)
    begin = perf_counter()
    tips, failure = _advance(simulation, start_posture(scene, drawn), drawn.controls)
    wall_time = perf_counter() - begin
    estimate = simulation.integration_error
    return OwnRun(scene, None, tips, failure, wall_time, estimate)


def _advance(
    simulation: Simulation, posture: np.ndarray, controls: np.ndarray
) -> tuple[np.ndarray | None, str | None]:
    """Tips, or why there are none."""
    simulation.reset(posture, controls[0])
    tip = simulation.data.site("tip").xpos
    tips = [tip.copy()]
    for row in controls:
        simulation.ctrl[:] = row
        if not simulation.advance():
            return None, simulation.failure()
        tips.append(tip.copy())
    return np.array(tips), None


def _truth(drawn: RandomScene, own: OwnRun) -> Refined:
    """Refined runs, as fine as it takes to judge the own one."""
    if own.scene is None or (own.tips is None and own.failure is None):
        return Refined(None, None, 0, "none")

    def enough(tips: np.ndarray, uncertainty: float) -> bool:
        error = 0.0 if own.tips is None else distance(own.tips, tips)
        return uncertainty <= max(_CLEAR * drawn.config.wanted_accuracy, _CLEARLY_WRONG * error)

    truth = refine(neutral_scene(drawn.config), drawn, enough)
    clear = truth.tips is not None and enough(truth.tips, truth.uncertainty)
    return truth if clear else replace(truth, tips=None)
