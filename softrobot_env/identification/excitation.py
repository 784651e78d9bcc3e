"""Motions that excite a robot for an identification, within limits of tension, speed and reach.

Each tendon in turn bends the robot. If it is driven by length, the tendon is pulled in, and the
others are let out or in as a uniform bend towards it requires, so that they neither slacken nor
tear; if it is driven by tension, each input is raised to both sides. The statics of the nominal
robot determine how far it can go within the limits. A rig also visits points throughout its
workspace, found by its statics, see `visits`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from math import ceil, inf
from typing import Annotated, Any, Literal

import gymnasium
import numpy as np
from numpy import ndarray
from numpy.linalg import norm

from softrobot_env.core.equilibrium import EquilibriumError
from softrobot_env.core.records import Count, NotNegative, Positive, Range, Whole, check_fields
from softrobot_env.recordings import Recording
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.registry import model_scene
from softrobot_env.tasks import LONGEST, Task
from softrobot_env.tasks.trajectories import SetPoints

from .visits import RADIUS, TOTAL, VISIT, disk_points, nominal_lengths

Kind = Literal["pulls", "steps", "random", "visits"]
KINDS = ("pulls", "steps", "random", "visits")

#: Points of a visit: 150 to train a network with, and 15 % each to watch and to test (sec. 5.1.1).
POINTS = 215

_PEAK = 1.875  # largest rate of the smooth step, over its mean
_FASTEST = 0.8  # of the drive's speed
_SINES = 8  # of each direction of a random motion
_SPANS = 200  # of an integral along a tendon
_HALVINGS = 7
_ROOM = 1.25  # times the limits, at which a run is stopped
_SHOWN = 50  # steps between two reports of progress
_MEASURED = 0.2  # s at the end of a rest, over which a static row is averaged

_DITHER, _DITHER_TIME, _DITHER_FREQUENCY = 0.02, 0.96, 5.0  # of full scale, s, Hz

_GOING, _STAYING = 1.2, 0.8  # s, of a visit; a rig oscillates at 1.6 Hz with a damping ratio of 0.2

_Share = Annotated[float, Range("in (0, 1]", lambda x: 0 < x <= 1)]


@dataclass(frozen=True)
class Excitation:
    """Settings of an excitation.

    Attributes:
        kinds: In this order: "pulls" of one tendon after the other, slowly up and down in levels
            with a rest at each; "steps", decays after a dithered pull is released at once; "random"
            smooth motion in all directions at once; and, for a rig only, "visits" of points
            throughout its workspace, in random order, with a constant sum of tensions: networks
            trained on such data have half the error of those with the least tensions, whose kinks
            they smooth out.
        amplitude: Largest share of full scale, except for visits; less where a limit is reached.
            Before steps, lengths are dithered by another 0.02.
        speed: [1/s], largest share of full scale per second, except for visits; at most 0.8 of the
            drives' speed. Friction and backlash are identified best if the robot does not oscillate
            before it rests.
        levels: Of a pull.
        rest: [s] at each level, and at least between motions.
        decay: [s] after a release.
        duration: [s] of the random motion.
        bandwidth: [Hz], largest frequency of the random motion; less if it would be too fast.
        points: Number of visited points; the thesis has 926.
        seed: Of the random motion and the order of visits.
        tension: Largest tension, over the tendons' limits.
        radius: [m], largest distance of the tip from its rest; by default inf.
    """

    kinds: tuple[Kind, ...] = ("pulls", "random")
    amplitude: _Share = 0.5
    speed: Positive = 0.25
    levels: Count = 4
    rest: NotNegative = 1.0
    decay: NotNegative = 3.0
    duration: NotNegative = 30.0
    bandwidth: Positive = 0.5
    points: Count = POINTS
    seed: Whole = 0
    tension: _Share = 0.5
    radius: Annotated[float, Range("positive, or inf", lambda x: x > 0)] = inf

    def __post_init__(self) -> None:
        check_fields(self, "excitation")
        if not self.kinds:
            raise ValueError(f"excitation: choose kinds from {', '.join(KINDS)}")


@dataclass(frozen=True)
class Plan:
    """Commands of an excitation.

    Attributes:
        actions: (t, n_inputs), each for a control period.
        labels: (t,) str, the pattern.
        measured: (t,) index of the rest at whose end the robot is still, or -1.
        scales: (d,) share of full scale reached in each direction.
        period: [s].
    """

    actions: ndarray
    labels: ndarray
    measured: ndarray
    scales: ndarray
    period: float

    @property
    def duration(self) -> float:
        """[s]."""
        return len(self.actions) * self.period


def plan(robot: RobotParams, excitation: Excitation, period: float) -> Plan:
    """The actions of an excitation, from rest to rest.

    Args:
        robot: The nominal robot.
        excitation: What to do.
        period: [s], control period.

    Raises:
        ValueError: The robot has no inputs, the plan exceeds the longest episode, or every motion
            violates a limit.
    """
    inputs = robot_inputs(robot)
    ways = directions(robot)
    scales = safe_scales(robot, list(ways.values()), excitation)
    moves = _Moves(robot, excitation.speed, period)
    peaks = {n: s * way for (n, way), s in zip(ways.items(), scales, strict=True)}
    for kind in excitation.kinds:
        _KINDS[kind](moves, peaks, excitation)
    rows, labels, measured = moves.result()
    actions = inputs.to_actions(rows)
    found = Plan(np.clip(actions, -1, 1), labels, measured, scales, period)
    if found.duration > LONGEST:
        raise ValueError(
            f"the excitation takes {found.duration:.0f} s, an episode at most {LONGEST:g} s: fewer "
            "levels, less rest, more speed"
        )
    return found


def directions(robot: RobotParams) -> dict[str, ndarray]:
    """Inputs (n_inputs,) at full scale that bend a robot towards each tendon, by name.

    Raises:
        ValueError: The robot has no tendons.
    """
    inputs = robot_inputs(robot)
    if not inputs.n_inputs:
        raise ValueError(f"robot {robot.name!r} has no tendons to pull")
    if robot.drive.kind == "length":
        found = {t.name: _bend_towards(robot, k) for k, t in enumerate(robot.tendons)}
        return {n: way / np.max(np.abs(way) / inputs.input_scale) for n, way in found.items()}
    ways = {}
    for k, (scale, opposed) in enumerate(zip(inputs.input_scale, inputs.opposed, strict=True)):
        unit = np.eye(inputs.n_inputs)[k] * scale
        sides = (1, -1) if opposed else (1,)
        ways |= {f"input{k + 1}{'+' if side > 0 else '-'}": side * unit for side in sides}
    return ways


def _bend_towards(robot: RobotParams, tendon: int) -> ndarray:
    """Unscaled lengths (n_tendons,) for a uniform bend towards a tendon, up to its end."""
    pulled = robot.tendons[tendon]
    s = (np.arange(_SPANS) + 0.5) * pulled.end / _SPANS
    towards = pulled.at(s)
    towards = towards / np.maximum(norm(towards, axis=-1, keepdims=True), 1e-300)
    return np.array([np.sum(t.at(s) * towards, axis=-1)[s < t.end].sum() for t in robot.tendons])


def safe_scales(robot: RobotParams, ways: list[ndarray], limits: Excitation) -> ndarray:
    """Largest shares (d,) of inputs (n_inputs,) that keep a robot at rest within limits.

    Raises:
        ValueError: One of them is not safe at any scale.
    """
    safe = _judge(robot, limits)
    scales = [_largest(partial(safe, way), limits.amplitude) for way in ways]
    if min(scales) == 0:
        raise ValueError(
            f"robot {robot.name!r} breaks a limit however little it moves: allow more tension than "
            f"{limits.tension:g} of the tendons' limits, or a radius above {limits.radius:g} m"
        )
    return np.array(scales)


def _judge(robot: RobotParams, limits: Excitation) -> Callable[[ndarray, float], bool]:
    """Whether the nominal robot at rest keeps within limits under a share of inputs (n_inputs,)."""
    config = replace(model_scene(robot), sensors=())
    scene, inputs = build_scene(config), robot_inputs(robot)
    stiffness, pretension = map(config.robot.of_tendons, ("stiffness", "pretension"))
    straight = scene.tendon_length(scene.model.qpos_spring)

    def tension_of(command: ndarray, q: ndarray) -> ndarray:
        if inputs.unit == "N":
            return command
        stretch = command - straight + scene.tendon_length(q)
        return np.maximum(pretension + stiffness * stretch, 0.0)

    idle = inputs.command(np.zeros(inputs.n_inputs))
    posture = scene.equilibrium(idle)
    rest = scene.tip(posture)
    allowed = limits.tension * robot.of_tendons("tension_limit")
    most = np.maximum(allowed, tension_of(idle, posture))

    def safe(way: ndarray, share: float) -> bool:
        command = inputs.command(share * way)
        try:
            q = scene.equilibrium(command, posture)
        except (EquilibriumError, ValueError):
            return False
        near = norm(scene.tip(q) - rest) <= limits.radius
        return bool(near and np.all(tension_of(command, q) <= most))

    return safe


def _largest(holds: Callable[[float], bool], most: float) -> float:
    """The largest share up to `most` that holds, to a hundredth of it; 0 where none does."""
    if holds(most):
        return most
    low, high = 0.0, most
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


class _Moves:
    """A sequence of inputs (n_inputs,) with limited speed [1/s] of full scale."""

    def __init__(self, robot: RobotParams, speed: float, period: float) -> None:
        self.robot, self.scale, self.period = robot, robot_inputs(robot).input_scale, period
        self._fastest = _FASTEST * robot.drive.speed / float(self.scale.max())
        self.speed = min(speed, self._fastest)
        self.here = np.zeros_like(self.scale)
        self._parts: list[tuple[ndarray, str, int]] = []
        self._rests = 0

    def go(self, there: ndarray, label: str, time: float | None = None) -> None:
        """Move smoothly, in a given time [s] if the drives allow it; or jump, in zero time."""
        way = _PEAK * float(np.max(np.abs(there - self.here) / self.scale))
        lasts = way / self.speed if time is None else max(time, way / self._fastest if time else 0)
        steps = max(1, ceil(lasts / self.period - 1e-9))
        share = np.linspace(0, 1, steps + 1)[1:, None]
        rise = share**3 * (10 - 15 * share + 6 * share**2)
        self.follow(self.here + rise * (there - self.here), label)
        self.here = there

    def follow(self, rows: ndarray, label: str) -> None:
        """Follow inputs (k, n_inputs)."""
        self._parts.append((rows, label, -1))

    def dither(self, label: str) -> None:
        """Oscillate all length drives together, with decreasing amplitude.

        It hardly bends the robot, but brings drives to the middle of their backlash and tendons to
        the middle of their friction, from either side.
        """
        if self.robot.drive.kind != "length":
            return
        most = min(_DITHER, self._fastest / (2 * np.pi * _DITHER_FREQUENCY))
        time = self.period * np.arange(round(_DITHER_TIME / self.period))
        swing = (1 - time / _DITHER_TIME) * np.sin(2 * np.pi * _DITHER_FREQUENCY * time)
        self.follow(self.here + most * np.outer(swing, self.scale), label)

    def rest(self, time: float, label: str, measured: bool = True) -> None:
        """Stay for some time [s]."""
        steps = round(time / self.period)
        last = min(steps, max(1, round(_MEASURED / self.period))) if measured else 0
        for count, rest in ((steps - last, -1), (last, self._rests)):
            if count:
                self._parts.append((np.tile(self.here, (count, 1)), label, rest))
        self._rests += last > 0

    def result(self) -> tuple[ndarray, ndarray, ndarray]:
        """Inputs (t, n_inputs), labels (t,) and rests (t,)."""
        rows, labels, rests = zip(*self._parts, strict=True)
        counts = [len(part) for part in rows]
        return np.concatenate(rows), np.repeat(labels, counts), np.repeat(rests, counts)


def _pulls(moves: _Moves, peaks: dict[str, ndarray], excitation: Excitation) -> None:
    levels = np.arange(1, excitation.levels + 1) / excitation.levels
    for name, peak in peaks.items():
        label = f"pull_{name}"
        for share in (*levels, *levels[-2::-1], 0.0):
            moves.go(share * peak, label)
            moves.rest(excitation.rest, label)


def _steps(moves: _Moves, peaks: dict[str, ndarray], excitation: Excitation) -> None:
    for name, peak in peaks.items():
        label = f"step_{name}"
        moves.go(peak, label)
        moves.dither(label)
        moves.rest(max(excitation.rest, excitation.decay), label)
        moves.go(np.zeros_like(peak), label, time=0)
        moves.rest(excitation.decay, label)


def _random(moves: _Moves, peaks: dict[str, ndarray], excitation: Excitation) -> None:
    """Sums of sines, whose shares of the directions' peaks are at most one together."""
    count = round(excitation.duration / moves.period)
    if not count:
        return
    rng, ways = np.random.default_rng(excitation.seed), np.array(list(peaks.values()))
    frequency = rng.uniform(0.1, 1.0, (_SINES, len(ways)))
    phase = rng.uniform(0, 2 * np.pi, (_SINES, len(ways)))
    time = np.arange(count) * moves.period

    def motion(bandwidth: float) -> ndarray:
        turns = 2 * np.pi * bandwidth * np.multiply.outer(time, frequency) + phase
        shares = np.maximum(np.sin(turns).sum(axis=1), 0.0)  # one tendon pulls, or its antagonist
        most = shares.sum(axis=1).max()
        if not most:
            raise ValueError(
                f"a random motion of {excitation.duration:g} s at {bandwidth:.3g} Hz pulls at no "
                "tendon: give a longer duration, or another seed"
            )
        shares = shares / most
        fade = np.clip(np.minimum(time, time[::-1]) * bandwidth, 0, 1)[:, None]
        return (fade**3 * (10 - 15 * fade + 6 * fade**2) * shares) @ ways

    rows = motion(excitation.bandwidth)
    rate = np.max(np.abs(np.diff(rows, axis=0, prepend=0)) / moves.scale) / moves.period
    if rate > moves.speed:
        rows = motion(excitation.bandwidth * moves.speed / float(rate))
    moves.follow(rows, "random")
    moves.rest(excitation.rest, "random")


