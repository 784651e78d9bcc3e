"""Which settings of a robot's chain run stably and accurately, and whether the others warn.

Stiffness, damping, number of pieces and drive amplitude of the robot are varied; each variant runs
with the integrator and timestep chosen by the package, and as `mj_step` would advance its compiled
model, by the rule of `scene.timestep`. The first ones also run with every setting that a user may
request. Every run is compared with refined ones of the same chain.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from time import process_time
from typing import Any

from mujoco import mjtIntegrator
from numpy import ndarray

from softrobot_env.core.interfaces import ProgressCallback, quiet
from softrobot_env.core.motion import IntegrationError
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import INTEGRATORS, SceneConfig
from softrobot_env.scene.registry import scene_of

from .runs import (
    Excitation,
    Limit,
    Simulated,
    Verdict,
    distance,
    excitation,
    silent_warnings,
    verdict_of,
    with_warning,
)

#: Length [s] of a motion, full and quick.
DURATIONS = (1.0, 0.3)

#: Factors of Young's modulus and of the damping time; integrators and timesteps [s]. Then the
#: values of a quick run.
MAP = (0.01, 0.1, 1.0, 10.0, 100.0), (0.0, 0.1, 1.0, 10.0)
ASKED = INTEGRATORS, (2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)
QUICK_MAP, QUICK_ASKED = ((0.1, 1.0, 10.0), (0.1, 1.0)), (INTEGRATORS[:3], (1e-3, 5e-3))

#: Factors of the robot's pieces, and shares of the drives' range.
PIECES, AMPLITUDES, AMPLITUDE = (0.5, 2.0, 4.0), (0.25, 1.0), 0.5

#: Accuracies of the refined runs over the requested one, and timesteps [s] if our own integrator
#: does not support the robot's friction. They are used as truth if they differ by less than these
#: shares of the requested accuracy, or of the error.
_FINER, _FINE_TIMESTEPS = (1 / 8, 1 / 32), (2e-4, 5e-5)
_TRUSTED, _CLEARLY_WRONG = 0.25, 0.1


@dataclass(frozen=True)
class StabilityRow:
    """A run.

    Attributes:
        case: "own" if the package chose integrator and timestep, "rule" if it did so for `mj_step`,
            "map" for all others.
        stiffness_scale, damping_scale: Factors of Young's modulus and of the damping time [1].
        pieces, amplitude: Of the chain, and the share of the drives' range [1].
        integrator, timestep: Its name, and its (longest) step [s].
        verdict: See `runs.Verdict`.
        why: The failure, the warning, or why the run could not be judged.
        error, share: [m], largest distance of the tip from the refined run, and over the length.
        asked: [m], the requested accuracy.
        uncertainty: [m], distance of two refined runs; None where one failed.
        cost: [s], processor time of a second of motion.
    """

    case: str
    stiffness_scale: float
    damping_scale: float
    pieces: int
    amplitude: float
    integrator: str | None
    timestep: float | None
    verdict: Verdict
    why: str | None
    error: float | None
    share: float | None
    asked: float
    uncertainty: float | None
    cost: float | None


@dataclass(frozen=True)
class Variation:
    """Differences from the robot itself; fields as in `StabilityRow`."""

    stiffness_scale: float = 1.0
    damping_scale: float = 1.0
    pieces: int | None = None
    amplitude: float = AMPLITUDE

    def scene(self, robot: RobotParams) -> SceneConfig:
        """The varied robot's scene; tensions are scaled with the stiffness."""
        if self.stiffness_scale != 1 or self.damping_scale != 1:
            scales = {"youngs_modulus": self.stiffness_scale, "damping_time": self.damping_scale}
            robot = robot.vary(**scales)
        if robot.drive.kind == "tension" and self.stiffness_scale != 1:
            limit = self.stiffness_scale
            tendons = (replace(t, tension_limit=limit * t.tension_limit) for t in robot.tendons)
            robot = replace(robot, tendons=tuple(tendons))
        return replace(scene_of(robot), pieces=self.pieces, sensors=())


