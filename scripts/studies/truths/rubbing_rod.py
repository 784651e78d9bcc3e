"""Recordings of a rod that is not the model's: Cosserat, with shear, stretch, friction and noise.

A slender rod with three tendons is pulled by each in levels with rests, then let go. It is
simulated by the Cosserat model; a tendon rubs like a spring that slides when its force reaches the
friction. The camera sees the tip with noise, late.
"""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.core.motion import State
from softrobot_env.recordings import Header, Recording
from softrobot_env.recordings.header import Commands, Marker, Time
from softrobot_env.robots import RobotParams, Tendon

_RADIUS, _LENGTH = 0.008, 0.2
_PLACES = ((_RADIUS * np.cos(a), _RADIUS * np.sin(a)) for a in 2 * np.pi * np.arange(3) / 3)
_TENDONS = tuple(
    Tendon(f"tendon{k}", place, _LENGTH, 0, 3.0, pretension=0.2)
    for k, place in enumerate(_PLACES, start=1)
)

#: What is believed: a polyurethane rod of 6 mm, standing, moved by tensions.
_MORE = {"poisson_ratio": 0.4, "tendons": _TENDONS, "gravity": (0.0, 0.0, -9.81)}
BELIEVED = RobotParams("rod", _LENGTH, 0.003, 0.0, 2e7, 1200.0, 0.06, 8, **_MORE)

NOISE = 0.3e-3  # m
_STEP = 0.002  # s, of the simulation, of which it takes a camera's picture every
_EVERY = 5
_LOOSE = 5e-5  # m
_MOVE, _REST, _DECAY = 0.9, 0.4, 1.2  # s
_LEVELS = (0.5, 1.0, 0.5, 0.0)
_PULL = 0.7  # N


@dataclass(frozen=True)
class Truth:
    """What a rod is like.

    Attributes:
        modulus, damping: Factors on what is believed [1].
        friction: [N] of each tendon.
        delay: [s] of the camera.
    """

    modulus: float
    damping: float
    friction: float
    delay: float

    @property
    def robot(self) -> RobotParams:
        """The rod, but for friction, which no beam model has."""
        return BELIEVED.vary(youngs_modulus=self.modulus, damping_time=self.damping)


def drawn(seed: int) -> Truth:
    """A truth by chance: modulus within a quarter, damping within a half, friction, delay."""
    rng = np.random.default_rng([seed, 1])
    ends = (0.8, 1.25), (0.67, 1.5), (0.02, 0.06), (0.01, 0.04)
    return Truth(*(float(rng.uniform(*pair)) for pair in ends))


def recorded(truth: Truth, seed: int) -> Recording:
    """The recording of a rod that an identification is given."""
    commands, labels = _commands()
    commands = np.repeat(commands[::_EVERY], _EVERY, axis=0)[: len(commands)]  # held by the drives
    rod = CosseratRod(truth.robot, pieces=6)
    tip = np.array([_LENGTH])
    idle = np.array([t.pretension for t in _TENDONS])
    q = rod.equilibrium(idle)
    state, anchor = State(q, np.zeros_like(q)), rod.tendon_length(q)
    places = [rod.positions(q, tip)[0]]
    for tension in commands[:-1]:
        slid = (rod.tendon_length(state.q) - anchor) / _LOOSE
        anchor = anchor + _LOOSE * (slid - np.clip(slid, -1, 1))
        force = np.maximum(tension + truth.friction * np.clip(slid, -1, 1), 0.0)
        motion = rod.simulate(_STEP, force, state, method="sdirk4", step=_STEP)
        state = State(motion.q[-1], motion.v[-1])
        places.append(rod.positions(state.q, tip)[0])
    times = _STEP * np.arange(len(commands))
    path, seen = np.array(places), times[::_EVERY]
    late = np.stack([np.interp(seen - truth.delay, times, path[:, k]) for k in range(3)], axis=1)
    late += NOISE * np.random.default_rng([seed, 2]).standard_normal(late.shape)
    names = tuple(t.name for t in _TENDONS)
    commanded, marker = Commands("tension", names, "N", names), (Marker("x", "y", "z"),)
    own = {"commands": commanded, "marker": marker, "time": Time("t")}
    header = Header(**own, label="pattern", robot="rod")
    series = {"commands": commands[::_EVERY], "labels": labels[::_EVERY]}
    runs = np.zeros(len(seen), int)
    return Recording(header=header, times=seen, markers=late[:, None], runs=runs, **series)


def _commands() -> tuple[ndarray, ndarray]:
    """Tensions (t, 3) [N] in steps of the simulation, and labels (t,)."""
    idle = np.array([t.pretension for t in _TENDONS])
    parts, labels = [np.tile(idle, (_count(_REST), 1))], ["rest"] * _count(_REST)

    def pull(here: ndarray, there: ndarray, label: str, *after: ndarray) -> None:
        share = np.linspace(0, 1, _count(_MOVE) + 1)[1:, None]
        rise = share**3 * (10 - 15 * share + 6 * share**2)
        own = [here + rise * (there - here), np.tile(there, (_count(_REST), 1)), *after]
        parts.extend(own)
        labels.extend([label] * sum(map(len, own)))

    here = idle
    for k, tendon in enumerate(_TENDONS):
        for level in _LEVELS:
            there = idle + level * _PULL * np.eye(3)[k]
            pull(here, there, f"pull_{tendon.name}_{level}")
            here = there
    let_go = np.tile(idle, (_count(_DECAY), 1))
    for k, tendon in enumerate(_TENDONS):
        pull(idle, idle + _PULL * np.eye(3)[k], f"release_{tendon.name}", let_go)
    return np.concatenate(parts), np.array(labels)


def _count(seconds: float) -> int:
    return round(seconds / _STEP)
