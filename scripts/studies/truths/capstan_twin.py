"""Rods whose tendons rub by a coefficient that nobody tells, and what a camera saw of them at rest.

A twin is a rod as its file says, with another Young's modulus, whose tendons rub by a coefficient,
some of them at any tension as well. It is MuJoCo's chain, with zones of friction; an identification
has pieces of constant curvature. Its tendons are pulled and let go, one after the other, then two
at a time.
"""

from dataclasses import dataclass, replace

import numpy as np

from softrobot_env.identification.replay import replay
from softrobot_env.recordings import Commands, Header, Marker, Recording
from softrobot_env.robots import RobotParams, Tendon

_LENGTH, _AZIMUTHS = 0.2, 2 * np.pi * np.arange(3) / 3
_LEVELS = np.append(np.linspace(0.2, 1.0, 5), np.linspace(0.8, 0.2, 4))  # N
_LEAST, _MOST = 0.05, 0.3  # of the coefficient

#: What everybody takes the rods for.
BELIEVED = RobotParams(
    name="rod",
    length=_LENGTH,
    outer_radius=4e-3,
    inner_radius=0.0,
    youngs_modulus=1e7,
    density=1200.0,
    damping_time=0.05,
    pieces=8,
    poisson_ratio=0.3,
    tendons=tuple(
        Tendon(f"t{k}", (8e-3 * float(np.cos(a)), 8e-3 * float(np.sin(a))), _LENGTH, 0, 5.0)
        for k, a in enumerate(_AZIMUTHS)
    ),
    gravity=(0.0, 0.0, -9.81),
)


@dataclass(frozen=True)
class Seen:
    """A twin and what was seen of it.

    Attributes:
        robot: The twin.
        coefficient: Its tendons' [1].
        recording: Of a marker at its tip.
    """

    robot: RobotParams
    coefficient: float
    recording: Recording


def seen(seed: int, rubs: bool = True) -> Seen:
    """A twin by its seed, whose tendons rub by a coefficient or by none."""
    rng = np.random.default_rng([seed, 7])
    coefficient = float(np.exp(rng.uniform(np.log(_LEAST), np.log(_MOST)))) if rubs else 0.0
    twin = BELIEVED.vary(
        youngs_modulus=float(np.exp(rng.normal(0, 0.15))),
        friction_coefficient=coefficient,
        tendon_friction=float(rng.choice([0.0, 0.02])),
    )
    names, alone = twin.tendon_names, np.eye(3)
    ways = [*alone, *(alone + 0.7 * np.roll(alone, 1, axis=1))]
    commands = np.concatenate([np.outer(_LEVELS, way) for way in ways])
    header = Header(
        Commands("tension", names, "N", names, in_force="until"),
        (Marker("x", "y", "z"),),
        rate_Hz=1.0,
        static=True,
    )
    rows = len(commands)
    blank = Recording(
        header,
        np.arange(rows) * 1.0,
        commands,
        np.zeros((rows, 1, 3)),
        np.repeat([f"way {k}" for k in range(len(ways))], len(_LEVELS)),
        np.zeros(rows, int),
    )
    places = replay(blank, twin).simulated
    noise = float(rng.choice([1e-4, 3e-4])) * rng.standard_normal(places.shape)
    return Seen(twin, coefficient, replace(blank, markers=places + noise))
