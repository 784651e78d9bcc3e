"""Motions of the rig: a step of one length and a fast circle, on all models that can move it."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from scipy.integrate import solve_ivp

from softrobot_env.beams import signals
from softrobot_env.beams.closed_forms.spatial_piece import SUBPIECES, acceleration, make_rig_piece
from softrobot_env.beams.exact.rig_column import tensions
from softrobot_env.beams.exact.rig_ritz_rod import RigRod
from softrobot_env.beams.pcc import PCC
from softrobot_env.benchmarks.accuracy.rig.cases import (
    MOTIONS,
    PERIOD,
    ROBOT,
    sample_times,
)
from softrobot_env.benchmarks.accuracy.rig.models import chain_scene, end_axis, piece_output
from softrobot_env.benchmarks.accuracy.rows import (
    DURATION,
    Limit,
    distance,
    extrapolate,
    zero_timestep,
)
from softrobot_env.benchmarks.stability.runs import chain_failure, silent_warnings

#: Terms and tolerances of the truth, the coarser first; of a quick run.
_TRUTHS = ((5, 1e-6), (6, 1e-7))
_QUICK_TRUTHS = ((3, 1e-4), (4, 1e-4))

#: Substeps of the chain's limit: h, h / 2 and h / 4.
_FINE = (40, 80, 160)
_SIZES = (8, 16, 32)

#: A function that simulates a motion, and the number of its steps.
Simulate = Callable[[], np.ndarray]
Steps = Callable[[], int]


def truth(case: str, quick: bool = False) -> Limit:
    """Tips (k, 3) [m] of the rod by Ritz' method; the coarser one gives the uncertainty."""
    coarse, fine = (
        RigRod(ROBOT, terms).motion(MOTIONS[case], sample_times(), rtol)
        for terms, rtol in (_QUICK_TRUTHS if quick else _TRUTHS)
    )
    uncertainty = distance(coarse, fine)
    terms, rtol = (_QUICK_TRUTHS if quick else _TRUTHS)[1]
    text = f"rod by Ritz' method, {terms} terms, Radau {rtol:.0e}"
    return Limit(fine, uncertainty, f"{text}; uncertainty {1e3 * uncertainty:.1g} mm")


@dataclass
class ChainMotion:
    """A motion of the MuJoCo chain, run by `mujoco.rollout`.

    Attributes:
        case: Key of `MOTIONS`.
        rule, n: Hinge rule and joints.
        substeps: Timesteps per control period.
        integrator: MuJoCo's name.
    """

    case: str
    rule: str
    n: int
    substeps: int
    integrator: str

    def __post_init__(self) -> None:
        options = {"timestep": PERIOD / self.substeps, "integrator": self.integrator}
        self._model = chain_scene(self.rule, self.n, **options).model
        self._data = mujoco.MjData(self._model)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._start = np.empty((1, mujoco.mj_stateSize(self._model, kind)))
        mujoco.mj_getState(self._model, self._data, self._start[0], kind)
        steps = round(DURATION / PERIOD) * self.substeps
        times = PERIOD / self.substeps * np.arange(steps + 1)
        self._ctrl = np.ascontiguousarray(MOTIONS[self.case](times)[None])
        self._state = np.empty((1, steps + 1, self._start.shape[1]))
        self._sensors = np.empty((1, steps + 1, self._model.nsensordata))
        self._rollout = Rollout(nthread=0)

    def __call__(self) -> np.ndarray:
        """Tips (k, 3) [m].

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
        tips = self._sensors[0, :: self.substeps, :3].copy()
        failure = chain_failure(self._data, tips[-1])
        if failure:
            raise RuntimeError(f"{self.case}, {self.rule} with {self.n} joints {failure}")
        return tips


def chain_limit(case: str, rule: str = "gauss2") -> Limit:
    """The chain's motion with infinitely many joints and at zero timestep."""

    def solve(n: int) -> np.ndarray:
        return zero_timestep([ChainMotion(case, rule, n, k, "implicitfast")() for k in _FINE])[0]

    return extrapolate(solve, _SIZES, f"limit of mujoco_chain/{rule} at zero timestep")


def subpieces_motion(case: str, n: int, tolerance: float) -> tuple[Simulate, Steps]:
    """PCC of n pieces with the thesis' three rigid bodies, which hold the head."""
    model = PCC(ROBOT, n, axes="spatial", inertia=SUBPIECES, drive="length")
    signal = signals.smooth(MOTIONS[case], DURATION)
    counted = []

    def simulate() -> np.ndarray:
        motion = model.simulate(
            DURATION, signal, method="sdirk4", tolerance=tolerance, samples=PERIOD
        )
        counted[:] = [motion.steps]
        return model.tip(motion.q) + ROBOT.head.output * end_axis(model, motion.q)

    return simulate, lambda: counted[0]


def piece_motion(case: str, tolerance: float) -> tuple[Simulate, Steps]:
    """The closed form of one piece with uniform backbone and head, integrated by SciPy."""
    piece, pulled = make_rig_piece(ROBOT, "distributed"), MOTIONS[case]
    counted = []

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        out = np.empty(4)
        out[:2] = x[2:]
        force = tensions(ROBOT, pulled(t), np.array([x[1], -x[0]]))
        acceleration(piece, x[:2], x[2:], force, out[2:])
        return out

    def simulate() -> np.ndarray:
        found = solve_ivp(
            slope,
            (0, DURATION),
            np.zeros(4),
            t_eval=sample_times(),
            rtol=tolerance,
            atol=tolerance,
            dense_output=True,
        )
        counted[:] = [len(found.sol.ts) - 1]
        return np.array([piece_output(piece, y) for y in found.y[:2].T])

    return simulate, lambda: counted[0]
