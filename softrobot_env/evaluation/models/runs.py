"""Models of a robot in the same motion: their run times, and verdicts on their runs.

MuJoCo chains and beam models find equilibria and simulate motions by the same methods, so that one
function serves both. Errors are relative to limits: extrapolated results of increasingly fine
models.
"""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from time import perf_counter
from typing import Any, TypeVar

import mujoco
import numpy as np
from numpy import ndarray

from softrobot_env.beams import signals
from softrobot_env.beams.model import BeamModel
from softrobot_env.beams.registry import BeamPlant
from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.core.motion import State
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import Scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.timestep import TimestepWarning

#: Share of the length beyond which a run is wrong.
WRONG_SHARE = 0.05

#: A run joins a model's front if its error is smaller by at least this factor.
_GAIN = 0.85

#: Longest time [s] spent on the repeats of one measurement.
_BUDGET = 2.0

Result = TypeVar("Result")

# ---------------------------------------------------------------- limits


@dataclass(frozen=True)
class Limit:
    """A converged solution.

    Attributes:
        tips: (k, d) [m] at instants, or (d,) of an equilibrium.
        uncertainty: [m], distance between its two best estimates.
        text: How it was computed.
    """

    tips: ndarray
    uncertainty: float
    text: str


def distance(a: ndarray, b: ndarray) -> float:
    """Largest distance [m] of points (..., d)."""
    return float(np.max(np.linalg.norm(a - b, axis=-1)))


def converged(found: Mapping[int, ndarray], order: int) -> ndarray:
    """Limit of results by number of pieces, for an error series in powers of 1 / n^order."""
    x = [n**-order for n in found]
    weights = [np.prod([b / (b - a) for b in x if b != a]) for a in x]  # Lagrange's, at zero
    return np.tensordot(weights, list(found.values()), 1)


def extrapolate(solve: Callable[[int], ndarray], sizes: Sequence[int], text: str) -> Limit:
    """Limit of infinitely many pieces, for an error series in 1 / n^2.

    The uncertainty is its distance to the last estimate without the coarsest result, and belongs to
    the worse of the two.
    """
    found = {n: solve(n) for n in sizes}
    best = converged(found, 2)
    uncertainty = distance(best, converged({n: found[n] for n in sizes[1:]}, 2))
    text = f"{text}, n = {', '.join(map(str, sizes))}; uncertainty {1e3 * uncertainty:.1g} mm"
    return Limit(best, uncertainty, text)


# ---------------------------------------------------------------- time and cost


def best_of(
    action: Callable[[], Any], repeats: int, clock: Callable[[], float] = perf_counter
) -> tuple[float, Any]:
    """Shortest time [s] of several repetitions, fewer if they take long, and the last result.

    With `time.process_time` as the clock it is the computing time of all threads, independent of
    the machine's other load.
    """
    best, spent, result = np.inf, 0.0, None
    for _ in range(repeats):
        begin = clock()
        result = action()
        took = clock() - begin
        best, spent = min(best, took), spent + took
        if spent > _BUDGET:
            break
    return best, result


def front(rows: Iterable[Any], error: str = "e_mean", cost: str = "wall_time") -> list[Any]:
    """Rows whose error no cheaper one reaches, by a margin, cheapest first."""
    out: list[Any] = []
    for row in sorted(rows, key=lambda row: (getattr(row, cost), getattr(row, error))):
        if not out or getattr(row, error) < _GAIN * getattr(out[-1], error):
            out.append(row)
    return out


# ---------------------------------------------------------------- verdicts


class Verdict(StrEnum):
    """Verdict on a run.

    Accurate: within the requested accuracy. Reported: refused or failed with a message. Warned:
    less accurate, with a `TimestepWarning`. Inaccurate: less accurate without a warning, but within
    `WRONG_SHARE` of the length. Wrong: farther off without a warning. Unjudged: refined runs do not
    agree, or cost too much.
    """

    ACCURATE = "accurate"
    REPORTED = "reported"
    WARNED = "warned"
    INACCURATE = "inaccurate"
    WRONG = "wrong"
    UNJUDGED = "unjudged"


def verdict_of(
    error: float | None, asked: float, length: float, *, failure: str | None, warning: str | None
) -> Verdict:
    """The verdict on a run.

    Args:
        error: [m], largest distance from the truth; None if that is not known well enough.
        asked: [m], the requested accuracy.
        length: [m] of the robot.
        failure: Why the run failed or was refused, or None.
        warning: Text of a `TimestepWarning`, or None.
    """
    if failure is not None:
        return Verdict.REPORTED
    if error is None:
        return Verdict.UNJUDGED
    if error <= asked:
        return Verdict.ACCURATE
    if warning is not None:
        return Verdict.WARNED
    # Not `>`: a NaN is wrong too.
    return Verdict.INACCURATE if error <= WRONG_SHARE * length else Verdict.WRONG


