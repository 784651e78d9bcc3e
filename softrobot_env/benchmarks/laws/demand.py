"""What a periodic reference asks of a robot's drives, whatever law follows it.

The inputs along a lap are those of the exact statics, plus what dynamics adds to them by the chain
linearised about the middle of the robot's ground: per harmonic, G(w)^-1 - G(0)^-1 times the path,
with least-norm inverses. That is the periodic, non-causal inverse, which exists whether or not the
internal dynamics are stable.
"""

from typing import NamedTuple

import numpy as np

from softrobot_env.robots import RobotParams
from softrobot_env.scene.linearised import linearised
from softrobot_env.tasks import Task
from softrobot_env.tasks.generic import ReachableRegion, generic_tasks, site_of

#: Instants of a lap.
_COUNT = 96

#: Largest share of the drives' limits that a path of a study asks for, and of its default radius
#: that is looked for at least.
_WITHIN, _LEAST = 0.9, 0.02
_TRIALS = 8


class Demand(NamedTuple):
    """Largest shares of limits that a lap at full rate asks for [1].

    Attributes:
        inputs: Of the inputs.
        speed: Of the speed of servos; zero of other drives.
    """

    inputs: float
    speed: float


def demand(task: Task) -> Demand:
    """What the laps of a generic task at a frequency ask for; errors as of `inputs_of_lap`."""
    lap, needed = inputs_of_lap(task)
    inputs, rates = site_of(task.robot).inverse.inputs, 2 * np.pi / lap * np.arange(_COUNT // 2 + 1)
    speed = np.fft.irfft(1j * rates[:, None] * np.fft.rfft(needed, axis=0), _COUNT, axis=0)
    return Demand(
        float((np.abs(needed - inputs.input_centre) / inputs.input_scale).max()),
        float(np.abs(speed).max() / task.robot.drive.speed),
    )


def inputs_of_lap(task: Task) -> tuple[float, np.ndarray]:
    """Duration [s] of a lap at full rate, and inputs (k, n_inputs) at equal instants of it.

    Raises:
        ValueError: The robot cannot hold its tip somewhere on the path.
    """
    site, run = site_of(task.robot), task.trajectory
    points = run.curve.derivative(2 * np.pi * np.arange(_COUNT) / _COUNT, 0)
    held = site.held_along(points, f"task {task.name!r}")[1]
    added = _added(site, run.rate, np.fft.rfft(points, axis=0))
    return 2 * np.pi / run.rate, held + np.fft.irfft(added, _COUNT, axis=0)


def _added(site: ReachableRegion, rate: float, path: np.ndarray) -> np.ndarray:
    """What dynamics adds to inputs (k, n_inputs), of a path (k, 3) [m], at multiples of a rate."""
    chain, directions = linearised(site.inverse, site.ground.inputs), site.inverse.directions
    still = np.linalg.pinv(directions @ chain.response(0.0))
    inverses = (np.linalg.pinv(directions @ chain.response(k * rate)) for k in range(len(path)))
    return np.stack([(g - still) @ directions @ p for g, p in zip(inverses, path, strict=True)])


def feasible_task(robot: RobotParams, name: str, frequency: float) -> tuple[Task, Demand]:
    """A generic task of the default radius, or a smaller one that its drives can follow.

    Raises:
        ValueError: None is found, or the robot has no room for it.
    """
    make = generic_tasks(robot)[name]
    task = make(frequency=frequency)
    first = least = task.option("radius")
    for _ in range(_TRIALS):
        asked = demand(task)
        if max(asked) <= _WITHIN:
            return task, asked
        least *= max(0.3, 0.95 * _WITHIN / max(asked))
        if least < _LEAST * first:
            break
        task = make(radius=float(f"{least:.2g}"), frequency=frequency)
    raise ValueError(
        f"task {name!r} at {frequency:g} of the first frequency asks robot {robot.name!r} for "
        f"{max(asked):.2g} times what its drives can do, with a radius of {1e3 * least:.2g} mm too"
    )
