"""Laws of mechanics that every beam model keeps, numbers of the audit, and what is refused.

Derivatives for comparison are taken by complex steps through the kernels.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.linalg import eigvals

from softrobot_env.beams import mechanics
from softrobot_env.beams.ancf import ANCF
from softrobot_env.beams.ancf import actuation as ancf_actuation
from softrobot_env.beams.ancf import elements as ancf_dynamics
from softrobot_env.beams.cosserat import CosseratRod
from softrobot_env.beams.cosserat import actuation as cosserat_actuation
from softrobot_env.beams.cosserat import dynamics as cosserat_dynamics
from softrobot_env.beams.model import _potential
from softrobot_env.beams.pcc import PCC
from softrobot_env.beams.pcc import actuation as pcc_actuation
from softrobot_env.beams.pcc import dynamics as pcc_dynamics
from softrobot_env.robots import CANTILEVER_STIFF, CANTILEVER_WEAK, Tendon
from softrobot_env.robots.loads import Load

STEP = 1e-30
KERNELS = {
    PCC: (pcc_dynamics, pcc_actuation),
    CosseratRod: (cosserat_dynamics, cosserat_actuation),
    ANCF: (ancf_dynamics, ancf_actuation),
}
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
        within = [
            replace(x, force=tuple(np.multiply(x.force, force)), moment=_times(x.moment, moment))
            for x in loads
        ]
        return self.model(robot, self.pieces, loads=within, **self.options)


def _times(a, b):
    return tuple(np.multiply(a, b))


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
pytestmark = pytest.mark.filterwarnings("ignore::softrobot_env.beams.ancf.LockingWarning")


def state(model, seed=7):
    """A strongly deformed, moving state; quaternions are not normalised."""
    rng = np.random.default_rng(seed)
    if isinstance(model, PCC):  # pieces turn by up to about 90 degrees
        return rng.normal(scale=5.0, size=model.n), rng.normal(scale=20.0, size=model.n)
    if isinstance(model, ANCF):
        unit = np.where(model.data.scale < 1, 0.1, 1.0)  # scale is the length, or 1 of a gradient
        return model.rest() + 0.05 * unit * rng.normal(size=model.n), rng.normal(size=model.n)
    q, scale = model.rest(), [0.1 * model.data.spacing] * 3 + [0.25] * 4
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


@pytest.mark.parametrize("kind", [*KINDS, Kind(CosseratRod, 3, FREE | {"baumgarte": 5.0})], ids=str)
def test_accelerations_balance_all_forces(kind):
    model = kind.made()
    (q, v), u = state(model), np.linspace(1.0, 2.0, model.n_inputs)
    force = model.residual(q, v, np.zeros(model.n), u)
    left = model.residual(q, v, model.acceleration(q, v, u), u)
    np.testing.assert_allclose(left, 0, atol=1e-11 * np.abs(force).max())


@law
def test_forces_at_rest_are_the_gradient_of_the_energy(kind):
    model = kind.made()
    (q, _), zero = state(model), np.zeros(model.n)
    slope = gradient(lambda x: _potential(model.data, x), q)
    np.testing.assert_allclose(
        model.residual(q, zero, zero), slope, rtol=0, atol=1e-12 * np.abs(slope).max()
    )
    assert model.potential_energy(model.rest()) == pytest.approx(0, abs=1e-12)


@law
def test_nothing_but_damping_changes_the_energy(kind):
    model = kind.made(replace(ROBOT, damping_time=0.0))
    q, v = state(model)
    if isinstance(model, CosseratRod):
        cosserat_dynamics.project(model.data, q, v)
    n, a = model.n, model.acceleration(q, v)

    def energy(x):
        return mechanics.kinetic_energy(model.data, x[:n], x[n:]) + _potential(model.data, x[:n])

    change = derivative(energy, np.append(q, v), np.append(v, a))
    assert abs(change) < 1e-11 * np.abs(v) @ np.abs(model.residual(q, v, np.zeros(n)))


@pytest.mark.parametrize(
    "kind",
    [
        Kind(CosseratRod, 4, FREE),
        Kind(CosseratRod, 4, FREE | {"weighting": 2, "moments": "printed"}),
        *(
            pytest.param(Kind(ANCF, 3, FREE | {"dimension": d}, directions), marks=SLOW)
            for d, directions in ((2, "planar"), (3, ""))
        ),
    ],
    ids=str,
)
def test_gravity_alone_changes_the_momentum_of_a_free_rod(kind):
    """Damped, so that internal damping forces are shown to balance, too."""
    model = kind.made(replace(ROBOT, tendons=()), ())
    q, v = state(model)
    if isinstance(model, CosseratRod):
        cosserat_dynamics.project(model.data, q, v)
    n, a = model.n, model.acceleration(q, v)
    momentum = filled(KERNELS[kind.model][0].momentum, model.data, 6)
    rate = derivative(lambda x: momentum(x[:n], x[n:]), np.append(q, v), np.append(v, a))
    moment = momentum(q, q).real[:3]  # the first one of the mass: places move as places are
    weight, internal = np.array(model.robot.gravity), np.abs(a).max() * ROBOT.mass
    np.testing.assert_allclose(rate[:3], ROBOT.mass * weight, atol=1e-12 * internal)
    np.testing.assert_allclose(rate[3:], np.cross(moment, weight), atol=1e-12 * internal)


@law
def test_forces_on_points_are_the_transpose_of_their_motion(kind):
    model = kind.made()
    kernels, places = KERNELS[kind.model][1], np.array([0.0, 0.03, 0.125, 0.2, 0.3, 0.41, 0.5])
    sides = np.array([[0.02, -0.01]] * 3 + [[0.0, 0.0]] + [[0.01, 0.03]] * 3)
    data, (q, _) = model.probe(places, sides), state(model)
    forces, found = np.random.default_rng(3).normal(size=(7, 3)), np.ones(model.n)
    kernels.add_forces(data, q, forces, found)  # it adds
    moves = gradient(filled(kernels.locate, data, 7, 3), q)
    np.testing.assert_allclose(found - 1, np.einsum("nki,ki->n", moves, forces), atol=1e-13)


@law
def test_channels_pull_along_the_slope_of_their_lengths(kind):
    model = kind.made()
    kernels, (q, _) = KERNELS[kind.model][1], state(model)
    tension, found = np.array([3.0, 7.0, 2.0]), np.ones(model.n)
    kernels.add_channel_forces(model.data, q, tension, found)
    slope = gradient(filled(kernels.channel_lengths, model.data, 3), q)
    np.testing.assert_allclose(1 - found, slope @ tension, atol=1e-12)
    straight = [t.end for t in ROBOT.tendons]
    np.testing.assert_allclose(model.tendon_length(model.rest())[:3], straight[:3], rtol=1e-14)


# ---------------------------------------------------------------- the audit's numbers


def printed(robot, n):
    return CosseratRod(robot, n, grid="thesis", weighting=2, moments="printed")


def planar(robot, n):
    return PCC(robot, n, axes="planar")


def continuum(robot, n):
    return ANCF(robot, n, dimension=2)


def thesis_rod(robot, n):
    return CosseratRod(robot, n, grid="thesis")


@dataclass(frozen=True)
class Printed:
    """Numbers by pieces, and half a digit more."""

    make: Callable
    robot: object
    numbers: dict
    half: float


def numbers(make, weak, stiff, halves, marks=()):
    """Of both cantilevers."""
    robots = (CANTILEVER_WEAK, CANTILEVER_STIFF)
    return [
        pytest.param(
            Printed(make, robot, found, half), id=f"{make.__name__} {robot.name}", marks=marks
        )
        for robot, found, half in zip(robots, (weak, stiff), halves, strict=True)
    ]


@pytest.mark.parametrize(
    "case",
    [
        *numbers(
            planar,
            {1: 320.8, 2: 368.0, 3: 378.8, 5: 384.6, 8: 386.5},
            {1: 12.67, 2: 12.69, 3: 12.70, 5: 12.70, 8: 12.70},
            (0.051, 0.0051),
        ),
        *numbers(
            printed,
            {1: 482.4, 2: 450.7, 3: 426.5, 4: 413.3, 5: 406.3, 8: 398.3},
            {1: 26.59, 2: 17.21, 3: 15.46, 4: 14.84, 5: 14.56, 8: 14.25},
            (0.051, 0.0051),
        ),
        *numbers(
            continuum,
            {1: 156.8, 2: 277.1, 3: 341.7, 4: 367.7, 5: 379.7, 8: 390.6, 14: 393.4, 20: 393.9},
            {1: 9.25, 2: 12.54, 3: 13.17, 4: 13.40, 5: 13.51, 8: 13.63, 14: 13.68, 20: 13.70},
            (0.051, 0.0051),
            SLOW,
        ),
    ],
)
def test_deflections_under_the_own_weight_are_the_audits(case):
    for pieces, expected in case.numbers.items():
        model = case.make(case.robot, pieces)
        tip = model.tip(model.equilibrium(load_steps=4, check_stability=False))
        assert -1e3 * tip[0] == pytest.approx(expected, abs=case.half), pieces


@pytest.mark.parametrize(
    "case",
    [
        *numbers(
            PCC,
            {1: 0.5290, 3: 0.6382, 5: 0.6505, 14: 0.6566},
            {1: 4.331, 3: 5.209, 5: 5.310, 14: 5.359},
            (7e-5, 6e-4),
        ),
        *numbers(
            thesis_rod,
            {1: 0.3735, 3: 0.5997, 5: 0.6330, 14: 0.6511},
            {1: 3.016, 3: 4.706, 5: 4.940, 14: 5.065},
            (7e-5, 6e-4),
        ),
        *numbers(
            ANCF,
            {1: 0.8311, 3: 0.6692, 5: 0.6599, 14: 0.6554},
            {1: 6.426, 3: 5.266, 5: 5.195, 14: 5.158},
            (5.1e-5, 5.1e-4),
            SLOW,
        ),
    ],
)
def test_first_frequencies_are_the_audits(case):
    robot = replace(case.robot, gravity=(0.0, 0.0, 0.0))
    for pieces, expected in case.numbers.items():
        model = case.make(robot, pieces)
        found = model.linearize(model.start()).frequencies()[:2]  # alike in both directions
        np.testing.assert_allclose(found, expected, atol=case.half, err_msg=str(pieces))


def twisting(robot, n):
    return PCC(robot, n, axes="torsion")


@pytest.mark.parametrize(
    "case",
    [
        one
        for make in (twisting, thesis_rod)
        for one in numbers(
            make,
            {1: 6.246, 2: 6.761, 3: 6.859, 5: 6.909},
            {1: 15.62, 2: 16.90, 3: 17.15, 5: 17.27},
            (2.2e-3, 6e-3),
        )
    ],
)
def test_frequencies_of_torsion_are_the_audits(case):
    """The straight rod's torsion is its own, in every third or sixth coordinate."""
    robot = replace(case.robot, gravity=(0.0, 0.0, 0.0))
    for pieces, expected in case.numbers.items():
        model = case.make(robot, pieces)
        space = model.linearize(model.start())
        own = slice(2, None, 3) if isinstance(model, PCC) else slice(5, None, 6)
        square = eigvals(space.stiffness[own, own], space.mass[own, own]).real.min()
        assert np.sqrt(square) / (2 * np.pi) == pytest.approx(expected, abs=case.half), pieces


