"""A fast motion of the arm with known accuracy: all three tendon pairs pull harder at once."""

import numpy as np
from numpy import ndarray

from softrobot_env.beams.model import State
from softrobot_env.robots import ARM, RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.scene.config import TipSensors
from softrobot_env.scene.statics import equilibrium
from softrobot_env.tasks import equal_input
from studies.accuracy.cases import BeamMotion, ChainMotion, Contestant
from studies.beams import chain_scene

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


#: Joints and longest timestep [s] of the chain's limit, full and quick.
LIMIT = ((12, 24, 48), 2e-4), ((6, 12, 24), 4e-4)
