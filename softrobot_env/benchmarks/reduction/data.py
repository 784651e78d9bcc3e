"""What a rig does: motion to learn from, and paths to be predicted."""

from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from softrobot_env.beams.registry import BeamPlant
from softrobot_env.control.rig.inverse import TOTAL
from softrobot_env.envs.rig import RigEnv
from softrobot_env.identification.excitation import resting_task
from softrobot_env.identification.visits import nominal_lengths
from softrobot_env.learned.reduction import Record
from softrobot_env.robots import RIG
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.training.motions import Plan, collect, drive, drives_of, filtered
from softrobot_env.training.ssm import PLAN

#: [s] between samples, the thesis' 100 Hz.
PERIOD = 0.01

#: The thesis' motion (sec. 3.3.3): releases stay within the usable workspace of 121 mm.
THESIS_PLAN = Plan(kinds=("random",), amplitude=0.55, period=PERIOD)

#: Random motion that is predicted: 20 records of 25 s.
UNSEEN = Plan(decays=0, excited=0, kinds=("random",), amplitude=0.55, period=PERIOD, run=25.0)
UNSEEN_COUNT = 20

#: Rectangle, half its sides [m]; radius of the circle [m]; periods [s].
HALVES, RADIUS, PERIODS = (0.07, 0.08), 0.11, (10.0, 4.0, 2.0, 1.0, 0.5)
PATHS = ("rectangle", "circle")

#: [s] to the first point and of rest there, and laps.
_LEAD, _REST, _LAPS = 4.0, 3.0, 2


#: Fig. 3.13: [s] that random inputs are held, cutoffs [Hz] of filters, and [s] of all.
HELD, CUTOFFS, SHOWN_FOR = 0.5, (1.0, 2.0, 4.0), 8.0


def random_inputs() -> np.ndarray:
    """Random changes of a tendon's length, held and filtered by each of `CUTOFFS`.

    Returns:
        (1 + cutoffs, t) [m], samples `PERIOD` apart.
    """
    drives, rng = drives_of(RIG, 2, PERIOD), np.random.default_rng(0)
    held = drives.targets[rng.integers(1, len(drives.targets), round(SHOWN_FOR / HELD))]
    steps = np.repeat(THESIS_PLAN.amplitude * held, round(HELD / PERIOD), axis=0)
    all_ = [steps, *(filtered(steps, cutoff, PERIOD) for cutoff in CUTOFFS)]
    return np.stack([one @ drives.basis[0] for one in all_]) * robot_inputs(RIG).input_scale[0]


@dataclass(frozen=True)
class Followed:
    """A path that a rig followed by a static inverse.

    Attributes:
        path, period: See `PATHS` and `PERIODS`.
        record: What it did, approach and rest before.
        begin: Sample at which laps begin.
    """

    path: str
    period: float
    record: Record
    begin: int


@dataclass(frozen=True)
class RigData:
    """All that is recorded of a rig.

    Attributes:
        twin: Seed of its twin; None for the one without friction and errors.
        quick: Whether there is little of it.
    """

    twin: int | None
    quick: bool = False

    @cached_property
    def thesis(self) -> tuple[list[Record], list[Record]]:
        """Decays and random motion as the thesis has them."""
        return self._collect(THESIS_PLAN)

    @cached_property
    def ours(self) -> tuple[list[Record], list[Record]]:
        """Decays, random motion and fast laps all over the workspace, 30 minutes."""
        return self._collect(replace(PLAN, period=PERIOD))

    @cached_property
    def unseen(self) -> list[Record]:
        """Random motion that no model has seen."""
        count = 2 if self.quick else UNSEEN_COUNT
        plan = replace(UNSEEN, minutes=count * UNSEEN.run / 60, seed=1000)
        return collect(RIG, plan, self.twin)[1]

    @cached_property
    def excited(self) -> Record:
        """A decay with the oscillation before it that the drives excite (Fig. 3.12)."""
        plan = replace(THESIS_PLAN, decays=0, excited=1, minutes=0.0)
        return collect(RIG, plan, self.twin, whole=True)[0][0]

    def _collect(self, plan: Plan) -> tuple[list[Record], list[Record]]:
        if self.quick:
            plan = replace(plan, decays=8, excited=2, minutes=3.0)
        return collect(RIG, plan, self.twin)

    def paths(self, plant: str | None = None) -> list[Followed]:
        """All paths, with the inputs that hold the nominal rig on them (thesis sec. 5.1).

        Args:
            plant: A beam model of the nominal rig that does it in the rig's place.
        """
        periods = PERIODS[1:4:2] if self.quick else PERIODS
        return [self._followed(path, period, plant) for path in PATHS for period in periods]

    def _followed(self, path: str, period: float, plant: str | None) -> Followed:
        points, begin = _points(path, period)
        straight = nominal_lengths(RIG, np.zeros((1, 2)), TOTAL)
        inputs, drives = robot_inputs(RIG), drives_of(RIG, 2, PERIOD)
        actions = (
            drives.rest + (nominal_lengths(RIG, points, TOTAL) - straight) / inputs.input_scale
        )
        task = replace(resting_task(RIG, len(points) * PERIOD + 1.0, "xy"))
        task = replace(task, start_input=tuple(drives.rest * inputs.input_scale))
        options = {"twin": self.twin} if isinstance(self.twin, int) else {}
        if plant is not None:
            options = {"plant": BeamPlant(plant), "pieces": None}
        seen = ("tip_position", "previous_action")
        with closing(RigEnv(task, observe=seen, control_period=PERIOD, **options)) as env:
            return Followed(path, period, drive(env, actions, 7), begin)


def _points(path: str, period: float) -> tuple[np.ndarray, int]:
    """Places (t, 2) [m] of approach, rest and laps, and where laps begin."""
    turns = (np.arange(round(period * _LAPS / PERIOD)) * PERIOD / period) % 1
    if path == "circle":
        laps = RADIUS * np.stack([np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)], axis=1)
    else:
        a, b = HALVES
        corners = np.array([[a, 0], [a, b], [-a, b], [-a, -b], [a, -b], [a, 0]])
        way = np.cumsum([0.0, *np.linalg.norm(np.diff(corners, axis=0), axis=1)])
        laps = np.stack([np.interp(turns, way / way[-1], side) for side in corners.T], axis=1)
    share = np.linspace(0, 1, round(_LEAD / PERIOD))[:, None]
    lead = share**3 * (10 - 15 * share + 6 * share**2) * laps[0]
    rest = np.tile(laps[0], (round(_REST / PERIOD), 1))
    return np.vstack([lead, rest, laps]), len(lead) + len(rest)