def with_warning(run: Callable[[], Result]) -> tuple[Result, str | None]:
    """The result of a function, and the text of its first `TimestepWarning`, or None."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", TimestepWarning)
        result = run()
    said = [str(w.message) for w in caught if issubclass(w.category, TimestepWarning)]
    return result, said[0] if said else None


@contextmanager
def silent_warnings() -> Iterator[None]:
    """Keep MuJoCo from printing and logging warnings; they are read from the data instead."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def unwarned() -> Iterator[None]:
    """Suppress warnings about steps as well, where errors are measured anyway."""
    with silent_warnings(), warnings.catch_warnings():
        warnings.simplefilter("ignore", TimestepWarning)
        yield


# ---------------------------------------------------------------- one motion for all models


@dataclass(frozen=True)
class Excitation:
    """Motion of a robot's drives: random steps, each held for a while.

    Attributes:
        rest: Controls (n_inputs,) of the start: tensions [N], or lengths pulled in [m].
        controls: (periods, n_inputs), one row per control period.
        period: [s].
    """

    rest: ndarray
    controls: ndarray
    period: float

    @property
    def duration(self) -> float:
        """[s]."""
        return len(self.controls) * self.period

    @property
    def poses(self) -> ndarray:
        """The different rows (k, n_inputs) of the controls, in their order."""
        changes = np.any(np.diff(self.controls, axis=0), axis=1)
        return self.controls[np.concatenate(([True], changes))]


def excitation(scene: Scene, duration: float, amplitude: float = 0.5) -> Excitation:
    """Random steps of all drives of a scene, as in `scene.integration.probe`.

    Args:
        scene: The scene.
        duration: [s], at most two.
        amplitude: Share [1] of the drives' range, up to 1.
    """
    from softrobot_env.scene.integration import probe  # compiled code takes time to load

    low, high = scene.model.actuator_ctrlrange.T
    rest, period = np.clip(0.0, low, high), scene.config.control_period
    controls = probe.controls_of(scene, 0)[: max(1, round(duration / period))]
    wider = rest + amplitude / probe.AMPLITUDE * (controls - rest)
    return Excitation(rest, np.clip(wider, low, high), period)


@dataclass(frozen=True)
class Simulated:
    """A model of a robot with its resolution and the options of its motions.

    Attributes:
        model: A chain or a beam model.
        robot: The robot itself; for a beam model, with sections instead of a head.
        options: Of `BeamModel.simulate`.
    """

    model: Scene | BeamModel
    robot: RobotParams
    options: dict[str, Any] = field(default_factory=dict)

    def tips(self, q: ndarray) -> ndarray:
        """Tip or output point (3,) or (T, 3) [m] at coordinates (n,) or (T, n)."""
        head = self.robot.head
        if isinstance(self.model, Scene) or head is None:
            return self.model.tip(q)
        end = np.array([self.robot.length + head.output])
        return self.model.positions(q, end)[..., 0, :]

    def poses(self, inputs: ndarray) -> ndarray:
        """Tips (k, 3) [m] at rest under inputs (k, n_inputs).

        Raises:
            EquilibriumError: There is no equilibrium, or no stable one.
        """
        return self.tips(np.array([self.model.equilibrium(u) for u in inputs]))

    def start(self, u: ndarray) -> State:
        """State at rest under inputs (n_inputs,); straight if there is no stable equilibrium."""
        start = self.model.start()
        try:
            return State(self.model.equilibrium(u), start.v)
        except EquilibriumError:
            return start

    def motion(self, moved: Excitation, start: State | None = None) -> ndarray:
        """Tips (1 + periods, 3) [m] from rest on, or from a start.

        Raises:
            IntegrationError: The motion diverged.
        """
        inputs: Any = moved.controls
        if isinstance(self.model, BeamModel):
            inputs = signals.held(inputs, moved.period)
        start = self.start(moved.rest) if start is None else start
        given = {"samples": moved.period, **self.options}
        return self.tips(self.model.simulate(moved.duration, inputs, start, **given).q)


def beam_of(config: SceneConfig, name: str, pieces: int) -> BeamModel:
    """A beam model of a scene's robot, with the same bending and drives.

    Raises:
        ValueError: The model does not support something that the robot has, or so many pieces.
    """
    if config.robot.has_friction:
        raise ValueError("beam models have no friction of tendons or backbone")
    plant = BeamPlant(name, pieces)
    options = {"bending": config.bending, "torsion": config.torsion}
    stepped = plant(config.robot, axes=slice(0, 3), actuation=config.actuation, **options)
    stepped.model.warns = False  # its error is measured here
    return stepped.model
