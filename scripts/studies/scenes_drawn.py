"""Random scenes: a robot of any size and stiffness, what it carries, and what drives it.

Scene `index` of a seed is always the same, whatever else is drawn and how often the benchmark ran.
Forces are drawn in units of what bends the robot, of its elasticity and its weight together, so
that neither a rope nor a steel rod stays as it is or is torn apart.
"""

from dataclasses import dataclass, replace
from math import ceil, cos, hypot, pi, sin, sqrt

import numpy as np
from numpy import ndarray

from softrobot_env.robots import ARM, Head, RobotParams, Tendon
from softrobot_env.robots.loads import Load
from softrobot_env.scene.config import SceneConfig

#: Standard gravity [m/s2].
G = 9.81

#: What moves a robot: inputs that jump, or swing, or a bent robot that is let go.
EXCITATIONS = ("steps", "sines", "let_go")

#: Damping ratio of the arm's first mode, and its damping time [s]: the usual ones.
USUAL_RATIO, USUAL_TIME = ARM.damping_time * pi * ARM.first_frequency, ARM.damping_time

#: Longest motion [s], and its length in first periods and in control periods.
_LONGEST, _PERIODS, _LEAST, _MOST = 2.0, 4.0, 10, 200

#: Longest control period in first periods.
_PERIOD_IN_PERIODS = 100.0

#: Least share of the usual damping unless there is none, and shares of robots without any and of
#: those with less than a usual robot may have.
_LEAST_DAMPING, _UNDAMPED, _LIVELY = 1e-6, 0.1, 0.3

#: Largest angle [rad] by which a tendon alone would bend a weightless robot: of one that works
#: against its elasticity alone, and against its weight as well.
_BEND, _CURL = 3.0, 8.0

#: Rho A g L^3 / EI of robots that cannot carry themselves.
_LIMP = 50.0


@dataclass(frozen=True)
class RandomScene:
    """A scene, where it starts and what drives it.

    Attributes:
        seed, index: What it was drawn from.
        config: The scene; nothing of its integration is fixed.
        curvature: (3,) [1/m] at rest at the start, towards +x and +y, and twist.
        controls: (periods, nu) in the order of the actuators, each held for a control period.
        excitation: One of `EXCITATIONS`.
    """

    seed: int
    index: int
    config: SceneConfig
    curvature: ndarray
    controls: ndarray
    excitation: str

    @property
    def duration(self) -> float:
        """[s]."""
        return len(self.controls) * self.config.control_period


def draw_scene(seed: int, index: int) -> RandomScene:
    """The random scene of a seed and an index, both zero or more."""
    rng = np.random.default_rng([seed, index])
    spatial, length_drive = rng.random() < 0.4, rng.random() < 0.4
    robot, pieces = _bare_robot(rng, spatial), round(_log(rng, 4, 30))
    robot = replace(robot, pieces=pieces)
    robot = replace(robot, gravity=_gravity(rng, robot, spatial))
    robot = replace(robot, head=_head(rng, robot))
    robot = replace(robot, tendons=_tendons(rng, robot, spatial, length_drive))
    torsion = spatial and rng.random() < 0.5
    bends = {"bending": "spatial" if spatial else "planar", "torsion": torsion}
    driven = {"actuation": "length" if length_drive else "tension", "pieces": pieces}
    driven |= {"control_period": _control_period(rng, robot)}
    config = SceneConfig(robot, loads=_loads(rng, robot, spatial, torsion), **driven, **bends)
    excitation = str(rng.choice(EXCITATIONS))
    curvature = _curvature(rng, config) if excitation == "let_go" else np.zeros(3)
    controls = _controls(rng, config, excitation)
    return RandomScene(seed, index, config, curvature, controls, excitation)


def swing(robot: RobotParams) -> float:
    """About the first frequency [Hz], of elasticity and of gravity together."""
    weight = sqrt(hypot(*robot.gravity) / robot.length) / (2 * pi)
    return hypot(robot.first_frequency, weight)


