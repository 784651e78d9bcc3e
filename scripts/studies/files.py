"""Random robot files that say no `pieces`: their chains at rest against four times the pieces.

The package chooses the pieces by an estimate of the error at inputs of its own. Here inputs are
drawn, up to full scale, and the error is measured: is any beyond the accuracy without a word?
"""

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.robots.actuation import robot_inputs, with_balance
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.chain import joint_angles, posture_like
from softrobot_env.scene.registry import scene_of
from softrobot_env.scene.resolution import remarks
from softrobot_env.scene.statics import equilibrium
from studies.files_drawn import drawn_robot
from studies.lab import Column, Record, Study, pivot, quantity, table

#: Files of a run and of a quick one, and inputs that each is judged by.
COUNT, QUICK_COUNT, INPUTS = 200, 4, 3

#: Times the pieces that a chain is judged by.
FINER = 4

#: What becomes of a file: as accurate as asked for, or warned about, or refused; or none of these.
VERDICTS = ("accurate", "warned", "refused", "silent")


@dataclass(frozen=True)
class Row(Record):
    """A file.

    Attributes:
        seed, index: What it was drawn from, see `files_drawn`.
        verdict: One of `VERDICTS`.
        why: Why it was refused, or what was warned of; None otherwise.
        sections, tendons: Numbers.
        tapered, winding: Whether a section tapers, and whether a tendon winds.
        actuation: "tension" or "length".
        own, pieces: Of the robot as the file is read, and of its chain.
        joints: Degrees of freedom.
        judged: Number of inputs with an equilibrium that folds no section.
        error_share: Largest distance of ends of pieces from those of the finer chain, over the
            length [1]; None if nothing is judged, or the finer chain is too light for MuJoCo.
        estimate_share: The package's own estimate, over the length [1]; None if infinite.
        left_out_share: What stretch and shear would change, over the length [1].
        time: [s] of the processor to build the scene, its pieces chosen.
    """

    seed: int
    index: int = quantity("", "d", "no.")
    verdict: str
    why: str | None = None
    sections: int | None = quantity("", "d", default=None)
    tendons: int | None = quantity("", "d", default=None)
    tapered: bool | None = None
    winding: bool | None = None
    actuation: str | None = None
    own: int | None = quantity("", "d", "own pieces", default=None)
    pieces: int | None = quantity("", "d", default=None)
    joints: int | None = quantity("", "d", default=None)
    judged: int | None = quantity("", "d", default=None)
    error_share: float | None = quantity("%", ".2g", "error", default=None)
    estimate_share: float | None = quantity("%", ".2g", "estimate", default=None)
    left_out_share: float | None = quantity("%", ".2g", "stretch, shear", default=None)
    time: float | None = quantity("s", ".2g", "time", default=None)


def cases(quick: bool, count: int | None = None, seed: int = 0) -> Iterator[tuple[int, int]]:
    """Seeds and indices of the files of a run."""
    count = count or (QUICK_COUNT if quick else COUNT)
    return ((seed, index) for index in range(count))


def measure(case: tuple[int, int]) -> list[Row]:
    """Judge a file."""
    seed, index = case
    begin = process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # `remarks` tells what they say
            scene = build_scene(scene_of(drawn_robot(seed, index)))
            found = scene.discretization
    except ValueError as error:
        return [Row(seed, index, "refused", str(error))]
    time, robot, length = process_time() - begin, scene.config.robot, scene.config.robot.length
    judged, error = _judged(scene, np.random.default_rng([seed, index, 1]))
    why = "; ".join(remarks(scene.config, found)) or None
    good = error is None or error <= scene.config.wanted_accuracy
    row = Row(
        seed,
        index,
        "warned" if why else "accurate" if good else "silent",
        why,
        sections=len(robot.backbone.sections),
        tendons=len(robot.tendons),
        tapered=bool(robot.backbone.tapers(scene.layout.stations).any()),
        winding=robot.twists,
        actuation=scene.config.actuation,
        own=robot.pieces,
        pieces=scene.layout.pieces,
        joints=scene.model.nv,
        judged=judged,
        error_share=_share(error, length),
        estimate_share=_share(found.error, length),
        left_out_share=_share(found.left_out, length),
        time=time,
    )
    return [row]


def _share(distance: float | None, length: float) -> float | None:
    return None if distance is None or not np.isfinite(distance) else distance / length


def _judged(scene: Scene, rng: np.random.Generator) -> tuple[int, float | None]:
    """Number of inputs at which a scene is judged, and its largest error [m].

    Infinite where the finer chain has no equilibrium near.
    """
    config = scene.config
    try:
        finer = build_scene(replace(config, pieces=FINER * scene.layout.pieces))
    except ValueError:
        return 0, None
    errors = []
    for controls in _inputs(scene, rng):
        try:
            q = scene.equilibrium(controls)
        except EquilibriumError:
            continue
        if _folds(scene, q):
            continue
        try:
            guess = posture_like(finer, scene, q)
            fine = equilibrium(finer.model, controls, guess, nearby=True)
            places = (x.positions(p, config.edges[1:]) for x, p in ((scene, q), (finer, fine)))
            errors.append(float(np.linalg.norm(np.subtract(*places), axis=1).max()))
        except EquilibriumError:
            errors.append(np.inf)
    return len(errors), max(errors, default=None)


def _inputs(scene: Scene, rng: np.random.Generator) -> Iterator[ndarray]:
    """Controls (nu,): some all over the robot's range, the last at full scale."""
    inputs = robot_inputs(with_balance(scene.config.robot))
    low, high = scene.model.actuator_ctrlrange.T
    for k in range(INPUTS):
        action = rng.uniform(-1, 1, inputs.n_inputs)
        action = np.sign(action) if k == INPUTS - 1 else action
        yield inputs.command(inputs.from_actions(action)).clip(low, high)


def _folds(scene: Scene, q: ndarray) -> bool:
    """Whether a section bends to more than the inverse of its radius."""
    bends = np.hypot.reduce(joint_angles(scene.model, q)[:, :2], axis=1) / scene.layout.weights
    radius = scene.config.robot.backbone.outer_radius(scene.layout.stations)
    return bool(np.any(bends * radius > 1))


def _largest(name: str, factor: float = 1.0) -> Any:
    """Function of rows: the largest of a field, times a factor, as text."""

    def largest(rows: list[Row]) -> str:
        values = [getattr(row, name) for row in rows if getattr(row, name) is not None]
        return f"{factor * max(values):.2g}" if values else "-"

    return largest


STUDY = Study(
    kinds=(Row,),
    cases=cases,
    measure=measure,
    label=lambda case: f"file {case[1]}",
    tables=[
        pivot(
            f"Random robot files, judged by chains of {FINER} times the pieces",
            ("verdict",),
            {
                "files": len,
                "largest error %": _largest("error_share", 100),
                "estimate %": _largest("estimate_share", 100),
                "time s": _largest("time"),
            },
        ),
        table(
            "Files",
            "index",
            "verdict",
            "own",
            "pieces",
            "error_share",
            "estimate_share",
            Column("why", "why"),
            where=lambda row: row.verdict != "accurate",
        ),
    ],
    note="error, estimate: over the length; warned: told that the estimate is beyond the accuracy, "
    "or that the robot has no equilibrium at full scale; time: of the processor",
    options=("count", "seed"),
)
