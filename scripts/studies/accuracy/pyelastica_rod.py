"""The spiral computed with PyElastica, where it is installed, and with our rods beside it.

PyElastica's dissipation acts on velocities, ours on strain rates, so both run without damping.
Its shear coefficient is set to ours, and its errors and those of our Cosserat rod are taken to the
limit of that rod. The MuJoCo chain, which does not shear, is compared with the limit of its own
physics, that of the PCC model.
Two differences stay: PyElastica keeps the volume of a stretched element (its section shrinks), and
it clamps the director of the first element, half an element from the base: its distance from that
limit falls with 1 / n only.
"""

from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from math import cos, sin
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.evaluation.models.runs import best_of, distance
from softrobot_env.robots import RobotParams
from studies.accuracy import cases, spiral

CASE = "spiral_undamped"
NAME = "pyelastica"
CHAIN = "mujoco_chain/gauss2"

ROBOT = replace(spiral.ROBOT, damping_time=0.0)

#: Share of the linear stability limit up to which the chain is stable (benchmark stability).
_STABLE = 0.9

#: Elements and timesteps [s] of PyElastica, near its stability limit.
_RUNS = ((7, 1e-3), (14, 5e-4), (28, 2e-4), (56, 5e-5))


def build(robot: RobotParams, n: int) -> tuple[Any, Any]:
    """PyElastica's simulator and rod with n elements, clamped, under the spiral's force."""
    import elastica

    class Simulator(
        elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.CallBacks
    ):
        """What the case needs of PyElastica."""

    class TipForce(elastica.NoForces):
        """The force (2.79) on the last node."""

        def apply_forces(self, system: Any, time: float = 0.0) -> None:
            """Add the force at a time [s]; scalars, which cost less than arrays here."""
            size, angle = spiral.FORCE * time / cases.DURATION, spiral.RATE * time
            system.external_forces[0, -1] += size * sin(angle)
            system.external_forces[1, -1] += size * cos(angle)

    shear_modulus = robot.youngs_modulus / (2 * (1 + robot.poisson_ratio))
    place = np.zeros(3), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    sizes = robot.length, robot.outer_radius, robot.density
    moduli = {"youngs_modulus": robot.youngs_modulus, "shear_modulus": shear_modulus}
    rod = elastica.CosseratRod.straight_rod(n, *place, *sizes, **moduli)
    rod.shear_matrix[[0, 1], [0, 1]] = cases.SHEAR.shear_coefficient * shear_modulus * robot.area
    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(
        elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    simulator.add_forcing_to(rod).using(TipForce)
    simulator.finalize()
    return simulator, rod


def motion(n: int, timestep: float, duration: float = cases.DURATION) -> Callable[[], ndarray]:
    """A function that simulates the spiral in PyElastica, once, and returns the tips (k, 3) [m]."""
    import elastica

    simulator, rod = build(ROBOT, n)

    def simulate() -> ndarray:
        stepper, time = elastica.PositionVerlet(), 0.0
        tips = [rod.position_collection[:, -1].copy()]
        for _ in range(round(duration / spiral.PERIOD)):
            for _ in range(round(spiral.PERIOD / timestep)):
                time = stepper.step(simulator, time, timestep)
            tips.append(rod.position_collection[:, -1].copy())
        return np.array(tips)

    return simulate


def rows(quick: bool = False, repeats: int = 2) -> list[cases.Row]:
    """PyElastica's runs and ours of the undamped spiral, one after the other."""
    if find_spec("elastica") is None:
        text = "PyElastica is not installed: its rows are left out (pip install pyelastica)"
        return [cases.Row("note", CASE, NAME, reference=text)]
    motion(7, 5e-4, 0.02)()  # compiles
    truth = cases.beam_limit(spiral.beam_motion, cases.COSSERAT, (8, 16, 32), ROBOT)
    found = []
    for n, timestep in _RUNS[:2] if quick else _RUNS:
        runs = [best_of(motion(n, timestep), 1) for _ in range(repeats)]
        wall_time, tips = min(run[0] for run in runs), runs[0][1]
        if not np.all(np.isfinite(tips)):
            text = f"left out: diverged at a timestep of {timestep:g} s"
            found.append(cases.Row("note", CASE, NAME, n, reference=text))
            continue
        settings = cases.Settings(NAME, n, timestep, "PositionVerlet")
        found.append(cases.motion_row(CASE, cases.SHEAR, truth, settings, tips, wall_time))
        finest = distance(tips, truth.tips), n
    for n in (3, 7, 14) if quick else (3, 5, 7, 14, 28):
        rod = spiral.beam_motion(cases.COSSERAT, n, ROBOT)
        for tolerance in (1e-2, 1e-3, 1e-4, 1e-5):
            rod.tolerance = tolerance
            found.append(cases.timed_row(CASE, cases.SHEAR, truth, rod, repeats))
    found += _chain_rows(quick, repeats)
    gap, n = finest
    share = gap / ROBOT.length
    pair = f"{NAME} {n} / cosserat (its error)"
    found.append(cases.Row("physics", CASE, pair, n, e_max=gap, value=share, reference=truth.text))
    return found


def _chain_rows(quick: bool, repeats: int) -> list[cases.Row]:
    """The MuJoCo chain at timesteps within its stability limit."""
    sizes = (3, 6, 12) if quick else (5, 10, 20)
    truth = cases.beam_limit(spiral.beam_motion, cases.DISTRIBUTED, sizes, ROBOT)
    out = []
    for n in (2, 4) if quick else (2, 4, 6, 12, 24):
        for substeps in (2, 3, 4, 5, 8, 10, 20):
            timestep = spiral.PERIOD / substeps
            motion = spiral.chain_motion("gauss2", n, timestep, robot=ROBOT)
            choice = motion.scene.timestep
            if choice.timestep <= _STABLE * choice.stability_limit:
                out.append(cases.timed_row(CASE, cases.BENDING, truth, motion, repeats))
    return out
