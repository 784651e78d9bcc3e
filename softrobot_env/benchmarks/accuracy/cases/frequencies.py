"""First bending and torsional frequencies, and the twist under a moment, against closed forms."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from softrobot_env.benchmarks.accuracy.cases.beam_models import Contestant
from softrobot_env.benchmarks.accuracy.rows import Physics, Row
from softrobot_env.benchmarks.beams import chain_scene, mode_frequency, tip_twist, weightless
from softrobot_env.benchmarks.timing import best_of
from softrobot_env.robots import CANTILEVER_STIFF, CANTILEVER_WEAK, RobotParams
from softrobot_env.robots.loads import Load
from softrobot_env.scene.chain import joint_angles
from softrobot_env.scene.statics import equilibrium
from softrobot_env.scene.timestep import linearize
from studies.truths.analytic import rayleigh_frequency
from studies.truths.shearable_rod import (
    bending_frequency,
    torsion_angle,
    torsion_frequency,
)

MOMENT = 0.01  # N m

_MOMENT_LOAD = Load("load", CANTILEVER_WEAK.length, moment=(0.0, 0.0, MOMENT))


@dataclass(frozen=True)
class ScalarCase:
    """A number with a closed form.

    Attributes:
        name: Name in the report.
        robot: The robot, without gravity.
        truth: The number, and where it comes from.
        torsion: Whether the robot twists, else it bends.
        static: Whether the number is the tip's twist [rad], else a frequency [Hz].
    """

    name: str
    robot: RobotParams
    truth: Callable[[Physics], tuple[float, str]]
    torsion: bool
    static: bool


def scalar_cases() -> list[ScalarCase]:
    """All cases whose result is a number."""
    weak, stiff = weightless(CANTILEVER_WEAK), weightless(CANTILEVER_STIFF)
    analytic = "analytic torsion"
    return [
        ScalarCase("bending_frequency_weak", weak, _bending(weak), False, False),
        ScalarCase("bending_frequency_stiff", stiff, _bending(stiff), False, False),
        ScalarCase(
            "torsion_static", weak, lambda _: (torsion_angle(weak, MOMENT), analytic), True, True
        ),
        ScalarCase(
            "torsion_frequency", weak, lambda _: (torsion_frequency(weak), analytic), True, False
        ),
    ]


def _bending(robot: RobotParams) -> Callable[[Physics], tuple[float, str]]:
    def truth(physics: Physics) -> tuple[float, str]:
        k = physics.shear_coefficient
        if k is not None:
            return bending_frequency(robot, k), f"Timoshenko beam, k = {k:g} (analytic)"
        beam = robot.length, robot.bending_stiffness, robot.mass_per_length
        rotary = robot.density * robot.second_moment
        return rayleigh_frequency(*beam, rotary), "Rayleigh beam (analytic)"

    return truth


def beam_row(case: ScalarCase, contestant: Contestant, n: int, repeats: int = 1) -> Row:
    """Compare a beam model."""
    space = "torsion" if case.torsion else "planar"
    loads = (_MOMENT_LOAD,) if case.static else ()
    model = contestant.build(case.robot, n, loads, space)
    if case.static:
        one = np.ones(1)
        time, q = best_of(lambda: model.equilibrium(one, check_stability=False), repeats)
        found = tip_twist(model, q)
    else:
        time, found = best_of(lambda: mode_frequency(model, case.torsion), repeats)
    return _row(case, contestant.name, contestant.physics, n, time, found)


def chain_row(case: ScalarCase, rule: str, n: int, physics: Physics, repeats: int = 1) -> Row:
    """Compare the MuJoCo chain."""
    options = {"bending": "spatial" if case.torsion else "planar", "torsion": case.torsion}
    loads = (_MOMENT_LOAD,) if case.static else ()
    model = chain_scene(case.robot, rule, n, loads=loads, **options).model
    if case.static:
        time, q = best_of(lambda: equilibrium(model, np.ones(1)), repeats)
        found = float(joint_angles(model, q)[:, 2].sum())
    else:
        time, found = best_of(lambda: _chain_frequency(model, case.torsion), repeats)
    return _row(case, f"mujoco_chain/{rule}", physics, n, time, found)


def _chain_frequency(model: mujoco.MjModel, torsion: bool) -> float:
    chain = linearize(model)
    if not torsion:
        return float(chain.frequencies()[0] / (2 * np.pi))
    # In the straight pose torsion is decoupled: the third coordinate of each ball joint.
    mass, stiffness = (m[2::3, 2::3] for m in (chain.mass, chain.stiffness))
    squares = np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real
    return float(np.sqrt(squares.min()) / (2 * np.pi))


def _row(case: ScalarCase, model: str, physics: Physics, n: int, time: float, found: float) -> Row:
    truth, text = case.truth(physics)
    return Row(
        "number",
        case.name,
        model,
        n,
        e_relative=abs(found / truth - 1),
        value=found,
        wall_time=time,
        physics=physics.name,
        reference=text,
    )
