"""Motion of a robot to learn a reduced model from: decays, and motion under random inputs.

Inputs are sampled from those of the robot's workspace, within the few directions that move its tip
most: of three tendons around a fibre the two that keep the sum of their lengths, as the thesis has
them (sec. 3.3.3).
"""

from contextlib import closing
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, Literal

import gymnasium
import numpy as np
from numpy import ndarray
from numpy.linalg import lstsq, svd
from numpy.random import Generator
from scipy.signal import butter, sosfiltfilt

from softrobot_env.core.interfaces import ProgressCallback, quiet
from softrobot_env.core.records import NotNegative, Positive, Range, Whole, check_fields
from softrobot_env.evaluation.runner import simulated
from softrobot_env.identification.excitation import resting_task
from softrobot_env.learned.reduction import Record
from softrobot_env.robots import RobotParams, entry_of
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.twin import Twin
from softrobot_env.scene.inverse import sample_of, workspace_of
from softrobot_env.scene.linearised import linearised
from softrobot_env.tasks.trajectories import quintic_step

#: Least gain from actions to the tip in a direction, over the largest.
_MOVING = 0.1

#: Share of the workspace's actions whose tendons stay taut.
_TAUT = 0.9

#: Of the drives' speed.
_FASTEST = 0.9

#: Holds and cutoffs of the thesis' random inputs (audit sec. 3: 0.2 to 1 s, 1 to 4 Hz) in periods
#: and frequencies of the rig's first mode, 1.63 Hz: so they suit other robots too.
HOLDS, CUTOFFS = (0.33, 1.63), (0.61, 2.45)

#: Laps: frequencies over that of the first mode.
LAPS = (0.05, 1.3)

Kind = Literal["random", "laps"]


@dataclass(frozen=True)
class Plan:
    """What a robot is to do.

    Attributes:
        decays: Number of releases from a place at rest.
        excited: Number of releases out of an oscillation.
        decay: [s] recorded of each.
        minutes: Of motion under changing inputs.
        run: [s] of an uninterrupted part of it.
        kinds: Of the parts, in turn: "random" as the thesis', or "laps" round ellipses whose size
            and speed change.
        amplitude: Of decays and of random inputs, over the workspace's actions [1].
        laps_amplitude: Of laps, likewise.
        period: [s] between samples; None: about 80 in the first mode's period.
        seed: Of everything random.
    """

    decays: Whole = 47
    excited: Whole = 23
    decay: Positive = 3.5
    minutes: NotNegative = 28.0
    run: Positive = 60.0
    kinds: tuple[Kind, ...] = ("random", "laps")
    amplitude: Annotated[float, Range("in (0, 1]", lambda x: 0 < x <= 1)] = 1.0
    laps_amplitude: Annotated[float, Range("in (0, 1]", lambda x: 0 < x <= 1)] = 1.0
    period: Positive | None = None
    seed: Whole = 0

    def __post_init__(self) -> None:
        check_fields(self, "motions")
        if not self.kinds:
            raise ValueError("motions: choose kinds from random, laps")


@dataclass(frozen=True, eq=False)
class Drives:
    """How a robot is moved: actions of few coordinates.

    Attributes:
        rest: (n_inputs,) the action that motion starts from.
        basis: (n_inputs, m) orthonormal, changes of actions.
        targets: (k, m), coordinates of actions all over the workspace.
        first: [s], period of the slowest mode.
        period: [s] between samples.
        rate: [1/s], how fast each action may change; inf where the drive follows at once.
    """

    rest: ndarray
    basis: ndarray
    targets: ndarray
    first: float
    period: float
    rate: ndarray


@lru_cache(maxsize=16)
def drives_of(robot: RobotParams, outputs: int, period: float | None = None) -> Drives:
    """How to move a robot whose tip has so many coordinates that are seen.

    Raises:
        ValueError: The robot has no tendons.
    """
    space, sample, inputs = workspace_of(robot), sample_of(robot), robot_inputs(robot)
    actions = inputs.to_actions(sample.inputs)
    if robot.drive.kind == "length":
        actions = _taut(robot, actions)
    rest = actions[0]
    actions = actions - rest
    gain = lstsq(actions, sample.tips - sample.tips[0], rcond=None)[0]
    _, values, directions = svd(gain.T, full_matrices=False)
    basis = directions[: min(int(np.sum(values > _MOVING * values[0])), outputs)].T
    first = 1 / float(linearised(space.inverse, space.ground.inputs).frequencies[0])
    if period is None:
        period = max(round(first / 80 / 0.005), 1) * 0.005
    rate = robot.drive.speed / inputs.input_scale
    return Drives(rest, basis, actions @ basis, first, period, rate)


