"""Random tasks within a robot's workspace, so that a policy learns more than a few references."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from softrobot_env.beams.closed_forms.constant_curvature import ConstantCurvatureStatics
from softrobot_env.envs.observations.table import REFERENCE_SPEED
from softrobot_env.robots import ARM, RobotParams
from softrobot_env.tasks import Task, make_task
from softrobot_env.tasks.generic import generic_tasks, site_of
from softrobot_env.tasks.trajectories import Polyline, Step

#: Inputs [N] of random postures: a common part within +-, and the deviation of each from it, drawn
#: between two values, as simple bends and S-shapes both occur.
_COMMON, _EACH = 14.0, (2.0, 16.0)

_STATICS = ConstantCurvatureStatics(ARM)

_KNOT = 0.01  # s, between the knots of a smooth reference

#: Of smooth references: harmonics of the inputs, and speeds [m/s] at the fastest point.
_HARMONICS, _SPEEDS = 3, (0.03, 0.6)

#: Of any robot: share of set points among the tasks, and how long they are held, in periods of the
#: first mode; sizes of random paths over the default, and laps in a period of the first mode.
_REACHES, _HOLDS = 0.25, (1.0, 4.0)
#: A random path gets as far as its size at one point only; the largest ones are often that far out.
_RADII, _PACES = (0.4, 0.7, 1.0, 1.4), (0.05, 0.5)

#: Share of circles among the paths: random ones are seldom far out for long.
_CIRCLES = 0.3

#: Largest speed of such a path, over that which environments take.
_SPEED = 0.99

#: Laps of the circle in a period of the first mode on which networks are judged.
_CHECKED = (0.1, 0.3)


def random_input(rng: np.random.Generator) -> np.ndarray:
    """Reduced inputs (3,) [N] of a posture within the workspace."""
    return rng.uniform(-_COMMON, _COMMON) + rng.normal(0, rng.uniform(*_EACH), 3)


def tips(inputs: np.ndarray) -> np.ndarray:
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
        way = np.linalg.norm(np.diff(tips(np.array(inputs[-2:])), axis=0))
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

    def inputs(turn: np.ndarray) -> np.ndarray:
        angle = np.multiply.outer(order, turn) + phase[:, None]
        return middle + np.sum(size * np.sin(angle)[:, :, None] / order[:, None, None], axis=0)

    turn = np.linspace(0, 2 * np.pi, 200)
    fastest = np.linalg.norm(np.gradient(tips(inputs(turn)), turn, axis=0), axis=1).max()
    rate = np.exp(rng.uniform(*np.log(_SPEEDS))) / fastest
    times = np.arange(0, duration + 2 * _KNOT, _KNOT)
    path = Polyline(tuple(map(tuple, tips(inputs(rate * times)))), tuple(times))
    return Task("random waves", ARM, path, duration, tuple(inputs(np.zeros(1))[0]))


def draw_task(rng: np.random.Generator, duration: float, robot: RobotParams = ARM) -> Task:
    """A random task; of the arm sometimes one of the three with another start or step width."""
    if robot != ARM:
        return any_task(rng, robot)
    return known_task(rng, duration) if rng.uniform() < 0.25 else draw_reference(rng, duration)


def any_task(rng: np.random.Generator, robot: RobotParams) -> Task:
    """A random path or a circle at a random size and pace, or set points, of any robot."""
    site, seed = site_of(robot), int(rng.integers(2**31))
    if site.ground.radius == 0 or rng.uniform() < _REACHES:
        hold = rng.uniform(*_HOLDS) / site.frequency
        return generic_task("reach", robot, seed=seed, hold=hold)
    name = "circle" if rng.uniform() < _CIRCLES else "random"
    own = {"seed": seed} if name == "random" else {}
    size = float(rng.choice(_RADII))
    own["radius"], pace = size * _usual_radius(name, robot), rng.uniform(*_PACES) / max(size, 1.0)
    task = generic_task(name, robot, frequency=pace, **own)
    most = _SPEED * REFERENCE_SPEED * robot.reach
    if task.trajectory.speed <= most:
        return task
    return generic_task(name, robot, frequency=pace * most / task.trajectory.speed, **own)


def generic_task(name: str, robot: RobotParams, **options: float) -> Task:
    """A task that any robot can be given, even where the robot has one of its own by this name."""
    return make_task(name, among=generic_tasks(robot), **options)


@lru_cache(maxsize=8)
def _usual_radius(name: str, robot: RobotParams) -> float:
    """Default radius [m] of a path."""
    return float(generic_task(name, robot).option("radius"))


def check_tasks(robot: RobotParams) -> list[Task]:
    """The tasks on which networks of a robot are judged; of the arm the thesis'."""
    if robot == ARM:
        steps = [make_task("step", width) for width in (0.05, 0.1, 0.2)]
        return [make_task("swing"), make_task("lshape"), *steps]
    if site_of(robot).ground.radius == 0:
        return [generic_task("reach", robot)]
    paced = [generic_task("circle", robot, frequency=pace) for pace in _CHECKED]
    return [*paced, generic_task("figure_eight", robot), generic_task("random", robot, seed=0)]


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
