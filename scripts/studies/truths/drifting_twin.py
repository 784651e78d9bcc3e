"""Recordings of twins whose servos and camera drift, in two parts: one to identify, one kept back.

A twin has errors of manufacturing, servos with backlash and zeros of their own, and tendons that
rub. It goes out and back in two directions at once, pattern by pattern; then from one posture to
another, which is kept back. Meanwhile the zeros of its servos and the camera's frame wander
(Ornstein and Uhlenbeck), so that each stretch of rows has offsets of its own.
"""

from dataclasses import replace

import numpy as np
from numpy import ndarray

from softrobot_env.identification.excitation import Excitation, directions, safe_scales
from softrobot_env.identification.replay import replay
from softrobot_env.recordings import Header, Recording
from softrobot_env.recordings.header import Commands, Marker
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import robot_inputs
from softrobot_env.robots.twin import sampled_twin

PATTERNS, KEPT = 24, 10
_ROWS = 8  # of a pattern
_LASTS = (10, 120)  # rows, the drift's correlation
_FRICTION = (0.5, 4.0)  # of a twin's usual one
_ZEROS, _FRAME = 0.02, 3e-3  # most: of the largest command; of the length
_NOISE = 0.3e-3  # m


def recorded(robot: RobotParams, seed: int) -> tuple[Recording, Recording]:
    """What is identified, and what is kept back."""
    rng = np.random.default_rng([seed, 3])
    commands, labels = _commands(robot, rng)
    names = robot.tendon_names
    known = Commands("length", names, "m", names)
    header = Header(known, (Marker("x", "y", "z"),), static=True, label="pattern", robot=robot.name)
    rows = len(commands)
    zeros = _ZEROS * rng.uniform() * np.abs(commands).max() * _wandering(rng, rows, len(names))
    series = {"commands": commands + zeros, "markers": np.zeros((rows, 1, 3))}
    told = {"times": np.arange(rows) * 1.0, "labels": labels, "runs": np.zeros(rows, int)}
    twin = sampled_twin(robot, seed)
    rubbing = twin.robot.vary(tendon_friction=float(np.exp(rng.uniform(*np.log(_FRICTION)))))
    moved = replay(Recording(header, **series, **told), robot, twin=replace(twin, robot=rubbing))
    frame = _FRAME * rng.uniform() * robot.length * _wandering(rng, rows, 3)
    seen = moved.simulated + (frame + _NOISE * rng.standard_normal((rows, 3)))[:, None]
    whole = replace(moved.recording, commands=commands, markers=seen)
    end = PATTERNS * _ROWS
    return whole.part(slice(0, end)), whole.part(slice(end, rows))


def _commands(robot: RobotParams, rng: np.random.Generator) -> tuple[ndarray, ndarray]:
    """Lengths (t, n_tendons) [m] and labels (t,)."""
    inputs, ways = robot_inputs(robot), list(directions(robot).values())
    scales = safe_scales(robot, ways, Excitation())
    peaks = np.array([inputs.command(s * way) for s, way in zip(scales, ways, strict=True)])
    targets = []
    for _ in range(PATTERNS + KEPT):
        one, other = rng.choice(len(ways), 2, replace=False)
        share = rng.uniform()
        targets.append(rng.uniform(0.4, 1) * (share * peaks[one] + (1 - share) * peaks[other]))
    out = np.linspace(0, 1, _ROWS // 2 + 1)[1:]
    there_and_back = np.concatenate([out, out[-2::-1], [0.0]])
    parts = [np.outer(there_and_back, target) for target in targets[:PATTERNS]]
    here, steps = np.zeros(len(inputs.command(0 * ways[0]))), np.linspace(0, 1, _ROWS + 1)[1:, None]
    for target in targets[PATTERNS:]:
        parts.append(here + steps * (target - here))
        here = target
    names = [f"pattern{k + 1}" for k in range(len(parts))]
    return np.concatenate(parts), np.repeat(names, [len(part) for part in parts])


def _wandering(rng: np.random.Generator, rows: int, count: int) -> ndarray:
    """(t, n) of standard deviation one, that last over some rows."""
    kept = np.exp(-1 / rng.uniform(*_LASTS))
    found = rng.standard_normal((rows, count))
    for row in range(1, rows):
        found[row] = kept * found[row - 1] + np.sqrt(1 - kept**2) * found[row]
    return found