def weight_load(robot: RobotParams) -> float:
    """How far a robot sags, rho A g L^3 / EI [1]."""
    weight = robot.mass_per_length * hypot(*robot.gravity)
    return weight * robot.length**3 / robot.bending_stiffness


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    """A number between two positive ones, all orders of magnitude alike."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _bare_robot(rng: np.random.Generator, spatial: bool) -> RobotParams:
    """A beam without tendons, head and gravity."""
    length = _log(rng, 0.1, 1.5)
    radius = length / _log(rng, 5, 2000)
    hollow = rng.uniform(0.2, 0.9) if rng.random() < 0.3 else 0.0
    material = _log(rng, 1e3, 2e11), _log(rng, 300, 8000), 0.0
    more = {"poisson_ratio": rng.uniform(0, 0.5)}
    more["anisotropy"] = rng.uniform(0, 1) if spatial and rng.random() < 0.2 else 0.0
    more["stiff_azimuth"] = rng.uniform(0, pi)
    robot = RobotParams("random", length, radius, hollow * radius, *material, 1, **more)
    share, by_time = _damping_share(rng.random()), rng.random() < 0.5
    usual = USUAL_TIME if by_time else USUAL_RATIO / (pi * robot.first_frequency)
    return replace(robot, damping_time=share * usual)


def _damping_share(place: float) -> float:
    """Damping over the usual one [1] at a place from 0 to 1 in the order of robots' damping."""
    if place >= _LIVELY:
        return 0.01 ** (1 - place)
    way = (place - _UNDAMPED) / (_LIVELY - _UNDAMPED)
    return 0.0 if way < 0 else _LEAST_DAMPING ** (1 - way) * 0.01 ** ((1 - _LIVELY) * way)


def _gravity(rng: np.random.Generator, robot: RobotParams, spatial: bool) -> tuple[float, ...]:
    """None, that of the earth or 100 times as much; hanging, standing, sideways or oblique.

    A robot that cannot carry itself hangs in most cases: one that falls soon moves at random.
    """
    size = G * rng.choice((0.0, 1.0, 100.0), p=(0.25, 0.5, 0.25))
    named = ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), _direction(rng, spatial))
    limp = weight_load(replace(robot, gravity=(0.0, 0.0, size))) > _LIMP
    shares = (0.8, 0.05, 0.1, 0.05) if limp else (0.35, 0.15, 0.25, 0.25)
    return tuple(float(size * x) + 0.0 for x in named[rng.choice(4, p=shares)])


def _direction(rng: np.random.Generator, spatial: bool) -> tuple[float, ...]:
    vector = rng.standard_normal(3) * (1.0, 1.0 if spatial else 0.0, 1.0)
    return tuple(float(x) for x in vector / np.linalg.norm(vector))


def _head(rng: np.random.Generator, robot: RobotParams) -> Head | None:
    """A ball or a stick on the tip, as heavy as a tenth to three times the robot."""
    if rng.random() > 0.25:
        return None
    mass, height = _log(rng, 0.1, 3.0) * robot.mass, rng.uniform(0.01, 0.15) * robot.length
    radius = max(height / 2, 2 * robot.outer_radius)
    inertia = mass * (height**2 / 12 + radius**2 / 4)
    return Head(mass, height / 2, (inertia, inertia, mass * radius**2 / 2), height)