def _visits(moves: _Moves, peaks: dict[str, ndarray], excitation: Excitation) -> None:
    """Points in random order, for the reasons given in `visits.collect`."""
    points = disk_points(excitation.points, min(RADIUS, excitation.radius))
    order = np.random.default_rng(excitation.seed).permutation(points)
    for lengths in nominal_lengths(moves.robot, order, TOTAL):
        moves.go(lengths, VISIT, _GOING)
        moves.dither(VISIT)
        moves.rest(_STAYING, VISIT)
    moves.go(np.zeros_like(moves.scale), VISIT, _GOING)


_KINDS: dict[str, Callable[[_Moves, dict[str, ndarray], Excitation], None]] = {
    "pulls": _pulls,
    "steps": _steps,
    "random": _random,
    "visits": _visits,
}


def resting_task(robot: RobotParams, duration: float, axes: str | None = None) -> Task:
    """A task without a reference motion, from rest under zero inputs.

    Args:
        robot: Its robot.
        duration: [s].
        axes: Measured coordinates of the tip; by default x and z for a planar robot, else all.
    """
    chosen = axes or ("xz" if robot.moves_in_xz else "xyz")
    zero = (0.0,) * robot_inputs(robot).n_inputs
    still = SetPoints((robot.clamp.position,), 1.0)
    return Task("record", robot, still, duration, zero, axes=chosen)


