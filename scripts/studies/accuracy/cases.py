"""The rows of the accuracy benchmark, and converged limits to compare them with."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import mujoco
import numpy as np
from mujoco.rollout import Rollout
from numpy import ndarray

from softrobot_env.beams.model import BeamModel, State
from softrobot_env.beams.signals import Signal
from softrobot_env.evaluation.models import runs
from softrobot_env.robots import RobotParams
from softrobot_env.scene.build import Scene
from softrobot_env.scene.simulation import DIVERGING
from studies.beams import make_beam, zero_timestep
from studies.lab import Record, quantity

#: [s] of all motions.
DURATION = 3.0

#: Largest distance of models of equal physics, in robot lengths.
BOUND = 1e-3


@dataclass(frozen=True)
class Row(Record):
    """A measurement, or what follows from some; None where a field does not apply.

    Attributes:
        kind: "static", "dynamic", "agreement" (of limits), "physics" (an agreement that is not
            expected), "goal" or "note".
        case: What was computed.
        model: By what.
        n: Joints or pieces.
        timestep: [s], the mean one where it adapts.
        integrator: Its name.
        tolerance: [1], None where steps are fixed.
        e_mean, e_max: [m], distance of the tips from the truth over a motion.
        e_time: [m], largest distance from the same model with an exact integrator.
        wall_time: [s] of the equilibrium or the motion.
        step_time: [s] of a step.
        physics: Name of a `Physics`.
        reference: The truth that was compared with.
        value, limit, met: Of an agreement the distance over the robot's
            length and its bound; of a goal the measured figure and its bound.
    """

    kind: str
    case: str
    model: str
    n: int | None = quantity("", "d", default=None)
    timestep: float | None = None
    integrator: str | None = None
    tolerance: float | None = None
    e_mean: float | None = quantity("mm", ".2g", "e mean", default=None)
    e_max: float | None = quantity("mm", ".2g", "e max", default=None)
    e_time: float | None = quantity("mm", ".2g", "e time", default=None)
    wall_time: float | None = quantity("ms", ".3g", "time", default=None)
    step_time: float | None = None
    physics: str | None = None
    reference: str | None = None
    value: float | None = None
    limit: float | None = None
    met: bool | None = None

    @property
    def family(self) -> str:
        """The model; all hinge rules of the chain are one."""
        return "mujoco_chain" if self.is_chain else self.model

    @property
    def is_chain(self) -> bool:
        """Whether the model is the MuJoCo chain."""
        return self.model.startswith("mujoco_chain/")

    @property
    def rule(self) -> str:
        """Hinge rule of the chain; empty of other models."""
        return self.model.partition("/")[2] if self.is_chain else ""


@dataclass(frozen=True)
class Physics:
    """What deforms in a model, which decides what it converges to.

    Attributes:
        name: Name in the report.
        shear_coefficient: k [1], None without shear and extension.
    """

    name: str
    shear_coefficient: float | None


#: Bending and torsion only; with shear and extension; a continuum (in it the shear stress is free,
#: which corresponds to k = 1, and large strains add terms that a rod model has not).
BENDING = Physics("bending", None)
SHEAR = Physics("shear", 0.75)
CONTINUUM = Physics("continuum", 1.0)


def static_row(
    case: str, model: str, n: int, physics: Physics, truth: runs.Limit, tip: ndarray, **others: Any
) -> Row:
    """Error of a tip (d,) [m] at rest; `others` are further fields."""
    error = runs.distance(tip, truth.tips)
    values = {"e_mean": error, "e_max": error, "physics": physics.name, "reference": truth.text}
    return Row("static", case, model, n, **values, **others)


@dataclass(frozen=True)
class Settings:
    """What a motion was simulated with: see the fields of `Row`."""

    model: str
    n: int
    timestep: float
    integrator: str
    tolerance: float | None = None


def motion_row(
    case: str,
    physics: Physics,
    truth: runs.Limit,
    settings: Settings,
    tips: ndarray,
    wall_time: float,
    e_time: float | None = None,
) -> Row:
    """Mean and largest error of tips (k, d) [m] in motion."""
    error = np.linalg.norm(tips - truth.tips, axis=1)
    values = {"e_mean": float(error.mean()), "e_max": float(error.max()), "e_time": e_time}
    values |= {"wall_time": wall_time, "step_time": wall_time * settings.timestep / DURATION}
    about = vars(settings) | {"physics": physics.name, "reference": truth.text}
    return Row("dynamic", case, **about, **values)


def agreement_row(
    case: str, model: str, n: int | None, gap: float, length: float, physics: str, text: str
) -> Row:
    """How far [m] the limit of a model is from another of its physics, and from the bound."""
    share = {"value": gap / length, "limit": BOUND, "met": gap / length < BOUND}
    about = {"physics": physics, "reference": text}
    return Row("agreement", case, model, n, e_mean=gap, e_max=gap, **about, **share)


def limit_row(
    case: str,
    model: str,
    tips: dict[int, ndarray],
    physics: Physics,
    truth: runs.Limit,
    length: float,
    order: int = 2,
) -> Row:
    """How far the limit of tips (d,) [m] by numbers of pieces is from a truth."""
    sizes, gap = sorted(tips), runs.distance(runs.converged(tips, order), truth.tips)
    text = f"limit of n = {', '.join(map(str, sizes))}; {truth.text}"
    return agreement_row(case, model, sizes[-1], gap, length, physics.name, text)


# ---------------------------------------------------------------- models


@dataclass(frozen=True)
class Contestant:
    """A beam model with its options.

    Attributes:
        name: Name in the report.
        physics: What it converges to.
        sizes: Numbers of pieces in the static cases, coarse to fine.
        spiral: Numbers of pieces in the spiral; the first is the thesis' own.
        step: Numbers of pieces in the tension step.
        explicit: Whether explicit integrators are worth a try.
    """

    name: str
    physics: Physics
    sizes: tuple[int, ...]
    spiral: tuple[int, ...]
    step: tuple[int, ...]
    explicit: bool = False

    def build(self, *given: Any, **options: Any) -> BeamModel:
        """The model of a robot; arguments as those of `make_beam` after the name."""
        return make_beam(self.name, *given, **options)


LUMPED = Contestant("pcc/lumped", BENDING, (3, 6, 12, 24), (2, 3, 5, 8), (3, 6, 12), True)
DISTRIBUTED = Contestant("pcc/distributed", BENDING, (3, 6, 12, 24), (2, 3, 5, 8), (3, 6, 12), True)
COSSERAT = Contestant("cosserat", SHEAR, (6, 12, 24, 48), (7, 14, 28), (6, 12, 24))
ANCF_BEAM = Contestant("ancf", CONTINUUM, (3, 6, 12, 24), (2, 4, 8), (3, 6, 12))

CONTESTANTS = (LUMPED, DISTRIBUTED, COSSERAT, ANCF_BEAM)


# ---------------------------------------------------------------- motions

#: Of methods with a fixed step, which they use to end Newton's iteration; of a limit.
_NEWTON, _REFERENCE = 1e-6, 1e-7


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
    inputs: ndarray | Signal
    tips: Callable[[ndarray], ndarray]
    period: float
    start: State | None = None
    method: str = "sdirk4"
    step: float | None = None
    tolerance: float | None = None
    _steps: int = 1

    @property
    def settings(self) -> Settings:
        """What it was simulated with; the steps are those of the last call."""
        return Settings(self.name, self.n, DURATION / self._steps, self.method, self.tolerance)

    def __call__(self) -> ndarray:
        """Tips (k, d) [m].

        Raises:
            IntegrationError: The integration failed.
        """
        how = {"method": self.method, "step": self.step, "tolerance": self.tolerance or _NEWTON}
        about = DURATION, self.inputs, self.start
        motion = self.beam.simulate(*about, samples=self.period, **how)
        self._steps = motion.steps
        return self.tips(motion.q)


#: Makes the motion of a beam model with a number of pieces, of a robot.
MakeMotion = Callable[[Contestant, int, RobotParams], BeamMotion]


def beam_limit(
    make: MakeMotion, contestant: Contestant, sizes: tuple[int, int, int], robot: RobotParams
) -> runs.Limit:
    """A motion of a beam model with infinitely many pieces."""

    def solve(n: int) -> ndarray:
        return replace(make(contestant, n, robot), tolerance=_REFERENCE)()

    return runs.extrapolate(solve, sizes, f"limit of {contestant.name} (sdirk4, 1e-7)")


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
        controls: Callable[[ndarray], ndarray],
        posture: ndarray | None = None,
        compared: Callable[[ndarray], ndarray] = lambda tips: tips,
    ) -> None:
        self.scene, self._compared, model = scene, compared, scene.model
        self._substeps = round(scene.config.control_period / scene.timestep.timestep)
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._data, size = mujoco.MjData(model), mujoco.mj_stateSize(model, kind)
        if posture is not None:
            self._data.qpos[:] = posture
        start, times = np.empty((1, size)), np.arange(round(DURATION / model.opt.timestep) + 1)
        mujoco.mj_getState(model, self._data, start[0], kind)
        ctrl = np.ascontiguousarray(controls(times * model.opt.timestep)[None])
        found = {"state": np.empty((1, len(times), size))}
        found["sensordata"] = self._sensors = np.empty((1, len(times), model.nsensordata))
        run = Rollout(nthread=0).rollout
        self._run = partial(run, [model], [self._data], start, ctrl, **found)

    @property
    def settings(self) -> Settings:
        """What it is simulated with."""
        scene, choice = self.scene, self.scene.timestep
        name, n = f"mujoco_chain/{scene.config.hinge_rule}", len(scene.layout.stations)
        return Settings(name, n, choice.timestep, choice.integrator)

    def __call__(self) -> ndarray:
        """Tips (k, 3) [m], or what is compared of them.

        Raises:
            RuntimeError: The simulation diverged.
        """
        with runs.silent_warnings():
            self._run()
        tips = self._sensors[0, :: self._substeps, :3].copy()
        bad = any(self._data.warning[kind].number for kind in DIVERGING)
        if bad or not np.all(np.isfinite(tips[-1])):
            what, when = self.settings, f"t = {self._data.time:.4g} s"
            raise RuntimeError(f"{what.model} with {what.n} joints diverged at {when}")
        return self._compared(tips)


#: A motion of `DURATION`: called, it gives tips (k, d) [m]; `settings` say how.
TimedMotion = BeamMotion | ChainMotion


def chain_limit(
    motion: Callable[[str, int, float], ChainMotion], sizes: tuple[int, int, int], step: float
) -> runs.Limit:
    """The chain's motion with infinitely many joints and at zero timestep.

    Args:
        motion: From a hinge rule, joints and timestep [s] to the motion by implicitfast, whose
            error is a series in the timestep.
        sizes: Joints.
        step: Longest timestep [s]; a half and a quarter of it are taken, too.
    """

    def solve(n: int) -> ndarray:
        return zero_timestep([motion("gauss2", n, step / k)() for k in (1, 2, 4)])[0]

    text = f"limit of mujoco_chain/gauss2 (implicitfast, {1e3 * step:g} to {250 * step:g} ms)"
    return runs.extrapolate(solve, sizes, text)


def timed_row(
    case: str,
    physics: Physics,
    truth: runs.Limit,
    motion: TimedMotion,
    repeats: int = 1,
    exact: ndarray | None = None,
) -> Row:
    """Row of a motion, whose time is the best of `repeats`.

    Args:
        case: Its case.
        physics, truth: What it converges to.
        motion: The motion.
        repeats: Number of simulations.
        exact: Tips (k, d) [m] of the same model with an exact integrator, if they are known.
    """
    wall_time, tips = runs.best_of(motion, repeats)
    error = None if exact is None else runs.distance(tips, exact)
    return motion_row(case, physics, truth, motion.settings, tips, wall_time, e_time=error)


def goal(
    case: str, best: Row, value: float, *, most: float | None = None, least: float | None = None
) -> Row:
    """What the best row has to do with a goal, which has one of two bounds."""
    met = value >= least if most is None else value <= most
    bound = {"value": value, "limit": least if most is None else most, "met": met}
    left_out = dict.fromkeys(("step_time", "reference"))
    return replace(best, kind="goal", case=case, **bound, **left_out)
