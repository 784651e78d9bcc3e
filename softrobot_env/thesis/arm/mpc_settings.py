"""Settings of the model predictive controllers."""

from dataclasses import dataclass, replace

import numpy as np
from numpy import ndarray

from softrobot_env.core.records import NotNegative, Whole, check_fields
from softrobot_env.core.registry import Registry

#: Diagonal coefficient by integrator.
GAMMA = {"implicit_euler": 1.0, "sdirk2": 1.0 - np.sqrt(0.5)}


@dataclass(frozen=True)
class MPCSettings:
    """Horizon, cost and optimisation of a model predictive controller.

    The weights hold for the first step; those of errors, rates and inputs grow with the duration
    of a step, so that the cost approximates an integral.

    Attributes:
        period: [s] between decisions.
        steps: (p,) [s], grid of the prediction.
        moves: (c,) steps for which each input block is in force, p in sum.
        integrator: One of `GAMMA`, one step of it per step of the grid.
        error: [1/m2] on the squared tip error.
        rate: [s2/m2] on the squared rate of the tip error.
        effort: [1/N2] on the squared inputs.
        change: [1/N2] on the squared change of the inputs from block to block.
        preview: Whether future references are known; else the present one is held.
        estimate: Whether to estimate the robot's stiffness, a force on its curvatures and an
            offset of its tip; else the model is taken to be exact.
        iterations: Largest number of quadratic programs per decision.
        tolerance: [N], largest change of an input in the last of them; None takes the inputs
            after `iterations` as they are (real-time iteration).
    """

    period: float
    steps: tuple[float, ...]
    moves: tuple[int, ...]
    integrator: str
    error: float
    rate: float
    effort: float
    change: float
    preview: bool
    estimate: bool
    iterations: Whole
    tolerance: NotNegative | None

    def __post_init__(self) -> None:
        check_fields(self, "MPC settings")
        Registry("integrator", GAMMA).find(self.integrator)
        if not self.steps or min(self.steps) <= 0 or not 0 < self.period <= self.steps[0]:
            raise ValueError(
                "steps must be positive and the period in (0, first step], got steps "
                f"{self.steps} and period {self.period} s"
            )
        if not self.moves or min(self.moves) < 1 or sum(self.moves) != len(self.steps):
            raise ValueError(
                f"moves must be 1 or more each and {len(self.steps)} in sum, one per step, got "
                f"{self.moves}"
            )
        if not (self.error > 0 and self.effort > 0 and self.rate >= 0 and self.change >= 0):
            raise ValueError("error and effort must be positive, rate and change zero or more")

    @property
    def times(self) -> tuple[float, ...]:
        """Ends (p,) [s] of the steps, from now."""
        return tuple(np.round(np.cumsum(self.steps), 9).tolist())

    @property
    def block(self) -> ndarray:
        """(p,) int, input block in force in each step."""
        return np.repeat(np.arange(len(self.moves)), self.moves)

    @property
    def shift(self) -> ndarray:
        """(c,) int, block of this plan that each block of the next one starts in."""
        starts = np.concatenate(([0.0], self.times))[:-1]
        first = np.searchsorted(self.block, np.arange(len(self.moves)))
        later = np.searchsorted(self.times, starts[first] + self.period + 1e-9)
        return np.append(self.block, self.block[-1])[later]

    def no_guess(self, n: int) -> ndarray:
        """Accelerations (p, stages, n) of an arm of n pieces at rest."""
        stages = 1 if GAMMA[self.integrator] == 1 else 2
        return np.zeros((len(self.steps), stages, n))


#: Thesis sec. 6.5, completed by the audit: weights, and implicit for explicit Euler steps.
THESIS = MPCSettings(
    period=0.1,
    steps=(0.1,) * 5,
    moves=(1, 1, 3),
    integrator="implicit_euler",
    error=1e4,
    rate=0.0,
    effort=1e-6,
    change=1e-3,
    preview=False,
    estimate=False,
    iterations=30,
    tolerance=1e-3,
)

#: With preview, finer and more accurate prediction and estimated disturbances, one quadratic
#: program per decision. Rate relative to error is 1e-3 s2, which takes the overshoot.
PREVIEW = replace(
    THESIS,
    period=0.005,
    steps=(0.005, 0.005, 0.01, 0.01, 0.02, 0.02, 0.04, 0.04, 0.08),
    moves=(1,) * 9,
    integrator="sdirk2",
    rate=10.0,
    preview=True,
    estimate=True,
    iterations=1,
    tolerance=None,
)

#: Keyword arguments of the environment that the controller with preview needs.
PREVIEW_ENVIRONMENT = {"control_period": PREVIEW.period, "preview": PREVIEW.times}