def excite(
    env: gymnasium.Env,
    plan: Plan,
    limits: Excitation,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
    progress: Callable[[int], None] | None = None,
) -> str | None:
    """Drive an environment through a plan; stop if a limit is exceeded by a quarter.

    Args:
        env: Environment, usually a `RecordEpisodes`, whose `label` is updated.
        plan: The commands.
        limits: Of tension and radius, see `Excitation`.
        seed, options: Of the reset.
        progress: Called occasionally with the number of steps.

    Returns:
        Why it ended early, or None.
    """
    env.label = str(plan.labels[0])
    observation, _ = env.reset(seed=seed, options=options)
    begin = observation["tip_position"].copy()
    most = env.unwrapped.task.robot.of_tendons("tension_limit")
    for k, (action, label) in enumerate(zip(plan.actions, plan.labels, strict=True)):
        env.label = str(label)
        observation, _, terminated, truncated, info = env.step(action.astype(np.float32))
        far = float(norm(observation["tip_position"] - begin))
        reason = info.get("failure") or _beyond(far, info["tendon_tension"], most, limits)
        if reason:
            return f"after {(k + 1) * plan.period:.2f} s: {reason}"
        if progress is not None and k % _SHOWN == 0:
            progress(k + 1)
        if terminated or truncated:  # in real time a slow machine skips periods
            break
    return None


