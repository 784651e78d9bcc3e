"""The spiral (2.79): a tip force that turns at 10 rad/s and grows to 20 N in 3 s."""

import warnings

import numpy as np
from numpy import ndarray

from softrobot_env.beams import signals
from softrobot_env.robots import CANTILEVER_STIFF, RobotParams
from softrobot_env.robots.loads import Load
from softrobot_env.scene.config import TipSensors
from studies.accuracy.cases import DURATION, BeamMotion, ChainMotion, Contestant
from studies.beams import chain_scene, weightless

CASE = "spiral"

#: [s] between compared instants.
PERIOD = 0.01

#: [N] at the end, and [rad/s].
FORCE, RATE = 20.0, 10.0

ROBOT = weightless(CANTILEVER_STIFF)


def force(t: float | ndarray) -> ndarray:
    """(..., 2) [N] in x and y at time t [s]."""
    t = np.asarray(t)
    size = (FORCE * t / DURATION)[..., None]
    return size * np.stack([np.sin(RATE * t), np.cos(RATE * t)], axis=-1)


def loads(robot: RobotParams = ROBOT) -> tuple[Load, Load]:
    """Unit forces on the tip, whose amplitudes are `force`."""
    tip = robot.length
    return Load("fx", tip, force=(1.0, 0.0, 0.0)), Load("fy", tip, force=(0.0, 1.0, 0.0))


def beam_motion(contestant: Contestant, n: int, robot: RobotParams = ROBOT) -> BeamMotion:
    """The spiral of a beam model, with tips (301, 3)."""
    beam = contestant.build(robot, n, loads(robot), "spatial")
    return BeamMotion(contestant.name, n, beam, signals.smooth(force, DURATION), beam.tip, PERIOD)


def chain_motion(
    rule: str, n: int, timestep: float, integrator: str = "implicitfast", robot: RobotParams = ROBOT
) -> ChainMotion:
    """The spiral of the MuJoCo chain with n joints."""
    options = {"bending": "spatial", "torsion": True, "loads": loads(), "sensors": (TipSensors(),)}
    steps = {"control_period": PERIOD, "timestep": timestep, "integrator": integrator}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # some timesteps are near the stability limit on purpose
        return ChainMotion(chain_scene(robot, rule, n, **options, **steps), force)


#: Joints and longest timestep [s] of the chain's limit, full and quick.
LIMIT = ((6, 12, 24), 5e-4), ((4, 8, 16), 1e-3)
