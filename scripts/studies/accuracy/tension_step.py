"""A fast motion of the arm with known accuracy: all three tendon pairs pull harder at once."""

import numpy as np
from numpy import ndarray

from softrobot_env.beams.model import State
from softrobot_env.evaluation.models.runs import Limit, converged, distance
from softrobot_env.robots import ARM, RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.scene.config import TipSensors
from softrobot_env.scene.statics import equilibrium
from softrobot_env.tasks import equal_input
from studies.accuracy.cases import BeamMotion, ChainMotion, Contestant
from studies.beams import chain_scene, zero_timestep

CASE, ROBOT = "tension_step", ARM

#: [s]; the tip is compared at the end of every control period.
PERIOD = 0.01

#: Equal reduced inputs before and after, in units of EI / r: the 100 mm step of the thesis.
START, END = 0.6, 0.933


def tensions(robot: RobotParams, a: float) -> ndarray:
    """Tensions (n_tendons,) [N] of equal reduced inputs a EI / r."""
    return TendonMap(robot).tension(np.array(equal_input(robot, a)))


def chain_motion(
    rule: str, n: int, timestep: float, integrator: str = "implicitfast", robot: RobotParams = ARM
) -> ChainMotion:
    """The step of the MuJoCo chain with n joints, with tips (300, 2) in (x, z)."""
    steps = {"control_period": PERIOD, "timestep": timestep, "integrator": integrator}
    scene = chain_scene(robot, rule, n, sensors=(TipSensors(),), **steps)
    posture, pulled = equilibrium(scene.model, tensions(robot, START)), tensions(robot, END)
    return ChainMotion(scene, lambda times: np.tile(pulled, (len(times), 1)), posture, _compared)


def beam_motion(contestant: Contestant, n: int, robot: RobotParams = ARM) -> BeamMotion:
    """The step of a beam model, with tips (300, 2) in (x, z)."""
    beam = contestant.build(robot, n)
    q = beam.equilibrium(tensions(robot, START), load_steps=5, check_stability=False)
    rest, inputs = State(q, np.zeros_like(q)), tensions(robot, END)

    def tips(q: ndarray) -> ndarray:
        return _compared(beam.tip(q))

    return BeamMotion(contestant.name, n, beam, inputs, tips, PERIOD, rest)


def _compared(tips: ndarray) -> ndarray:
    """Tips (k, 2) [m] in (x, z) at the ends of the control periods."""
    return tips[1:, [0, 2]]


def chain_limit(quick: bool = False) -> Limit:
    """Extrapolate the motion to zero timestep and infinitely many hinges.

    Timesteps h, h/2, h/4 remove the orders h and h^2 of implicitfast; numbers of hinges n and 2n
    remove the order 1/n^2. The distance to the same with another hinge rule and timesteps twice
    as large is the uncertainty; it belongs to the worse of the two, so it is on the safe side.
    """
    n, step = (12, 4e-4) if quick else (24, 2e-4)
    tips, other = _extrapolate("gauss2", n, step), _extrapolate("balanced2", n, 2 * step)
    uncertainty = distance(tips, other)
    text = (
        f"Richardson extrapolation of gauss2 with {n} and {2 * n} hinges, timesteps "
        f"{1e3 * step:g} to {250 * step:g} ms; uncertainty {1e3 * uncertainty:.1g} mm (balanced2, "
        "timesteps twice as large)"
    )
    return Limit(tips, uncertainty, text)


def _extrapolate(rule: str, n: int, step: float) -> ndarray:
    found = {}
    for hinges in (n, 2 * n):
        motions = [chain_motion(rule, hinges, step / k)() for k in (1, 2, 4)]
        found[hinges], _ = zero_timestep(motions)
    return converged(found, 2)
