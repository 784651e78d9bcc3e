"""The spiral (2.79): a tip force that turns at 10 rad/s and grows to 20 N in 3 s."""

import warnings
from collections.abc import Callable

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from softrobot_env.beams import signals
from softrobot_env.beams.model import BeamModel
from softrobot_env.benchmarks.accuracy.cases.beam_models import Contestant
from softrobot_env.benchmarks.accuracy.rows import DURATION, Limit, extrapolate
from softrobot_env.benchmarks.beams import weightless
from softrobot_env.robots import CANTILEVER_STIFF, RobotParams
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import SceneConfig, TipSensors
from softrobot_env.scene.quadrature import RULES

CASE = "spiral"

#: [s] between compared instants.
PERIOD = 0.01

#: [N] at the end, and [rad/s].
FORCE, RATE = 20.0, 10.0

ROBOT = weightless(CANTILEVER_STIFF)

_REFERENCE_TOLERANCE = 1e-7


def force(t: float | np.ndarray) -> np.ndarray:
    """(..., 2) [N] in x and y at time t [s]."""
    t = np.asarray(t)
    size = (FORCE * t / DURATION)[..., None]
    return size * np.stack([np.sin(RATE * t), np.cos(RATE * t)], axis=-1)


def loads(robot: RobotParams = ROBOT) -> tuple[Load, Load]:
    """Unit forces on the tip, whose amplitudes are `force`."""
    tip = robot.length
    return Load("fx", tip, force=(1.0, 0.0, 0.0)), Load("fy", tip, force=(0.0, 1.0, 0.0))


def beam_motion(
    model: BeamModel, method: str, step: float | None = None, tolerance: float = 1e-6
) -> tuple[Callable[[], np.ndarray], Callable[[], int]]:
    """A function that simulates the spiral and returns the tips (301, 3), and its steps."""
    signal = signals.smooth(force, DURATION)
    counted = []

    def simulate() -> np.ndarray:
        motion = model.simulate(
            DURATION, signal, method=method, step=step, tolerance=tolerance, samples=PERIOD
        )
        counted[:] = [motion.steps]
        return model.tip(motion.q)

    return simulate, lambda: counted[0]


def beam_limit(
    contestant: Contestant, sizes: tuple[int, int, int], robot: RobotParams = ROBOT
) -> Limit:
    """The spiral of a beam model with infinitely many pieces."""

    def solve(n: int) -> np.ndarray:
        model = contestant.build(robot, n, loads(robot), "spatial")
        return beam_motion(model, "sdirk4", tolerance=_REFERENCE_TOLERANCE)[0]()

    return extrapolate(solve, sizes, f"limit of {contestant.name} (sdirk4, 1e-7)")


class ChainSpiral:
    """The spiral of the MuJoCo chain, run by `mujoco.rollout`.

    Args:
        rule: Hinge rule.
        n: Number of joints.
        substeps: Timesteps per 10 ms.
        integrator: MuJoCo's name.
        robot: The robot.
    """

    def __init__(
        self,
        rule: str,
        n: int,
        substeps: int,
        integrator: str = "implicitfast",
        robot: RobotParams = ROBOT,
    ) -> None:
        self.scene = _scene(robot, rule, n // len(RULES[rule]), substeps, integrator)
        model = self.scene.model
        self._substeps = substeps
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._data, size = mujoco.MjData(model), mujoco.mj_stateSize(model, kind)
        self._start = np.empty((1, size))
        mujoco.mj_getState(model, self._data, self._start[0], kind)
        steps = round(DURATION / model.opt.timestep)
        self._ctrl = np.ascontiguousarray(force(np.arange(steps + 1) * model.opt.timestep)[None])
        self._state = np.empty((1, steps + 1, size))
        self._sensors = np.empty((1, steps + 1, model.nsensordata))
        self._rollout = Rollout(nthread=0)

    def __call__(self) -> np.ndarray:
        """Tips (301, 3) [m]."""
        self._rollout.rollout(
            [self.scene.model],
            [self._data],
            self._start,
            self._ctrl,
            state=self._state,
            sensordata=self._sensors,
        )
        return self._sensors[0, :: self._substeps, :3].copy()


def _scene(robot: RobotParams, rule: str, pieces: int, substeps: int, integrator: str) -> Scene:
    config = SceneConfig(
        robot,
        pieces=pieces,
        rule=rule,
        bending="spatial",
        torsion=True,
        loads=loads(),
        sensors=(TipSensors(),),
        control_period=PERIOD,
        timestep=PERIOD / substeps,
        integrator=integrator,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # some timesteps are near the stability limit on purpose
        return build_scene(config)


def chain_limit(quick: bool = False) -> Limit:
    """The chain's spiral with infinitely many joints and at zero timestep."""
    substeps = 20 if quick else 40
    sizes = (4, 8, 16) if quick else (6, 12, 24)

    def solve(n: int) -> np.ndarray:
        coarse, fine = (ChainSpiral("gauss2", n, k)() for k in (substeps, 2 * substeps))
        return 2 * fine - coarse

    text = f"limit of mujoco_chain/gauss2 (implicitfast, {PERIOD / substeps * 1e3:g} ms and half)"
    return extrapolate(solve, sizes, text)
