"""What trainings need of the arm: random references in its workspace, and its network's teacher."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.linalg import norm

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.control.learned import neural
from softrobot_env.core.interfaces import Policy, ProgressCallback
from softrobot_env.robots import RobotParams
from softrobot_env.tasks import Task, make_task
from softrobot_env.tasks.trajectories import Polyline, Step
from softrobot_env.training.references import ImitationSetup, RobotTraining
from softrobot_env.training.request import Metrics, Quantity, TrainingRequest
from softrobot_env.training.rl_config import TRAINING_TASKS, RLConfig

from ..robots import ARM
from .mpc_settings import PREVIEW, MPCSettings

#: Inputs [N] of random postures: a common part within +-, and the deviation of each from it,
#: sampled between two values, as simple bends and S-shapes both occur.
_COMMON, _EACH = 14.0, (2.0, 16.0)

_STATICS = ConstantCurvatureStatics(ARM)

_KNOT = 0.01  # s, between the knots of a smooth reference

#: Of smooth references: harmonics of the inputs, and speeds [m/s] at the fastest point.
_HARMONICS, _SPEEDS = 3, (0.03, 0.6)

#: Widths [m] and duration [s] of the steps to learn on, and duration [s] of sampled references.
_STEP_WIDTHS, _STEP_DURATION, _SAMPLED_DURATION = (0.03, 0.05, 0.1, 0.2), 1.5, 6.0

#: The controller to imitate: `mpc_preview`, deciding as often as the network.
TEACHER: MPCSettings = replace(
    PREVIEW, period=neural.PERIOD, steps=(0.01, 0.01, 0.02, 0.02, 0.04, 0.04, 0.08), moves=(1,) * 7
)


class ArmTraining(RobotTraining):
    """See `RobotTraining`: tasks of the thesis, and a network whose scales are those shipped."""

    tasks = TRAINING_TASKS

    def sampled_task(self, rng: np.random.Generator, duration: float) -> Task:
        """Sometimes one of the three tasks with another start or step width."""
        return known_task(rng, duration) if rng.uniform() < 0.25 else draw_reference(rng, duration)

    def check_tasks(self) -> list[Task]:
        """The thesis' tasks."""
        steps = [make_task("step", width) for width in (0.05, 0.1, 0.2)]
        return [make_task("swing"), make_task("lshape"), *steps]

    def learned_tasks(
        self, name: str, count: int, rng: np.random.Generator
    ) -> list[tuple[Task | str, dict[str, float]]]:
        """Steps of several widths, sampled references, or a task twice."""
        if name == "step":
            tasks = [replace(make_task("step", w), duration=_STEP_DURATION) for w in _STEP_WIDTHS]
        elif name == "drawn":
            tasks = [draw_reference(rng, _SAMPLED_DURATION) for _ in range(count)]
        else:
            tasks = [make_task(name)] * 2
        return [(task, {}) for task in tasks]

    def settings(self, config: RLConfig) -> RLConfig:
        """The defaults."""
        return config

    def view(self, period: float | None = None) -> neural.View:
        """That of the shipped networks."""
        if period in (None, neural.PERIOD):
            return neural.arm_view(self.robot)
        return super().view(period)

    def imitation(self, teacher: str | None = None, folder: Path | None = None) -> ImitationSetup:
        """With the usual teacher its own settings, and the view of the shipped networks."""
        setup = super().imitation(teacher, folder)
        if setup.teacher != "mpc_preview":
            return setup
        own = {"period": neural.PERIOD, "preview": TEACHER.times}
        return replace(setup, view=self.view(), make=_make_teacher, is_tuned=True, **own)


def _make_teacher(setup: ImitationSetup) -> Policy:
    from .mpc import MPC

    return MPC(setup.robot, setup.period, TEACHER)


def random_input(rng: np.random.Generator) -> ndarray:
    """Reduced inputs (3,) [N] of a posture within the workspace."""
    return rng.uniform(-_COMMON, _COMMON) + rng.normal(0, rng.uniform(*_EACH), 3)


def tips(inputs: ndarray) -> ndarray:
    """Tips (k, 3) [m] at rest under inputs (k, 3) [N], of the nominal arm."""
    out = np.zeros((len(inputs), 3))
    out[:, 0::2] = [_STATICS.tip(one) for one in inputs]
    return out


def random_step(rng: np.random.Generator, duration: float) -> Task:
    """A jump between two postures, often a short one."""
    start = random_input(rng)
    share = rng.uniform(0, 1) ** 2
    target = start + share * (random_input(rng) - start)
    ends = tips(np.stack([start, target]))
    jump = Step(tuple(ends[0]), tuple(ends[1]))
    return Task("random step", ARM, jump, duration, tuple(start))


def random_legs(rng: np.random.Generator, duration: float) -> Task:
    """Straight legs at different speeds with kinks, and rests between them."""
    inputs, times = [random_input(rng)], [0.0]
    while times[-1] < duration:
        rests = rng.uniform() < 0.3
        towards = random_input(rng)
        share = 0.0 if rests else rng.uniform(0.2, 0.7)
        inputs.append(inputs[-1] + share * (towards - inputs[-1]))
        way = norm(np.diff(tips(np.array(inputs[-2:])), axis=0))
        times.append(times[-1] + max(0.3, way / rng.uniform(0.02, 0.3)))
    points = tips(np.array(inputs))
    path = Polyline(tuple(map(tuple, points)), tuple(times))
    return Task("random legs", ARM, path, duration, tuple(inputs[0]))


