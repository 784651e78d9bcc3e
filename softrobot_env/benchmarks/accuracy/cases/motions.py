"""Motions to be timed: a call simulates one and gives its tips, with nothing else to do."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from mujoco.rollout import Rollout

from softrobot_env.beams.model import BeamModel, State
from softrobot_env.beams.signals import Signal
from softrobot_env.benchmarks.accuracy.cases.beam_models import Contestant
from softrobot_env.benchmarks.accuracy.rows import (
    DURATION,
    Limit,
    Physics,
    Row,
    Settings,
    distance,
    extrapolate,
    motion_row,
)
from softrobot_env.benchmarks.stability.runs import chain_failure, silent_warnings
from softrobot_env.benchmarks.timing import best_of
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import Scene

#: Of methods with a fixed step, which they use to end Newton's iteration; of a limit.
_NEWTON, _REFERENCE = 1e-6, 1e-7


class TimedMotion(Protocol):
    """A motion of `DURATION`."""

    @property
    def settings(self) -> Settings:
        """What it was simulated with; the steps are those of the last call."""
        ...

    def __call__(self) -> np.ndarray:
        """Tips (k, d) [m]."""
        ...


@dataclass
class BeamMotion:
    """A motion of a beam model.

    Attributes:
        name, n: Name in the report and pieces.
        beam: The model.
        inputs: Inputs (n_inputs,), or over time.
        tips: Tips (k, d) [m] at coordinates (k, n).
        period: [s] between the tips.
        start: State at the start, rest unless given.
        method, step, tolerance: Of `BeamModel.simulate`; a step [s] is fixed.
    """

    name: str
    n: int
    beam: BeamModel
    inputs: np.ndarray | Signal
    tips: Callable[[np.ndarray], np.ndarray]
    period: float
    start: State | None = None
    method: str = "sdirk4"
    step: float | None = None
    tolerance: float | None = None
    _steps: int = 1

    @property
    def settings(self) -> Settings:
        """What it was simulated with; the steps are those of the last call."""
        timestep = DURATION / self._steps
        return Settings(self.name, self.n, timestep, self.method, self.tolerance)

    def __call__(self) -> np.ndarray:
        """Tips (k, d) [m].

        Raises:
            IntegrationError: The integration failed.
        """
        motion = self.beam.simulate(
            DURATION,
            self.inputs,
            self.start,
            method=self.method,
            step=self.step,
            tolerance=self.tolerance or _NEWTON,
            samples=self.period,
        )
        self._steps = motion.steps
        return self.tips(motion.q)


#: Makes the motion of a beam model with a number of pieces, of a robot.
MakeMotion = Callable[[Contestant, int, RobotParams], BeamMotion]


def beam_limit(
    make: MakeMotion, contestant: Contestant, sizes: tuple[int, int, int], robot: RobotParams
) -> Limit:
    """A motion of a beam model with infinitely many pieces."""

    def solve(n: int) -> np.ndarray:
        motion = make(contestant, n, robot)
        motion.tolerance = _REFERENCE
        return motion()

    return extrapolate(solve, sizes, f"limit of {contestant.name} (sdirk4, 1e-7)")


class ChainMotion:
    """A motion of the MuJoCo chain, run by `mujoco.rollout`.

    Args:
        scene: The scene, with sensors of the tip first.
        controls: Controls (k, nu) at times (k,) [s].
        posture: (nq,) at the start, straight unless given.
        compared: What is made of the tips (k, 3) [m].
    """

    def __init__(
        self,
        scene: Scene,
        controls: Callable[[np.ndarray], np.ndarray],
        posture: np.ndarray | None = None,
        compared: Callable[[np.ndarray], np.ndarray] = lambda tips: tips,
    ) -> None:
        self.scene, self._model, self._compared = scene, scene.model, compared
        self._substeps = round(scene.config.control_period / scene.timestep.timestep)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._data, size = mujoco.MjData(self._model), mujoco.mj_stateSize(self._model, kind)
        self._start = np.empty((1, size))
        if posture is not None:
            self._data.qpos[:] = posture
        mujoco.mj_getState(self._model, self._data, self._start[0], kind)
        times = np.arange(round(DURATION / self._model.opt.timestep) + 1)
        self._ctrl = np.ascontiguousarray(controls(times * self._model.opt.timestep)[None])
        self._state = np.empty((1, len(times), size))
        self._sensors = np.empty((1, len(times), self._model.nsensordata))
        self._rollout = Rollout(nthread=0)

    @property
    def settings(self) -> Settings:
        """What it is simulated with."""
        scene, choice = self.scene, self.scene.timestep
        name, n = f"mujoco_chain/{scene.config.hinge_rule}", len(scene.layout.stations)
        return Settings(name, n, choice.timestep, choice.integrator)

    def __call__(self) -> np.ndarray:
        """Tips (k, 3) [m], or what is compared of them.

        Raises:
            RuntimeError: The simulation diverged.
        """
        with silent_warnings():
            self._rollout.rollout(
                [self._model],
                [self._data],
                self._start,
                self._ctrl,
                state=self._state,
                sensordata=self._sensors,
            )
        tips = self._sensors[0, :: self._substeps, :3].copy()
        failure = chain_failure(self._data, tips[-1])
        if failure:
            settings = self.settings
            raise RuntimeError(f"{settings.model} with {settings.n} joints {failure}")
        return self._compared(tips)


def timed_row(
    case: str,
    physics: Physics,
    truth: Limit,
    motion: TimedMotion,
    repeats: int = 1,
    exact: np.ndarray | None = None,
) -> Row:
    """Row of a motion, whose time is the best of `repeats`.

    Args:
        case: Its case.
        physics, truth: What it converges to.
        motion: The motion.
        repeats: Number of simulations.
        exact: Tips (k, d) [m] of the same model with an exact integrator, if they are known.
    """
    wall_time, tips = best_of(motion, repeats)
    error = None if exact is None else distance(tips, exact)
    return motion_row(case, physics, truth, motion.settings, tips, wall_time, e_time=error)
