"""The spiral computed with PyElastica, where it is installed, and with our rods beside it.

PyElastica's dissipation acts on velocities, ours on strain rates, so both run without damping.
Its shear coefficient is set to ours. Two differences stay: it keeps the volume of a stretched
element (its sections shrink), and it clamps the director of the first element, half an element
from the base, which costs it an order of convergence. Hence its error is taken to its own limit.
"""

from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from time import perf_counter
from typing import Any

import numpy as np

from softrobot_env.benchmarks import spiral
from softrobot_env.benchmarks.accuracy_rows import (
    SHEAR,
    Limit,
    Row,
    distance,
    least_time,
    make_row,
)
from softrobot_env.benchmarks.beam_models import COSSERAT, Contestant
from softrobot_env.robots import RobotParams

CASE = "spiral_undamped"
NAME = "pyelastica"

ROBOT = replace(spiral.ROBOT, damping_time=0.0)

#: Elements and timesteps [s] of PyElastica, near its stability limit.
_RUNS = ((7, 1e-3), (14, 5e-4), (28, 2.5e-4), (56, 1e-4))
_QUICK_RUNS = _RUNS[:2]

_LIMIT_SIZES, _QUICK_SIZES = (14, 28, 56), (7, 14, 28)
_LIMIT_STEPS = {7: 2.5e-4, 14: 2e-4, 28: 1e-4, 56: 5e-5}  # s


def installed() -> bool:
    """Whether PyElastica can be imported."""
    return find_spec("elastica") is not None


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
            """Add the force at a time [s]."""
            system.external_forces[:2, -1] += spiral.force(float(time))

    shear_modulus = robot.youngs_modulus / (2 * (1 + robot.poisson_ratio))
    rod = elastica.CosseratRod.straight_rod(
        n,
        np.zeros(3),
        np.array([0.0, 0.0, 1.0]),
        np.array([1.0, 0.0, 0.0]),
        robot.length,
        robot.outer_radius,
        robot.density,
        youngs_modulus=robot.youngs_modulus,
        shear_modulus=shear_modulus,
    )
    rod.shear_matrix[[0, 1], [0, 1]] = SHEAR.shear_coefficient * shear_modulus * robot.area
    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(
        elastica.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    simulator.add_forcing_to(rod).using(TipForce)
    simulator.finalize()
    return simulator, rod


def motion(n: int, timestep: float, duration: float = spiral.DURATION) -> Callable[[], np.ndarray]:
    """A function that simulates the spiral in PyElastica and returns the tips (k, 3) [m]."""
    import elastica

    def simulate() -> np.ndarray:
        simulator, rod = build(ROBOT, n)
        stepper, time = elastica.PositionVerlet(), 0.0
        tips = [rod.position_collection[:, -1].copy()]
        for _ in range(round(duration / spiral.PERIOD)):
            for _ in range(round(spiral.PERIOD / timestep)):
                time = stepper.step(simulator, time, timestep)
            tips.append(rod.position_collection[:, -1].copy())
        return np.array(tips)

    return simulate


def limit(quick: bool = False) -> Limit:
    """PyElastica's spiral with infinitely many elements, for an error series in 1 / n."""
    sizes = _QUICK_SIZES if quick else _LIMIT_SIZES
    a, b, c = (motion(n, _LIMIT_STEPS[n])() for n in sizes)
    first, second = 2 * b - a, 2 * c - b
    best = second + (second - first) / 3
    uncertainty = distance(best, second)
    text = f"limit of {NAME}, n = {', '.join(map(str, sizes))}"
    return Limit(best, uncertainty, f"{text}; uncertainty {1e3 * uncertainty:.1g} mm")


def rows(quick: bool = False, repeats: int = 3) -> list[Row]:
    """PyElastica's runs and ours of the undamped spiral, one after the other."""
    if not installed():
        text = "PyElastica is not installed: its rows are left out (pip install pyelastica)"
        return [make_row("note", CASE, NAME, reference=text)]
    motion(7, 5e-4, 0.02)()  # compiles
    own = limit(quick)
    found = []
    for n, timestep in _QUICK_RUNS if quick else _RUNS:
        begin = perf_counter()
        tips = motion(n, timestep)()
        wall_time = perf_counter() - begin
        found.append(_row(NAME, n, own, tips, wall_time, round(spiral.DURATION / timestep)))
        found[-1] |= {"integrator": "PositionVerlet"}
    truth = spiral.beam_limit(COSSERAT, (8, 16, 32), ROBOT)
    for n in (3, 7, 14) if quick else (3, 5, 7, 14, 28):
        found += _our_rows(COSSERAT, n, truth, repeats)
    gap = distance(own.tips, truth.tips)
    found.append(
        make_row(
            "agreement",
            CASE,
            f"{NAME} / cosserat",
            e_max=gap,
            value=gap / ROBOT.length,
            limit=1e-3,
            met=gap < 1e-3 * ROBOT.length,
            physics=SHEAR.name,
            reference=f"{own.text}; {truth.text}",
        )
    )
    return found


def _our_rows(contestant: Contestant, n: int, truth: Limit, repeats: int) -> list[Row]:
    model = contestant.build(ROBOT, n, spiral.loads(ROBOT), "spatial")
    out = []
    for tolerance in (1e-2, 1e-3, 1e-4, 1e-5):
        simulate, steps = spiral.beam_motion(model, "sdirk4", tolerance=tolerance)
        wall_time, tips = least_time(simulate, repeats)
        out.append(_row(contestant.name, n, truth, tips, wall_time, steps()))
        out[-1] |= {"integrator": "sdirk4", "tolerance": tolerance}
    return out


def _row(model: str, n: int, truth: Limit, tips: np.ndarray, wall_time: float, steps: int) -> Row:
    error = np.linalg.norm(tips - truth.tips, axis=1)
    return make_row(
        "dynamic",
        CASE,
        model,
        n,
        timestep=spiral.DURATION / steps,
        e_mean=float(error.mean()),
        e_max=float(error.max()),
        wall_time=wall_time,
        step_time=wall_time / steps,
        physics=SHEAR.name,
        reference=truth.text,
    )
