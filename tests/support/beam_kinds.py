"""Kinds of beam models that keep the same laws, and derivatives by complex steps."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from softrobot_env.beams import mechanics
from softrobot_env.beams.ancf import ANCF
from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.pcc import PCC
from softrobot_env.robots import CANTILEVER_WEAK, Tendon
from softrobot_env.robots.loads import Load

STEP = 1e-30
ROBOT = replace(
    CANTILEVER_WEAK,
    poisson_ratio=0.3,
    gravity=(-9.0, 2.0, 3.0),
    damping_time=0.01,
    tendons=(
        Tendon("whole", (0.02, 0.01), 0.5, 0, 50.0),
        Tendon("part", (-0.01, 0.02), 0.41, 0, 50.0),
        Tendon("short", (0.02, 0.0), 0.03, 0, 50.0),
        Tendon("guided", (0.0, 0.025), 0.45, 0, 50.0, (0.1, 0.2, 1 / 3)),
    ),
)
LOADS = (
    Load("tip", 0.5, (0.3, -0.2, 0.5), (0.02, 0.01, -0.03)),
    Load("inner", 0.23, (-0.4, 0.1, 0.2), (0.01, -0.02, 0.02), follows=True),
    Load("base", 0.0, (1.0, 2.0, 3.0)),
)
#: Bodies inside and at the ends of the pieces, none with equal moments of inertia.
BODIES = (
    (0.05, 0.3, (4e-4, 2e-4, 3e-4)),
    (0.25, 0.2, (1e-4, 3e-4, 2e-4)),
    (0.31, 0.4, (3e-4, 1e-4, 5e-4)),
    (0.5, 0.1, (2e-4, 6e-4, 1e-4)),
)
#: Parts of forces and moments that a kind of model has.
KEPT = {"planar": ((1, 0, 1), (0, 1, 0)), "spatial": ((1, 1, 1), (1, 1, 0))}


@dataclass(frozen=True)
class Kind:
    """A kind of model: class, pieces, options, and directions out of `KEPT` if it lacks some."""

    model: type
    pieces: int
    options: dict = field(default_factory=dict)
    directions: str = ""

    def __str__(self):
        return " ".join(
            [self.model.__name__, str(self.pieces), *map(_short, self.options.values())]
        )

    def made(self, robot=ROBOT, loads=LOADS):
        """The model of what a robot and loads have in its directions."""
        force, moment = KEPT.get(self.directions, ((1, 1, 1), (1, 1, 1)))
        if self.directions == "planar":
            tendons = tuple(replace(t, offset=(t.offset[0], 0.0)) for t in robot.tendons)
            gravity = tuple(np.multiply(robot.gravity, force))
            robot = replace(robot, tendons=tendons, gravity=gravity)
        parts = [(np.multiply(x.force, force), np.multiply(x.moment, moment)) for x in loads]
        within = [
            replace(load, force=tuple(f), moment=tuple(m))
            for load, (f, m) in zip(loads, parts, strict=True)
        ]
        return self.model(robot, self.pieces, loads=within, **self.options)


def _short(value):
    return value if isinstance(value, str) else "bodies" if isinstance(value, tuple) else str(value)


SLOW = pytest.mark.slow  # compiling the continuum takes long
PLANAR, FREE = {"axes": "planar"}, {"clamped": False}
PCCS = [
    Kind(PCC, 3, PLANAR, "planar"),
    Kind(PCC, 3, {"axes": "spatial"}, "spatial"),
    Kind(PCC, 3, {"axes": "torsion"}),
    Kind(PCC, 3, {"axes": "spatial", "inertia": "distributed"}, "spatial"),
    Kind(PCC, 3, {"axes": "torsion", "inertia": BODIES}),
]
RODS = [
    Kind(CosseratRod, 4),
    Kind(CosseratRod, 1),
    Kind(CosseratRod, 4, {"grid": "thesis"}),
    Kind(CosseratRod, 4, FREE),
    *(Kind(CosseratRod, 4, {"weighting": k}) for k in (1, 2, 3, 4)),
    Kind(CosseratRod, 4, {"grid": "thesis", "weighting": 1, "moments": "printed"}),
]
CONTINUA = [
    pytest.param(
        Kind(ANCF, pieces, {"dimension": d, "quadrature": rule} | more, directions), marks=SLOW
    )
    for d, directions in ((2, "planar"), (3, ""))
    for pieces, rule, more in ((4, "exact", {}), (3, 3, {}), (3, "exact", FREE), (1, "exact", {}))
]
KINDS = [*PCCS, *RODS, *CONTINUA]
law = pytest.mark.parametrize("kind", KINDS, ids=str)


def state(model, seed=7, size=1.0):
    """A strongly deformed, moving state; quaternions are not normalised."""
    rng = np.random.default_rng(seed)
    if isinstance(model, PCC):  # pieces turn by up to about 90 degrees
        return size * rng.normal(scale=5.0, size=model.n), rng.normal(scale=20.0, size=model.n)
    if isinstance(model, ANCF):
        unit = np.where(model.data.scale < 1, 0.1, 1.0)  # scale is the length, or 1 of a gradient
        unit *= 0.05 * size
        return model.rest() + unit * rng.normal(size=model.n), rng.normal(size=model.n)
    q, scale = model.rest(), [0.1 * model.data.spacing] * 3 + [0.25 * size] * 4
    q[: 7 * model.pieces] += np.tile(scale, model.pieces) * rng.normal(size=7 * model.pieces)
    return q, rng.normal(size=model.n)


def derivative(function, x, direction):
    return np.imag(function(x + 1j * STEP * direction)) / STEP


def gradient(function, x):
    """(n, ...) of a function of x (n,)."""
    return np.stack([derivative(function, x, e) for e in np.eye(len(x))])


def filled(kernel, data, *shape):
    """A function around a kernel that fills its last argument."""

    def function(*arguments):
        out = np.zeros(shape, complex)
        kernel(data, *(np.asarray(x, complex) for x in arguments), out)
        return out

    return function


def located(data, q):
    """The points (k, 3) of a model's data, and the axes (k, 3, 3) of the sections there."""
    count = len(data.actuation.point_station)
    points, axes = np.empty((count, 3), q.dtype), np.empty((count, 3, 3), q.dtype)
    mechanics.locate(data, q, points, axes)
    return points, axes