# ---------------------------------------------------------------- what is refused

SIDE, TWIST = Load("side", 0.1, force=(0, 1, 0)), Load("turn", 0.1, moment=(0, 0, 1))
WHOLE = "pieces must be a whole number, at least one"


@pytest.mark.parametrize(
    ("model", "options", "allowed"),
    [
        *((model, {"pieces": n}, WHOLE) for model in KERNELS for n in (0, 2.5)),
        (PCC, {"axes": "planar", "loads": [SIDE]}, r"x-z plane; remove load 'side' \(force y\) or"),
        (PCC, {"axes": "spatial", "loads": [TWIST]}, r"remove load 'turn' \(moment z\) or choose"),
        (PCC, {"axes": "all"}, "unknown axes 'all'; choose from planar, spatial, torsion"),
        (PCC, {"inertia": "point"}, "unknown inertia 'point'; choose from lumped, distributed"),
        (PCC, {"inertia": [(0.6, 1.0, (0, 0, 0))]}, "off the robot"),
        (PCC, {"inertia": [(0.5, -1.0, (0, 0, 0))]}, "zero or more"),
        (PCC, {"inertia": [(0.5, 1.0, (0, 0))]}, "three moments"),
        (PCC, {"inertia": [(0.5, np.nan, (0, 0, 0))]}, "finite mass"),
        (PCC, {"inertia": [(0.1, 1.0, (1e-3, 1e-3, 1e-3))]}, "without inertia"),
        (PCC, {"inertia": []}, "without inertia"),
        (CosseratRod, {"grid": "ends"}, "choose from middles, thesis"),
        (CosseratRod, {"grid": "middles", "clamped": False}, "free rod has the grid 'thesis'"),
        (CosseratRod, {"weighting": 6}, "weighting must be 1, 2, 3, 4 or 5"),
        (CosseratRod, {"moments": "exact"}, "choose from conservative, printed"),
        (CosseratRod, {"shear_coefficient": 0.0}, "shear_coefficient must be positive"),
        (CosseratRod, {"baumgarte": -1.0}, "baumgarte must be zero or a positive rate"),
        (ANCF, {"dimension": 1}, "2 or 3"),
        (ANCF, {"plane": "bent"}, "stress, strain"),
        (ANCF, {"quadrature": 0}, "chebyshev"),
        (ANCF, {"quadrature": "simpson"}, "chebyshev"),
        (ANCF, {"dimension": 2, "loads": [Load("m", 0.1, moment=(1.0, 0.0, 0.0))]}, "x-z plane"),
        (ANCF, {"dimension": 2, "loads": [SIDE]}, "x-z plane"),
        (ANCF, {"robot": replace(ROBOT, gravity=(0, 0, 0)), "dimension": 2}, "x-z plane"),
        (ANCF, {"robot": replace(CANTILEVER_WEAK, gravity=(0, 1, 0)), "dimension": 2}, "x-z plane"),
        (ANCF, {"robot": replace(CANTILEVER_WEAK, poisson_ratio=0.5)}, "Poisson"),
    ],
)
def test_wrong_options_are_refused(model, options, allowed):
    with pytest.raises(ValueError, match=allowed):
        model(**{"robot": CANTILEVER_WEAK} | options)