def _tendons(
    rng: np.random.Generator, robot: RobotParams, spatial: bool, length_drive: bool
) -> tuple[Tendon, ...]:
    """One to four tendons, all in channels or all through guides, that end at some piece's end."""
    count, guided = int(rng.integers(1, 5)), rng.random() < 0.35
    friction = _log(rng, 0.003, 0.1) if rng.random() < 0.2 else 0.0
    pretension = rng.uniform(0.02, 0.3) if rng.random() < 0.5 else 0.0
    stiffness = _log(rng, 1, 300)  # a tendon's moment about the fibre per turn of the tip
    moment_arm, turn = rng.uniform(0.5, 2.0) * robot.outer_radius, rng.uniform(0, 2 * pi)
    out = []
    for index in range(count):
        angle = turn + 2 * pi * index / count if spatial else pi * index
        end = robot.length * int(rng.integers(ceil(robot.pieces / 2), robot.pieces + 1))
        end = robot.length if index == 0 else end / robot.pieces
        limit = _moment(rng, robot) / moment_arm
        guides = np.linspace(0, end, int(rng.integers(2, 9)) + 1)[1:-1] if guided else ()
        offset = moment_arm * cos(angle), moment_arm * sin(angle) if spatial else 0.0
        more = {"pretension": float(pretension * limit), "friction": float(friction * limit)}
        more |= {"guides": tuple(map(float, guides))}
        more["stiffness"] = stiffness * robot.bending_stiffness / (end * moment_arm**2)
        tendon = Tendon(f"tendon{index}", offset, end, index // 2, float(limit), **more)
        out.append(tendon if length_drive else replace(tendon, stiffness=float("inf")))
    return tuple(out)


def _moment(rng: np.random.Generator, robot: RobotParams) -> float:
    """A moment [N m] that bends a robot visibly, against its stiffness or its weight as well."""
    unit = robot.bending_stiffness / robot.length
    elastic, share = rng.uniform(0.3, _BEND), rng.choice((0.0, 1.0)) * rng.uniform(0.05, 0.5)
    return unit * min(elastic + share * weight_load(robot), _CURL)


def _loads(
    rng: np.random.Generator, robot: RobotParams, spatial: bool, torsion: bool
) -> tuple[Load, ...]:
    """A wrench at the tip or anywhere, or none; its force may match the robot's weight."""
    if rng.random() > 0.4:
        return ()
    place = float(rng.choice((1.0, rng.uniform(0.2, 1.0)))) * robot.length
    weight = robot.mass_per_length * hypot(*robot.gravity) * robot.length
    size = _moment(rng, robot) / robot.length + rng.uniform(0.0, 0.5) * weight
    force = size * np.array(_direction(rng, spatial))
    moment = rng.choice((0.0, 0.5)) * _moment(rng, robot) * np.array(_direction(rng, spatial))
    if not spatial:
        moment = np.array([0.0, moment[0], 0.0])
    elif not torsion:
        moment[2] = 0.0
    follows = bool(rng.random() < 0.3)
    return (Load("load", place, tuple(map(float, force)), tuple(map(float, moment)), follows),)


def _control_period(rng: np.random.Generator, robot: RobotParams) -> float:
    """2 to 50 ms in whole ms, but no more than some first periods if those are shorter."""
    most = min(0.05, max(0.002, _PERIOD_IN_PERIODS / swing(robot)))
    return round(1e3 * _log(rng, 0.002, most)) / 1e3


def _curvature(rng: np.random.Generator, config: SceneConfig) -> ndarray:
    """(3,) [1/m] of an arc of half a radian to two."""
    angle, azimuth = rng.uniform(0.5, 2.0), rng.uniform(0, 2 * pi)
    turn = (cos(azimuth), sin(azimuth)) if config.bending == "spatial" else (1.0, 0.0)
    twist = rng.uniform(-0.5, 0.5) if config.torsion else 0.0
    return np.array([angle * turn[0], angle * turn[1], twist]) / config.robot.length


def _controls(rng: np.random.Generator, config: SceneConfig, excitation: str) -> ndarray:
    """(periods, nu)."""
    period, frequency = config.control_period, swing(config.robot)
    count = int(np.clip(min(_LONGEST, _PERIODS / frequency) / period, _LEAST, _MOST))
    time = period * np.arange(count)
    tendons = config.robot.tendons
    shape = _shape(rng, excitation, time, frequency, len(tendons))
    drives = [_drive(config.actuation, t, u) for t, u in zip(tendons, shape.T, strict=True)]
    loads = _shape(rng, excitation, time, frequency, len(config.loads))
    return np.column_stack([*drives, loads])


def _shape(
    rng: np.random.Generator, excitation: str, time: ndarray, frequency: float, size: int
) -> ndarray:
    """(k, size) between 0 and 1: levels held for a while, or sines; zero for what is let go."""
    if excitation == "let_go":
        return np.zeros((len(time), size))
    if excitation == "steps":
        hold = _log(rng, 0.1, 1.5) / frequency
        slots = (time / hold).astype(int)
        levels = rng.random((slots[-1] + 1, size))
        return levels[slots]
    rates = [_log(rng, 0.1, 2.0) * frequency for _ in range(size)]
    phases = rng.uniform(0, 2 * pi, size)
    amplitude = rng.uniform(0.1, 1.0)
    waves = np.sin(2 * pi * np.outer(time, rates) + phases)
    return 0.5 + 0.5 * amplitude * waves


def _drive(actuation: str, tendon: Tendon, share: ndarray) -> ndarray:
    """Controls (k,) of a tendon from shares between 0 and 1 of what it can do.

    Pulled in all the way it turns the tip by a radian, and stretches under half its limit.
    """
    room = tendon.tension_limit - tendon.pretension
    if actuation == "tension":
        return tendon.pretension + share * room
    return share * (hypot(*tendon.offset) + 0.5 * room / tendon.stiffness)
