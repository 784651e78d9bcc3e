"""Motions of the rig: a step of one length and a fast circle, on all models that can move it."""

import numpy as np
from scipy.integrate import solve_ivp

from softrobot_env.beams import signals
from softrobot_env.beams.closed_forms.spatial_piece import SUBPIECES, acceleration, make_rig_piece
from softrobot_env.beams.exact.rig_column import tensions
from softrobot_env.beams.exact.rig_ritz_rod import RigRod
from softrobot_env.beams.pcc import PCC
from softrobot_env.benchmarks.accuracy.cases.motions import BeamMotion, ChainMotion
from softrobot_env.benchmarks.accuracy.rig.cases import MOTIONS, PERIOD, ROBOT, sample_times
from softrobot_env.benchmarks.accuracy.rig.models import PIECE, chain_scene, end_axis, piece_output
from softrobot_env.benchmarks.accuracy.rows import (
    DURATION,
    Limit,
    Settings,
    distance,
    extrapolate,
    zero_timestep,
)

#: Terms and tolerances of the truth, the coarser first; of a quick run.
_TRUTHS = ((5, 1e-6), (6, 1e-7))
_QUICK_TRUTHS = ((3, 1e-4), (4, 1e-4))

#: Substeps of the chain's limit: h, h / 2 and h / 4.
_FINE = (40, 80, 160)
_SIZES = (8, 16, 32)


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


def chain_motion(case: str, rule: str, n: int, substeps: int, integrator: str) -> ChainMotion:
    """A motion of the MuJoCo chain with n joints and some timesteps per control period."""
    options = {"timestep": PERIOD / substeps, "integrator": integrator}
    return ChainMotion(chain_scene(rule, n, **options), MOTIONS[case])


def chain_limit(case: str, rule: str = "gauss2") -> Limit:
    """The chain's motion with infinitely many joints and at zero timestep."""

    def solve(n: int) -> np.ndarray:
        return zero_timestep([chain_motion(case, rule, n, k, "implicitfast")() for k in _FINE])[0]

    return extrapolate(solve, _SIZES, f"limit of mujoco_chain/{rule} at zero timestep")


def subpieces_motion(case: str, n: int, tolerance: float) -> BeamMotion:
    """PCC of n pieces with the thesis' three rigid bodies, which hold the head."""
    beam = PCC(ROBOT, n, axes="spatial", inertia=SUBPIECES, drive="length")

    def tips(q: np.ndarray) -> np.ndarray:
        return beam.tip(q) + ROBOT.head.output * end_axis(beam, q)

    signal = signals.smooth(MOTIONS[case], DURATION)
    return BeamMotion("pcc/subpieces", n, beam, signal, tips, PERIOD, tolerance=tolerance)


class PieceMotion:
    """The closed form of one piece with uniform backbone and head, integrated by SciPy.

    Args:
        case: Key of `MOTIONS`.
        tolerance: Relative, and absolute of angles and rates.
    """

    def __init__(self, case: str, tolerance: float) -> None:
        self._piece, self._pulled = make_rig_piece(ROBOT, "distributed"), MOTIONS[case]
        self._tolerance, self._steps = tolerance, 1

    @property
    def settings(self) -> Settings:
        """What it was simulated with; the steps are those of the last call."""
        return Settings(PIECE, 1, DURATION / self._steps, "RK45", self._tolerance)

    def _slope(self, t: float, x: np.ndarray) -> np.ndarray:
        out = np.empty(4)
        out[:2] = x[2:]
        force = tensions(ROBOT, self._pulled(t), np.array([x[1], -x[0]]))
        acceleration(self._piece, x[:2], x[2:], force, out[2:])
        return out

    def __call__(self) -> np.ndarray:
        """Tips (k, 3) [m]."""
        found = solve_ivp(
            self._slope,
            (0, DURATION),
            np.zeros(4),
            t_eval=sample_times(),
            rtol=self._tolerance,
            atol=self._tolerance,
            dense_output=True,
        )
        self._steps = len(found.sol.ts) - 1
        return np.array([piece_output(self._piece, y) for y in found.y[:2].T])