def _beyond(far: float, tension: ndarray, most: ndarray, limits: Excitation) -> str | None:
    """Why a robot is too far out or pulls too hard, or None; unknown tensions are NaN."""
    if far > _ROOM * limits.radius:
        return f"the tip is {1e3 * far:.4g} mm from where it rested"
    hard = np.flatnonzero(np.asarray(tension) > min(_ROOM * limits.tension, 1.0) * most)
    if len(hard):
        k = int(hard[0])
        return f"tendon {k + 1} pulls {tension[k]:.3g} N of at most {most[k]:.3g} N"
    return None


def at_rests(recording: Recording, plan: Plan) -> tuple[Recording, float]:
    """The static recording of a run: one row for each rest, with markers averaged over its end.

    Args:
        recording: Of one run of the plan: its start and at most one row for each action.
        plan: The commands.

    Returns:
        The recording, and the largest motion [m] of a marker at the end of a rest, noise included.

    Raises:
        ValueError: The robot never rested.
    """
    rests = np.append(-1, plan.measured)[: len(recording.times)]
    numbers = np.unique(rests[rests >= 0])
    if not len(numbers):
        raise ValueError("the robot never rested: give a rest, and pulls or steps")
    groups = [np.flatnonzero(rests == number) for number in numbers]
    ends = recording.part(np.array([group[-1] for group in groups]))
    markers = np.array([recording.markers[group].mean(axis=0) for group in groups])
    moved = max(float(np.nanmax(np.ptp(recording.markers[group], axis=0))) for group in groups)
    return replace(ends.with_header(static=True), markers=markers), moved