def _taut(robot: RobotParams, actions: ndarray) -> ndarray:
    """Actions (k, n_inputs) with tendons of the same end pulled in further, to the same sum.

    Those of the sample, the tendons' own stretch included, keep all tendons taut with the least
    tensions. With their sum at its largest, all tendons stay taut and actions are nearly linear in
    the tensions that bend: the sum of their tensions is constant, as in thesis sec. 3.1.2. A tendon
    that ends alone stays as it is.
    """
    out = actions.copy()
    ends = np.round(robot.of_tendons("end"), 9)
    for end in np.unique(ends):
        own = ends == end
        if own.sum() == 1:
            continue
        sums = actions[:, own].sum(axis=1)
        out[:, own] += (np.quantile(sums, _TAUT) - sums)[:, None] / own.sum()
    return out


def collect(
    robot: RobotParams,
    plan: Plan,
    twin: Twin | int | None = None,
    show: ProgressCallback = quiet,
    axes: str | None = None,
    whole: bool = False,
) -> tuple[list[Record], list[Record]]:
    """Record a robot's decays and its motion under changing inputs, in simulation.

    Args:
        robot: As designed.
        plan: What it does.
        twin: The one as built, of a robot driven by length; or the seed of the rig's.
        show: Shows the progress.
        axes: Coordinates of the tip, those of the robot's camera or task unless given.
        whole: Whether decays come with what was done before the release.

    Raises:
        ValueError: The robot has no tendons, or fails.
    """
    task = resting_task(robot, 10.0, axes or entry_of(robot).axes)
    drives = drives_of(robot, len(task.axes), plan.period)
    rng = np.random.default_rng(plan.seed)
    runs = max(1, round(60 * plan.minutes / plan.run)) if plan.minutes else 0
    inputs = robot_inputs(robot)
    start = tuple(inputs.from_actions(drives.rest).tolist())
    longest = max(plan.run, 12 * drives.first + plan.decay) + 1
    kinds = [_KINDS[plan.kinds[k % len(plan.kinds)]] for k in range(runs)]
    motions = [_release] * plan.decays + [_swing] * plan.excited + kinds
    records = []
    env = simulated(
        replace(task, duration=longest, start_input=start),
        twin,
        observe=("tip_position", "previous_action"),
        control_period=drives.period,
    )
    with closing(env):
        for motion in motions:
            actions, begin = motion(drives, plan, rng)
            record = drive(env, drives.rest + actions @ drives.basis.T, int(rng.integers(2**31)))
            begin = 0 if whole else begin
            records.append(Record(record.outputs[begin:], record.inputs[begin:], record.period))
            show("motions", len(records), len(motions))
    count = plan.decays + plan.excited
    return records[:count], records[count:]


def drive(env: gymnasium.Env, actions: ndarray, seed: int) -> Record:
    """The record of an environment that is given actions (t, n_inputs), from its reset on.

    Raises:
        ValueError: It fails.
    """
    observation = env.reset(seed=seed)[0]
    tips = [observation["tip_position"]]
    inputs = actions.astype(np.float32)
    for number, action in enumerate(inputs):
        observation, *_, info = env.step(action)
        if "failure" in info:
            raise ValueError(f"the robot failed in step {number}: {info['failure']}")
        tips.append(observation["tip_position"])
    inputs = np.vstack([inputs, inputs[-1:]])
    return Record(np.array(tips), inputs.astype(float), env.unwrapped.control_period)


def _release(drives: Drives, plan: Plan, rng: Generator) -> tuple[ndarray, int]:
    """Bent somewhere, rest, let go: actions (t, m) and the first sample without any."""
    there = plan.amplitude * _target(drives, rng)
    moving, resting = (round(n * drives.first / drives.period) for n in (3, 2))
    share = quintic_step(np.linspace(0, 1, moving)[:, None])[1]
    return _let_go(drives, plan, np.vstack([share * there, np.tile(there, (resting, 1))]))


def _swing(drives: Drives, plan: Plan, rng: Generator) -> tuple[ndarray, int]:
    """Excited near the first mode's frequency, then let go."""
    there = 0.5 * plan.amplitude * _target(drives, rng)
    time = np.arange(0, (2 + 2 * rng.uniform()) * drives.first, drives.period)
    return _let_go(drives, plan, np.sin(2 * np.pi * time / drives.first)[:, None] * there)


