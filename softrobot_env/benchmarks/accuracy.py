"""Tip error of the MuJoCo chain against independent beam models, with the time it costs.

Static cases compare equilibria with closed forms and elastica solutions; the dynamic case compares
a fast step of the arm with a converged solution. Every row says what it was compared with.
"""

from collections.abc import Callable, Iterator
from typing import Any

import mujoco
import numpy as np

from softrobot_env.benchmarks.static_cases import StaticCase, static_cases
from softrobot_env.benchmarks.tension_step import (
    DURATION,
    Reference,
    converged_reference,
    start,
    tip_motion,
)
from softrobot_env.benchmarks.timing import best_of, step_cost
from softrobot_env.robots import ARM, RobotParams
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.quadrature import RULES
from softrobot_env.scene.statics import equilibrium

Row = dict[str, Any]
Progress = Callable[[str, int, int], None]

#: Numbers of hinges, coarse to fine; a quick run stops after the second.
HINGES = (6, 12, 24, 48)

#: The arm's tendons end at thirds of its length, where pieces of three hinges must end too.
HINGES_OF_THIRDS = (9, 18, 36)

#: Timesteps [s] and integrators of the dynamic case.
TIMESTEPS = (1e-3, 2e-3, 5e-3, 1e-2)
DYNAMIC_INTEGRATORS = ("implicitfast", "discrete")

DYNAMIC_CASE = "tension_step"

_Job = tuple[str, Callable[[], list[Row]]]


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Measure all cases, rules and resolutions.

    Args:
        quick: Only the two coarsest chains, and a coarser dynamic reference.
        progress: Called with (description, done, total), or None.

    Returns:
        Rows with case, model, n (hinges), timestep [s], integrator, e_mean, e_max [m],
        wall_time [s], step_time [s] per `mj_step`, reference. For a static case both errors are
        the distance of the tips and wall_time is that of the equilibrium solve; for the dynamic
        case they are mean and maximum over the motion, and wall_time is that of all its steps, at
        the best step_time of any chain with as many hinges.
    """
    jobs = [*_static_jobs(quick), *_dynamic_jobs(quick)]
    rows = []
    for done, (description, job) in enumerate(jobs):
        if progress is not None:
            progress(description, done, len(jobs))
        rows += job()
    if progress is not None:
        progress("done", len(jobs), len(jobs))
    _share_step_times(rows)
    return rows


def _share_step_times(rows: list[Row]) -> None:
    """Give motions of equal cost the same time.

    A step costs the same whatever the rule and the timestep, so its best time over all runs with
    as many hinges and the same integrator is the truth; single runs differ by the machine's noise.
    """
    moving = [row for row in rows if row["case"] == DYNAMIC_CASE]
    for row in moving:
        alike = [r for r in moving if (r["n"], r["integrator"]) == (row["n"], row["integrator"])]
        row["step_time"] = min(r["step_time"] for r in alike)
        row["wall_time"] = row["step_time"] * DURATION / row["timestep"]


def hinge_numbers(robot: RobotParams, rule: str, quick: bool = False) -> tuple[int, ...]:
    """Numbers of hinges of a rule on a robot: tendons must end between pieces."""
    thirds = len(RULES[rule]) == 3 and bool(robot.tendons)
    numbers = HINGES_OF_THIRDS if thirds else HINGES
    return numbers[:2] if quick else numbers


def rule_of(row: Row) -> str:
    """Hinge rule of a row."""
    return row["model"].split("/")[1]


def _static_jobs(quick: bool) -> Iterator[_Job]:
    repeats = 2 if quick else 5
    for case in static_cases():
        for rule in RULES:
            yield (
                f"{case.name} {rule}",
                lambda c=case, r=rule: [
                    static_row(c, r, n, repeats) for n in hinge_numbers(c.robot, r, quick)
                ],
            )


def _dynamic_jobs(quick: bool) -> Iterator[_Job]:
    reference: list[Reference] = []
    repeats = 3 if quick else 5

    def compute_reference() -> list[Row]:
        reference.append(converged_reference(quick))
        return []

    yield "tension_step reference", compute_reference
    for rule in RULES:
        for n in hinge_numbers(ARM, rule, quick):
            yield (
                f"tension_step {rule} {n}",
                lambda r=rule, n=n: _dynamic_rows(r, n, reference[0], repeats),
            )


def _dynamic_rows(rule: str, n: int, reference: Reference, repeats: int) -> list[Row]:
    return [
        dynamic_row(rule, n, timestep, integrator, reference, repeats)
        for integrator in DYNAMIC_INTEGRATORS
        for timestep in TIMESTEPS
    ]


def static_row(case: StaticCase, rule: str, n: int, repeats: int = 1) -> Row:
    """Solve one static case on a chain of n hinges; times are the best of `repeats`."""
    scene = build_scene(_config(case.robot, rule, n, loads=case.loads))
    wall_time, posture = best_of(lambda: equilibrium(scene.model, case.ctrl), repeats)
    error = float(np.linalg.norm(tip_at(scene.model, posture) - case.tip))
    step_time = step_cost(scene.model, posture, case.ctrl, repeats)
    return _row(case.name, rule, scene, (error, error), wall_time, step_time, case.reference)


def dynamic_row(
    rule: str, n: int, timestep: float, integrator: str, reference: Reference, repeats: int = 1
) -> Row:
    """Simulate the tension step and compare it; the time is the best of `repeats`."""
    scene = build_scene(_config(ARM, rule, n, timestep=timestep, integrator=integrator))
    error = np.linalg.norm(tip_motion(scene) - reference.tips, axis=1)
    wall_time = min(_stepping_time(scene) for _ in range(repeats))
    step_time = wall_time * scene.timestep.timestep / DURATION
    errors = float(error.mean()), float(error.max())
    return _row(DYNAMIC_CASE, rule, scene, errors, wall_time, step_time, reference.text)


def _config(robot: RobotParams, rule: str, n: int, **options: Any) -> SceneConfig:
    return SceneConfig(robot, pieces=n // len(RULES[rule]), rule=rule, **options)


def tip_at(model: mujoco.MjModel, posture: np.ndarray) -> np.ndarray:
    """Tip (2,) [m] in (x, z) of the chain in a posture (nq,) [rad]."""
    data = mujoco.MjData(model)
    data.qpos[:] = posture
    mujoco.mj_kinematics(model, data)
    return data.site("tip").xpos[[0, 2]].copy()


def _stepping_time(scene: Scene) -> float:
    """Time [s] of all steps of the tension step, without reading anything out."""
    simulation = start(scene)
    steps = round(DURATION / scene.timestep.timestep)
    return best_of(lambda: mujoco.mj_step(scene.model, simulation.data, steps), 1)[0]


def _row(
    case: str,
    rule: str,
    scene: Scene,
    errors: tuple[float, float],
    wall_time: float,
    step_time: float,
    reference: str,
) -> Row:
    return {
        "case": case,
        "model": f"mujoco_chain/{rule}",
        "n": scene.model.nv,
        "timestep": scene.timestep.timestep,
        "integrator": scene.timestep.integrator,
        "e_mean": errors[0],
        "e_max": errors[1],
        "wall_time": wall_time,
        "step_time": step_time,
        "reference": reference,
    }
