"""The rows of the random scenes: what a scene is, and what became of it."""

from dataclasses import dataclass
from math import isfinite, pi
from typing import TYPE_CHECKING

import numpy as np

from softrobot_env.benchmarks.records import Record
from softrobot_env.benchmarks.scenes.draw import G, RandomScene, weight_load
from softrobot_env.benchmarks.scenes.refined import Refined
from softrobot_env.benchmarks.verdicts import Verdict

if TYPE_CHECKING:
    from softrobot_env.benchmarks.scenes.judge import OwnRun

#: An estimate is good if the error is within this factor of it.
GOOD_FACTOR = 3.0


@dataclass(frozen=True)
class Row(Record):
    """A scene.

    Attributes:
        seed, index: What it was drawn from, see `benchmarks.scenes.draw.draw_scene`.
        bending, torsion, actuation, pieces: See `SceneConfig`.
        joints: Degrees of freedom; None of a scene that was refused.
        length: [m].
        slenderness: Length over outer radius [1].
        youngs_modulus: [Pa].
        density: [kg/m3].
        damping_ratio: [1] of the first elastic mode.
        gravity: In units of that of the earth.
        weight_load: Rho A g L^3 / EI [1].
        tendons: Number.
        guided: Whether any runs through guides, not in a channel.
        friction, pretension: Largest of a tendon, over its tension limit [1].
        head: Its mass over the robot's [1], zero without.
        loaded: Whether a load acts on it.
        excitation: One of `benchmarks.scenes.draw.EXCITATIONS`.
        control_period, duration: [s].
        verdict: What became of it.
        why: What failed, or why it was not judged; None otherwise.
        refined_fine: Of a failure, whether refined runs end and agree.
        error: [m], largest distance of the tip from the truth.
        error_share: Over the length [1].
        asked_share: What was asked for, over the length [1].
        estimate_share: The package's own estimate of the error, over the length [1]; None if it
            gives none or knows no bound.
        warning: What a `TimestepWarning` said.
        integrator, timestep, substeps: Of the package's choice; timestep in s.
        wall_time: [s] of the package's run.
        reference: How the refined runs were made.
        uncertainty: [m], distance of the two best refined runs; None if one of them diverged.
    """

    seed: int
    index: int
    bending: str
    torsion: bool
    actuation: str
    pieces: int
    joints: int | None
    length: float
    slenderness: float
    youngs_modulus: float
    density: float
    damping_ratio: float
    gravity: float
    weight_load: float
    tendons: int
    guided: bool
    friction: float
    pretension: float
    head: float
    loaded: bool
    excitation: str
    control_period: float
    duration: float
    verdict: Verdict
    why: str | None
    refined_fine: bool | None
    error: float | None
    error_share: float | None
    asked_share: float
    estimate_share: float | None
    warning: str | None
    integrator: str | None
    timestep: float | None
    substeps: int | None
    wall_time: float | None
    reference: str | None
    uncertainty: float | None

    @property
    def estimate_is_good(self) -> bool | None:
        """Whether error and estimate are within a factor of `GOOD_FACTOR`; None without both."""
        if self.estimate_share is None or not self.error_share:
            return None
        ratio = self.estimate_share / self.error_share
        return bool(1 / GOOD_FACTOR <= ratio <= GOOD_FACTOR)


def row_of(
    drawn: RandomScene,
    own: "OwnRun",
    truth: Refined,
    verdict: Verdict,
    error: float | None,
    asked: float,
) -> Row:
    """The row of a judged scene; error and what was asked for in m."""
    length = drawn.config.robot.length
    judged = own.failure is None and error is not None
    estimate, uncertainty = (_bounded(x) for x in (own.estimate, truth.uncertainty))
    return Row(
        **_what_it_is(drawn),
        **_what_was_chosen(own),
        verdict=verdict,
        why=own.failure or (None if judged else _why_unjudged(truth, length)),
        refined_fine=None if own.failure is None or own.scene is None else truth.tips is not None,
        error=error,
        error_share=None if error is None else error / length,
        asked_share=asked / length,
        estimate_share=None if estimate is None else estimate / length,
        warning=own.warning,
        wall_time=own.wall_time,
        reference=f"{truth.method}, {truth.substeps} steps a period" if truth.substeps else None,
        uncertainty=uncertainty,
    )


def _bounded(value: float | None) -> float | None:
    return value if value is not None and isfinite(value) else None


def _what_it_is(drawn: RandomScene) -> dict[str, object]:
    config, robot = drawn.config, drawn.config.robot
    return {
        "seed": drawn.seed,
        "index": drawn.index,
        "bending": config.bending,
        "torsion": config.torsion,
        "actuation": config.actuation,
        "pieces": config.n_pieces,
        "length": robot.length,
        "slenderness": robot.length / robot.outer_radius,
        "youngs_modulus": robot.youngs_modulus,
        "density": robot.density,
        "damping_ratio": robot.damping_time * pi * robot.first_frequency,
        "gravity": float(np.linalg.norm(robot.gravity)) / G,
        "weight_load": weight_load(robot),
        "tendons": len(robot.tendons),
        "guided": any(tendon.guides for tendon in robot.tendons),
        "friction": max((t.friction / t.tension_limit for t in robot.tendons), default=0.0),
        "pretension": max((t.pretension / t.tension_limit for t in robot.tendons), default=0.0),
        "head": 0.0 if robot.head is None else robot.head.mass / robot.mass,
        "loaded": bool(config.loads),
        "excitation": drawn.excitation,
        "control_period": config.control_period,
        "duration": drawn.duration,
    }


def _what_was_chosen(own: "OwnRun") -> dict[str, object]:
    if own.scene is None:
        return dict.fromkeys(("joints", "integrator", "timestep", "substeps"))
    choice = own.scene.timestep
    return {
        "joints": own.scene.model.nv,
        "integrator": choice.integrator,
        "timestep": choice.timestep,
        "substeps": choice.substeps,
    }


def _why_unjudged(truth: Refined, length: float) -> str:
    if not truth.substeps:
        return "the scene's own steps are too many"
    if truth.uncertainty is None:
        return "too few refined runs ended within the budget"
    return f"refined runs differ by {100 * truth.uncertainty / length:.2g} % of the length"