def _let_go(drives: Drives, plan: Plan, actions: ndarray) -> tuple[ndarray, int]:
    still = np.zeros((round((plan.decay + 0.3) / drives.period), actions.shape[1]))
    actions = _possible(drives, np.vstack([actions, still]))
    moving = np.flatnonzero(np.abs(actions).max(axis=1) > 1e-9)
    return actions, int(moving[-1]) + 1 + round(0.1 / drives.period)


def _random(drives: Drives, plan: Plan, rng: Generator) -> tuple[ndarray, int]:
    """Places held for some time, low-pass filtered (thesis sec. 3.3.3)."""
    hold = drives.first * rng.uniform(*HOLDS)
    cutoff = rng.uniform(*CUTOFFS) / drives.first
    count = round(plan.run / drives.period)
    holds = [plan.amplitude * _target(drives, rng) for _ in range(int(plan.run / hold) + 2)]
    steps = np.repeat(np.array(holds), max(1, round(hold / drives.period)), axis=0)[:count]
    return _possible(drives, _from_rest(drives, filtered(steps, cutoff, drives.period))), 0


def filtered(steps: ndarray, cutoff: float, period: float) -> ndarray:
    """Inputs (t, m) by a Butterworth low-pass of order 8 without lag, with a cutoff [Hz].

    60 samples and fewer stay as they are.
    """
    sos = butter(4, min(cutoff * period * 2, 0.9), output="sos")  # twice: order 8
    return sosfiltfilt(sos, steps, axis=0) if len(steps) > 60 else steps


def _laps(drives: Drives, plan: Plan, rng: Generator) -> tuple[ndarray, int]:
    """Ellipses, rounder or flatter, whose size and speed change slowly."""
    time = np.arange(round(plan.run / drives.period)) * drives.period
    low, high = LAPS[0] / drives.first, LAPS[1] / drives.first
    knots = max(4, round(plan.run / (10 * drives.first)))
    at = np.linspace(0, plan.run, knots)
    speed = np.exp(np.interp(time, at, rng.uniform(np.log(low), np.log(high), knots)))
    turn = 2 * np.pi * np.cumsum(speed) * drives.period
    share = np.interp(time, at, np.sqrt(rng.uniform(0.05, 1, knots)))[:, None]
    # An oscillation at ratios of the frequency may be larger than at rest.
    ratio = speed * drives.first
    share = share / np.maximum(1 / np.hypot(1 - ratio**2, 0.4 * ratio), 1.0)[:, None]
    one, other = (
        plan.laps_amplitude * np.stack([np.interp(time, at, x) for x in places.T], -1)
        for places in (np.array([_target(drives, rng) for _ in at]) for _ in range(2))
    )
    phase = turn[:, None]
    actions = share * (np.cos(phase) * one + np.sin(phase) * other)
    return _possible(drives, _from_rest(drives, actions)), 0


def _target(drives: Drives, rng: Generator) -> ndarray:
    """Coordinates (m,) of an action of the workspace."""
    return drives.targets[rng.integers(1, len(drives.targets))]


def _from_rest(drives: Drives, actions: ndarray) -> ndarray:
    """Actions (t, m) that begin at zero."""
    begin = np.linspace(0, 1, round(2 * drives.first / drives.period))[:, None]
    fade = np.ones((len(actions), 1))
    fade[: len(begin)] = quintic_step(begin)[1][: len(fade)]
    return fade * actions


def _possible(drives: Drives, actions: ndarray) -> ndarray:
    """Actions (t, m) that are in [-1, 1], and that the drives can follow."""
    change = actions @ drives.basis.T
    room = np.where(change > 0, 1 - drives.rest, 1 + drives.rest) / np.maximum(abs(change), 1e-12)
    actions = actions * np.minimum(room.min(axis=1, keepdims=True), 1.0)
    if not np.isfinite(drives.rate).all():
        return actions
    most = _FASTEST * drives.rate * drives.period
    out, now = np.empty_like(actions), np.zeros(actions.shape[1])
    for k, wanted in enumerate(actions):
        change = wanted - now
        share = np.max(np.abs(drives.basis @ change) / most)
        now = now + change / max(share, 1.0)
        out[k] = now
    return out


_KINDS = {"random": _random, "laps": _laps}