def random_waves(rng: np.random.Generator, duration: float) -> Task:
    """Smooth motion, slow or fast: harmonics of the inputs that would hold the tip there."""
    middle, size = random_input(rng), rng.normal(0, 2.5, (_HARMONICS, 1, 3))
    size += rng.normal(0, 3.0, (_HARMONICS, 1, 1))
    phase = rng.uniform(0, 2 * np.pi, _HARMONICS)
    order = np.arange(1, _HARMONICS + 1)

    def inputs(turn: ndarray) -> ndarray:
        angle = np.multiply.outer(order, turn) + phase[:, None]
        return middle + np.sum(size * np.sin(angle)[:, :, None] / order[:, None, None], axis=0)

    turn = np.linspace(0, 2 * np.pi, 200)
    fastest = norm(np.gradient(tips(inputs(turn)), turn, axis=0), axis=1).max()
    rate = np.exp(rng.uniform(*np.log(_SPEEDS))) / fastest
    times = np.arange(0, duration + 2 * _KNOT, _KNOT)
    path = Polyline(tuple(map(tuple, tips(inputs(rate * times)))), tuple(times))
    return Task("random waves", ARM, path, duration, tuple(inputs(np.zeros(1))[0]))


def draw_reference(rng: np.random.Generator, duration: float) -> Task:
    """A random step, random legs or random waves."""
    kind = rng.choice(3, p=[0.35, 0.2, 0.45])
    return (random_step, random_legs, random_waves)[kind](rng, duration)


def known_task(rng: np.random.Generator, duration: float) -> Task:
    """One of the three tasks, a step of random width."""
    name = rng.choice(["step", "swing", "lshape"])
    if name == "step":
        return replace(make_task("step", rng.uniform(0.02, 0.22)), duration=duration)
    return make_task(str(name))


def is_the_arm(robot: RobotParams) -> bool:
    """Whether a robot is the thesis' arm, by all that it is."""
    return robot == ARM


def train_network(request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Network of the quasi-static controller for the arm (thesis sec. 6.3)."""
    from softrobot_env.learned.network import describe
    from softrobot_env.learned.training import train_regularised

    from . import quasi_static

    statics = _STATICS
    # Independent streams, so that the validation data are not those of another seed.
    streams = np.random.SeedSequence(request.seed).spawn(3)
    pairs, start, fresh = (np.random.default_rng(stream) for stream in streams)
    quick = "quick" in request.settings
    how = quasi_static.Sampling(pairs=500) if quick else quasi_static.Sampling()
    samples = quasi_static.sample(statics.tip, statics.n_inputs, how, pairs)

    def report(done: int, total: int, error: float) -> None:
        show(f"squared error {error:.4g}", done, total)

    network = samples.new_network(quasi_static.HIDDEN, start)
    fit = train_regularised(network, samples, *((20,) if quick else ()), progress=report)
    validation = quasi_static.sample(statics.tip, statics.n_inputs, how, fresh)
    reached = quasi_static.workspace(samples.inputs[:, 2:4])
    fit.network.save(request.path, {**describe(ARM), "workspace": reached, "seed": request.seed})
    return [
        ("rms error, training data", Quantity(quasi_static.rms(fit.network, samples), ".4f", "N")),
        ("rms error, fresh data", Quantity(quasi_static.rms(fit.network, validation), ".4f", "N")),
        ("parameters", str(len(fit.network.parameters))),
        ("effective parameters", f"{fit.effective_parameters:.1f}"),
        ("alpha, beta", f"{fit.alpha:.4g}, {fit.beta:.4g}"),
        ("steps", f"{fit.iterations}{' (converged)' if fit.converged else ''}"),
    ]


def train_lqi(request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Gains of `lqi` in closed form (thesis sec. 6.4)."""
    from .operating_points import lqi_design

    return _train_gains(lqi_design, request, show)


def train_lq_preview(request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Gains of `lq_preview` in closed form."""
    from .operating_points import preview_design

    return _train_gains(preview_design, request, show)


def train_nothing(request: TrainingRequest, show: ProgressCallback) -> Metrics:
    """Refuse to train what planar arms have in closed form; ValueError."""
    raise ValueError(
        f"robot {request.robot.name!r} is a planar arm, whose model predictive control is in "
        "closed form: there is nothing to train"
    )


def _train_gains(
    design: Callable[..., Any], request: TrainingRequest, show: ProgressCallback
) -> Metrics:
    """Gain table of a law for the arm, by its design."""
    from softrobot_env.beams.planar_arm import make_planar_arm

    from .operating_points import GRID, build_gains, save_gains

    robot = request.robot
    designed = partial(design, make_planar_arm(robot))
    gains = build_gains(robot, designed, partial(show, "operating points"))
    save_gains(request.path, robot, gains)
    return [
        ("operating points", " x ".join(str(count) for count, _ in GRID)),
        ("gains per point", str(gains.shape[3])),
    ]
