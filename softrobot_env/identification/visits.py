"""Quasi-static visits of the spatial rig: where to go, by which lengths, and what is measured.

Thesis sec. 3.2.2. Points are spread evenly over the workspace; the statics of the nominal rig, one
piece of constant curvature, tell the lengths that put its output there with the least tensions
(the set S_red of sec. 3.1.2). The rig visits these lengths in turn and its output is measured.

A twin is measured as the real rig is, by its servos and its camera: nothing is known of it but what
`RigEnv` shows. A long visit is cut into runs, each from the straight pose. At 2.6 s a point, the
215 points of a network take nine minutes on a rig; the thesis tells five.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, pi, sqrt

import numpy as np

from softrobot_env.control.rig.servo_constraints import ServoConstraints
from softrobot_env.envs.rig import RigEnv
from softrobot_env.fields import Count, NotNegative, check_fields
from softrobot_env.robots import RIG, RobotParams
from softrobot_env.robots.twin import Twin
from softrobot_env.tasks import LONGEST, SetPoints, Task

#: Number of points, and radius [m] of the disk they fill (audit: usable workspace).
POINTS = 926
RADIUS = 0.121

#: Shares of the data to validate and to test with; the rest is for training.
_VALIDATION, _TEST = 0.15, 0.15

_GOLDEN_ANGLE = pi * (3 - sqrt(5))

#: [s], of the commands to the servos and of the pictures that are used.
PERIOD = 0.02

_DITHER_FREQUENCY = 5.0  # Hz
_DITHERED = 0.8  # of the rest

#: Outputs (n, 2) [m] beside the axis at lengths (n, 3) [m] pulled in, visited in turn from the
#: straight rig on. Friction makes the order matter, and the rig sways for seconds: move slowly from
#: each to the next, on a straight line in the lengths, and wait for rest before measuring.
Measure = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class RigData:
    """What a visit of all points found; rows in the order of the visit.

    Attributes:
        lengths: s (n, 3) [m], pulled in.
        nominal: (n, 2) [m], output of the nominal rig.
        measured: z (n, 2) [m].
    """

    lengths: np.ndarray
    nominal: np.ndarray
    measured: np.ndarray


@dataclass(frozen=True)
class Split:
    """Indices of the samples for each purpose, in random order."""

    training: np.ndarray
    validation: np.ndarray
    test: np.ndarray


def disk_points(count: int = POINTS, radius: float = RADIUS) -> np.ndarray:
    """Points (count, 2) [m] that fill a disk evenly: Vogel's sunflower.

    Each stands for the same area: point i is in the middle of the i-th of `count` rings of equal
    area, and the golden angle further round than the one before (Vogel, Mathematical Biosciences
    44 (1979) 179-189).

    Raises:
        ValueError: No points, or no positive radius.
    """
    if count < 1 or not 0 < radius < np.inf:
        raise ValueError(
            f"need one point or more and a positive radius, got {count} and {radius} m"
        )
    i = np.arange(count)
    distance = radius * np.sqrt((i + 0.5) / count)
    angle = _GOLDEN_ANGLE * i
    return np.column_stack([distance * np.cos(angle), distance * np.sin(angle)])


def nominal_lengths(
    robot: RobotParams, points: np.ndarray, total: float | None = None
) -> np.ndarray:
    """Lengths (n, 3) [m] that hold the output of a rig at points (n, 2) [m].

    Args:
        robot: The rig.
        points: Where its output is to be.
        total: Sum of the tensions [N] that chooses one of the many solutions, as in thesis sec.
            5.1. Unless given it is the least tensions that respect the pretension, S_red; these
            have kinks where another tendon becomes the loosest, which smooth networks round off.

    Raises:
        OutOfReachError: A point is out of reach.
        ValueError: The robot is no rig with three elastic tendons, or the sum is too small.
    """
    still = np.zeros_like(points)
    servo = ServoConstraints(robot)
    inverse = servo.plan(points, still, still)
    if total is None:
        return inverse.pulled
    tension = servo.tendons.tension(inverse.reduced, total)
    return servo.tendons.pulled(tension, servo.curvature(inverse.y))


def collect(
    robot: RobotParams,
    measure: Measure,
    rng: np.random.Generator,
    points: np.ndarray | None = None,
    total: float | None = None,
) -> RigData:
    """Visit points in random order and measure.

    In the sunflower's own order every point is reached from the same side, as seen from the
    centre, and the network learns the hysteresis of that side as if it were statics.

    Args:
        robot: The nominal rig.
        measure: See `Measure`.
        rng: Source of the order.
        points: (n, 2) [m]; `disk_points` unless given.
        total: See `nominal_lengths`.

    Raises:
        OutOfReachError: A point is out of the nominal rig's reach.
        ValueError: As `nominal_lengths`, or the measurement is not finite or of another shape than
            (n, 2).
    """
    wanted = rng.permutation(disk_points() if points is None else points)
    lengths = nominal_lengths(robot, wanted, total)
    measured = np.asarray(measure(lengths), dtype=float)
    if measured.shape != wanted.shape or not np.all(np.isfinite(measured)):
        raise ValueError(
            f"measure must return finite outputs of shape {wanted.shape}, got shape "
            f"{measured.shape} with {np.sum(~np.isfinite(measured))} values that are not finite"
        )
    return RigData(lengths, wanted, measured)


def split(count: int, rng: np.random.Generator) -> Split:
    """70 % of the samples to train, 15 % each to validate and to test.

    Raises:
        ValueError: Too few samples for one of each.
    """
    validation, test = round(_VALIDATION * count), round(_TEST * count)
    training = count - validation - test
    if min(training, validation, test) < 1:
        raise ValueError(f"cannot split {count} samples 70/15/15; give at least 4")
    return Split(*np.split(rng.permutation(count), [training, training + validation]))


@dataclass(frozen=True)
class Visit:
    """How a point is visited.

    Attributes:
        move: [s] to go there, by the smooth step 10 s^3 - 15 s^4 + 6 s^5 in the lengths.
        rest: [s] until the rig, which sways at 1.6 Hz with a fifth of the critical damping, is
            still.
        dither: [m], amplitude of a swing of all servos at once that dies away during the rest. It
            hardly bends the rig, but brings the horns to the middle of their backlash, from
            whichever side they came.
        pictures: Number of the camera's pictures that are averaged then, one per control period.
    """

    move: NotNegative = 1.2
    rest: NotNegative = 1.2
    dither: NotNegative = 0.6e-3
    pictures: Count = 10

    def __post_init__(self) -> None:
        check_fields(self, "visit")


def measure(
    twin: Twin | int | None,
    lengths: np.ndarray,
    seed: int = 0,
    visit: Visit = Visit(),
    progress: Callable[[int], None] | None = None,
) -> np.ndarray:
    """Outputs (n, 2) [m] of a twin at lengths (n, 3) [m], visited in turn.

    Args:
        twin: The rig, or the seed of one; see `RigEnv`.
        lengths: Pulled in.
        seed: Of the camera's noise.
        visit: How to visit a point.
        progress: Called with the number of points visited in a run, or None.

    Raises:
        ValueError: Lengths of another shape, or beyond what the servos can pull in.
        RuntimeError: The simulation failed.
    """
    lengths = np.asarray(lengths, dtype=float)
    scale = RigEnv.length_scale
    if lengths.ndim != 2 or lengths.shape[1] != len(RIG.tendons) or not len(lengths):
        raise ValueError(f"need lengths of shape (n, {len(RIG.tendons)}), got {lengths.shape}")
    if not np.all(np.abs(lengths) <= scale):
        raise ValueError(f"lengths must lie within {scale:g} m, the servos' limit")
    runs = ceil(len(lengths) / int(LONGEST / visit_duration(visit, 1)))
    parts, seeds = np.array_split(lengths, runs), np.random.SeedSequence(seed).spawn(runs)
    found = (_run(twin, visit, *one, progress) for one in zip(parts, seeds, strict=True))
    return np.concatenate(list(found))


def visit_duration(visit: Visit, points: int) -> float:
    """Time [s] that a run takes at most."""
    return points * (visit.move + visit.rest + PERIOD * visit.pictures + 3 * PERIOD)


def _run(
    twin: Twin | int | None,
    visit: Visit,
    lengths: np.ndarray,
    seed: np.random.SeedSequence,
    progress: Callable[[int], None] | None,
) -> np.ndarray:
    """Outputs (n, 2) [m] of a run from the straight pose."""
    env = started(twin, visit_duration(visit, len(lengths)), int(seed.generate_state(1)[0]))
    now, outputs = np.zeros(lengths.shape[1]), np.empty((len(lengths), 2))
    for i, there in enumerate(lengths / env.length_scale):
        outputs[i] = go(env, now, there, visit)
        now = there
        if progress is not None:
            progress(i + 1)
    return outputs


def started(twin: Twin | int | None, duration: float, seed: int) -> RigEnv:
    """A rig in the straight pose, with nothing to follow for `duration` [s]."""
    still = SetPoints(((0.0, 0.0, 0.0),), 1.0)
    env = RigEnv(
        Task("visit", RIG, still, duration, (0.0, 0.0, 0.0), axes="xy"),
        twin=twin,
        control_period=PERIOD,
        observe=("tip_position",),
        preview=(PERIOD,),
    )
    env.reset(seed=seed)
    return env


def go(env: RigEnv, here: np.ndarray, there: np.ndarray, visit: Visit) -> np.ndarray:
    """Output (2,) [m] after a move from one action to another (3,) and a rest."""
    share = np.linspace(0, 1, max(1, round(visit.move / PERIOD)) + 1)[1:]
    rise = share**3 * (10 - 15 * share + 6 * share**2)
    for action in (here + rise[:, None] * (there - here)).astype(np.float32):
        step(env, action)
    action = there.astype(np.float32)
    for swing in _dither(visit) / env.length_scale:
        step(env, np.clip(there + swing, -1, 1).astype(np.float32))
    return np.mean([step(env, action) for _ in range(visit.pictures)], axis=0)


def _dither(visit: Visit) -> np.ndarray:
    """Lengths (k,) [m] on top of those wanted, in the control periods of the rest."""
    time = PERIOD * np.arange(round(visit.rest / PERIOD))
    fading = np.maximum(0.0, 1 - time / (_DITHERED * visit.rest))
    return visit.dither * fading * np.sin(2 * np.pi * _DITHER_FREQUENCY * time)


def step(env: RigEnv, action: np.ndarray) -> np.ndarray:
    """The picture after a control period."""
    observation, _, failed, _, info = env.step(action)
    if failed:
        raise RuntimeError(info["failure"])
    return observation["tip_position"]