def measure(
    robot: RobotParams, quick: bool = False, progress: ProgressCallback = quiet
) -> list[StabilityRow]:
    """Rows of the runs of a robot; arguments as in `accuracy.measure`."""
    mapped = [Variation(*scales) for scales in product(*(QUICK_MAP if quick else MAP))]
    pieces = dict.fromkeys(max(1, round(factor * robot.pieces)) for factor in PIECES)
    others = [Variation(pieces=n) for n in pieces] + [Variation(amplitude=a) for a in AMPLITUDES]
    asked = list(product(*(QUICK_ASKED if quick else ASKED)))
    rows: list[StabilityRow] = []
    for done, varied in enumerate((*mapped, *others)):
        progress(str(varied), done, len(mapped) + len(others))
        with silent_warnings():
            mine = asked if varied in mapped else []
            rows += _runs(robot, varied, mine, DURATIONS[quick])
    return rows


def _runs(
    robot: RobotParams,
    varied: Variation,
    asked: Iterable[tuple[str, float]],
    duration: float,
) -> Iterator[StabilityRow]:
    """Runs of a varied robot, all compared with the same refined ones."""
    config = varied.scene(robot)
    try:
        base = build_scene(replace(config, integrator="discrete", timestep=config.control_period))
    except ValueError as error:  # such as pieces that do not end where a tendon does
        yield _row(varied, config, failure=str(error))
        return
    moved = excitation(base, duration, varied.amplitude)
    truth, _ = with_warning(lambda: _truth(config, moved))
    rule, _ = with_warning(lambda: _rule(config))
    for integrator, timestep in ((None, None), (rule, None), *asked):
        if timestep is None or timestep <= config.control_period:
            yield _run(varied, replace(config, timestep=timestep), integrator, moved, truth)


def _rule(config: SceneConfig) -> str:
    """MuJoCo's integrator that the scene's compiled model has."""
    found = mjtIntegrator(build_scene(config).model.opt.integrator).name
    return next(name for name in INTEGRATORS if found.endswith(f"_{name.upper()}"))


def _truth(config: SceneConfig, moved: Excitation) -> Limit | None:
    """The finer of two refined runs, and their distance; None if one failed."""
    finer = [{"accuracy": share * config.wanted_accuracy} for share in _FINER]
    if config.robot.holds:
        finer = [{"integrator": "discrete", "timestep": h} for h in _FINE_TIMESTEPS]
    try:
        scenes = [build_scene(replace(config, **options)) for options in finer]
        coarse, fine = (Simulated(scene, config.robot).motion(moved) for scene in scenes)
    except IntegrationError:
        return None
    return Limit(fine, distance(coarse, fine), "refined run of the same chain")


def _run(
    varied: Variation,
    config: SceneConfig,
    integrator: str | None,
    moved: Excitation,
    truth: Limit | None,
) -> StabilityRow:
    """One run with a user's settings."""
    given = {"integrator": integrator, "timestep": config.timestep}
    try:
        config = replace(config, integrator=integrator)
        scene, unstable = with_warning(lambda: build_scene(config))
        given = {name: getattr(scene.timestep, name) for name in given}
        simulated = Simulated(scene, config.robot)
        start, begin = simulated.start(moved.rest), process_time()
        tips, inaccurate = with_warning(lambda: simulated.motion(moved, start))
    except (IntegrationError, ValueError) as error:
        return _row(varied, config, failure=str(error), truth=truth, **given)
    given["cost"] = (process_time() - begin) / moved.duration
    return _row(varied, config, tips=tips, truth=truth, warning=unstable or inaccurate, **given)


def _row(
    varied: Variation,
    config: SceneConfig,
    *,
    tips: ndarray | None = None,
    truth: Limit | None = None,
    failure: str | None = None,
    warning: str | None = None,
    **given: Any,
) -> StabilityRow:
    """The row of a run, with its verdict."""
    robot, asked, error = config.robot, config.wanted_accuracy, None
    if tips is not None and truth is not None:
        error = distance(tips, truth.tips)
        if truth.uncertainty > max(_TRUSTED * asked, _CLEARLY_WRONG * error):
            error = None
    verdict = verdict_of(error, asked, robot.length, failure=failure, warning=warning)
    why = failure or warning
    if verdict == Verdict.UNJUDGED:
        why = "refined runs failed, or differ too much"
    case = "map" if config.timestep else "rule" if config.integrator else "own"
    return StabilityRow(
        case=case,
        stiffness_scale=varied.stiffness_scale,
        damping_scale=varied.damping_scale,
        pieces=config.n_pieces,
        amplitude=varied.amplitude,
        verdict=verdict,
        why=why,
        error=error,
        share=None if error is None else error / robot.length,
        asked=asked,
        uncertainty=None if truth is None else truth.uncertainty,
        **{"integrator": None, "timestep": None, "cost": None} | given,
    )
