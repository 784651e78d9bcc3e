"""Random tasks within the arm's workspace, so that a policy learns more than three references."""

from dataclasses import replace

import numpy as np

from softrobot_env.beams import planar_arm
from softrobot_env.beams.planar_arm import make_planar_arm
from softrobot_env.robots import ARM
from softrobot_env.tasks import Task, make_task
from softrobot_env.trajectories import Polyline, Step

#: Inputs [N] of random postures: a common part within +-, and the deviation of each from it.
_COMMON, _EACH = 14.0, 4.0

_KNOT = 0.02  # s, between the knots of a smooth reference


def random_input(rng: np.random.Generator) -> np.ndarray:
    """Reduced inputs (3,) [N] of a posture within the workspace."""
    return rng.uniform(-_COMMON, _COMMON) + rng.normal(0, _EACH, 3)


def tips(inputs: np.ndarray) -> np.ndarray:
    """Tips (k, 3) [m] at rest under inputs (k, 3) [N], of the nominal arm."""
    arm = make_planar_arm(ARM)
    curvature = inputs @ arm.inputs.T / arm.stiffness
    out, jacobian, point = np.zeros((len(inputs), 3)), np.empty((2, arm.n)), np.empty(2)
    for row, bent in zip(out, curvature, strict=True):
        planar_arm.tip(arm, bent, point, jacobian)
        row[0::2] = point
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
    """Smooth motion: slow sinusoids of the inputs that would hold the tip there."""
    times = np.arange(0, duration + 2 * _KNOT, _KNOT)
    inputs = np.tile(random_input(rng), (len(times), 1))
    for _ in range(3):
        frequency, phase = rng.uniform(0.05, 0.5), rng.uniform(0, 2 * np.pi)
        size = rng.normal(0, 0.8 / (0.3 + frequency), (1, 3)) + rng.normal(0, 1.0)
        inputs += size * np.sin(2 * np.pi * frequency * times[:, None] + phase)
    path = Polyline(tuple(map(tuple, tips(inputs))), tuple(times))
    return Task("random waves", ARM, path, duration, tuple(inputs[0]))


def draw_task(rng: np.random.Generator, duration: float) -> Task:
    """A random task, or one of the three with another start or step width."""
    kind = rng.choice(["step", "legs", "waves", "known"], p=[0.3, 0.2, 0.2, 0.3])
    if kind == "known":
        return known_task(rng, duration)
    return {"step": random_step, "legs": random_legs, "waves": random_waves}[kind](rng, duration)


def known_task(rng: np.random.Generator, duration: float) -> Task:
    """One of the three tasks, a step of random width."""
    name = rng.choice(["step", "swing", "lshape"])
    if name == "step":
        return replace(make_task("step", rng.uniform(0.02, 0.22)), duration=duration)
    return make_task(str(name))
