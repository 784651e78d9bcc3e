"""Contacts: what the rule of their timestep is worth, and checks against exact solutions.

Moving scenes run on a grid of stiffness, friction and timestep and are judged by refined runs; rods
at rest are compared with exact solutions.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from math import pi
from time import perf_counter

import numpy as np
from numpy import ndarray

from softrobot_env.core.motion import State
from softrobot_env.evaluation.models import runs
from softrobot_env.robots import ARM, Base, RobotParams
from softrobot_env.robots.loads import Load
from softrobot_env.robots.registry import GRIPPERS, find_robot
from softrobot_env.scene.assembly import AssembledScene, Assembly, build_assembly, gripper_scene
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.chain import SEPARATOR, TIP_SITE
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.contacts import material_stiffness, tune
from softrobot_env.scene.objects import Box, Capsule, Contacts, Cylinder, Ground, Object, Sphere
from softrobot_env.scene.registry import scene_of
from softrobot_env.scene.simulation import Simulation
from studies.lab import Record, Study, pivot, quantity, table
from studies.truths.resting_rods import CHECKS, STIFFNESS

#: Share of the length within which all that moves is accurate.
ACCURATE_SHARE = 0.01


@dataclass(frozen=True)
class Cell(Record):
    """A scene with one stiffness, friction and timestep.

    Attributes:
        scene: Key of `CASES`.
        stiffness_ratio: Stiffness of the skin over that of the robot's material [1].
        stiffness: [N/m2].
        friction: Coefficient [1].
        steps_ratio: Timestep over the rule's [1].
        timestep: [s].
        verdict: What became of it.
        why: What was refused or failed; None otherwise.
        warning: What a `TimestepWarning` said.
        error: [m], largest distance of the tip or a free object from the refined run.
        error_share: Over the robot's length [1].
        uncertainty: [m], the same between the two finest runs.
        wall_time: [s] of the run.
        duration: [s] simulated.
        most_touches: Most contacts at the end of a control period.
    """

    scene: str = quantity(form="")
    stiffness_ratio: float = quantity("", "g", "stiffness")
    stiffness: float
    friction: float = quantity("", "g")
    steps_ratio: int = quantity("", "d", "steps")
    timestep: float = quantity("ms", ".3g", "dt")
    verdict: runs.Verdict = quantity(form="")
    why: str | None
    warning: str | None
    error: float | None
    error_share: float | None = quantity("%", ".2g", "error")
    uncertainty: float | None
    wall_time: float | None = quantity("ms", ".0f", "run")
    duration: float
    most_touches: int | None


@dataclass(frozen=True)
class Check(Record):
    """A rod at rest on something against an exact solution.

    Attributes:
        case: Key of `studies.truths.resting_rods.CHECKS`.
        pieces: Pieces of the chain.
        stiffness: [N/m2], of the skin.
        timestep: [s], with which it came to rest.
        force: [N], size of the sum of all contact forces on the rod.
        force_error: Distance from the exact sum, over its size [1].
        pressed_error: Error of the sum of the forces' sizes, over it [1].
        tip_error: Distance of the tips over the length [1]; None where only forces are exact.
        wall_time: [s] until it came to rest.
    """

    case: str = quantity(form="")
    pieces: int = quantity("", "d")
    stiffness: float
    timestep: float = quantity("ms", ".3g", "dt")
    force: float = quantity("N", ".4g")
    force_error: float = quantity("%", ".2g", "force")
    pressed_error: float = quantity("%", ".2g", "pressed")
    tip_error: float | None = quantity("%", ".2g", "tip")
    wall_time: float = quantity("ms", ".0f", "run")


# -------------------- moving scenes

_DOWN = (0.0, 0.0, -9.81)
_ACROSS = (pi / 2, 0.0, 0.0)  # an axis along y

_LYING = {"gravity": _DOWN, "base": Base((0.0, 0.0, 0.06), (1.0, 0.0, 0.0))}
_ROD = RobotParams("rod", 0.3, 0.01, 0.0, 5e5, 1000.0, 0.02, 12, **_LYING)
_CURL = RobotParams("rod", 0.4, 0.005, 0.0, 5e5, 1000.0, 0.05, 24)


@dataclass(frozen=True)
class Case:
    """A moving scene.

    Attributes:
        config: Of one robot or several, with what it touches.
        full: (n_inputs,) that the inputs reach.
        rise: [s] until then, from zero.
        duration: [s].
    """

    config: SceneConfig | Assembly
    full: tuple[float, ...]
    rise: float
    duration: float

    @property
    def robot(self) -> RobotParams:
        """The robot, or the first of several, which are alike."""
        config = self.config
        return config.robot if isinstance(config, SceneConfig) else config.members[0].config.robot

    def build(
        self, stiffness: float, friction: float, timestep: float | None = None
    ) -> Scene | AssembledScene:
        """The scene with a skin of a stiffness [N/m2], a friction coefficient and a timestep [s].

        Raises:
            ValueError: The contacts are too stiff for the timestep.
        """
        contacts = replace(self.config.contacts, stiffness=stiffness, friction=friction)
        config = replace(self.config, contacts=contacts)
        if isinstance(config, SceneConfig):
            return build_scene(replace(config, timestep=timestep))
        return build_assembly(config.with_timestep(timestep))

    def inputs(self, time: float) -> ndarray:
        """(n_inputs,) at a time [s]."""
        return np.array(self.full) * min(1.0, time / self.rise)


#: Stiffness and friction differ from run to run.
_SKIN = Contacts(between_robots=False)


def _touching(robot: RobotParams, *objects: Object) -> SceneConfig:
    return SceneConfig(robot, contacts=_SKIN, objects=objects)


def _falling() -> Case:
    """A cantilever falls on the ground."""
    return Case(_touching(_ROD, Ground(name="ground")), (), 1.0, 1.0)


def _sweeping() -> Case:
    """The thesis' arm bends into a post."""
    post = Cylinder(name="post", radius=0.03, length=0.2, turn=_ACROSS, position=(0.15, 0.0, 0.35))
    return Case(_touching(ARM, post), (8, 0, 8, 0, 8, 0), 0.2, 1.5)


def _curling() -> Case:
    """A moment at the tip curls a rod one and a half times, so that it meets itself."""
    turns = 1.5 * 2 * pi * _CURL.bending_stiffness / _CURL.length
    load = Load("curl", _CURL.length, moment=(0.0, turns, 0.0), follows=True)
    contacts = replace(_SKIN, self_contact=True)
    return Case(SceneConfig(_CURL, loads=(load,), contacts=contacts), (1,), 1.0, 2.0)


def _pushing() -> Case:
    """The hanging arm pushes a ball over the ground; with much friction it jams."""
    hanging = replace(ARM, gravity=_DOWN, base=Base((0.0, 0.0, 0.5), (0.0, 0.0, -1.0)))
    ball = Sphere(name="ball", radius=0.05, density=400.0, position=(-0.085, 0.0, 0.03))
    ground = Ground(name="ground", position=(0.0, 0.0, -0.02))
    return Case(_touching(hanging, ground, ball), (8, 0, 8, 0, 8, 0), 0.2, 1.0)


def _trunk() -> Case:
    """A hanging trunk of two sections swings into a box in space and shoves another."""
    config = scene_of(find_robot("hanging_trunk"))
    base = config.robot.base
    x, y, z = (np.array(base.position) + base.axes[:, 2] * config.robot.length).tolist()
    wall = Box(name="wall", size=(0.04, 0.4, 0.2), position=(x - 0.1, y, z + 0.05))
    crate = Box(name="crate", size=(0.05, 0.05, 0.05), mass=0.05, position=(x + 0.06, y, z))
    table = Ground(name="table", position=(x, y, z - 0.025))
    full = tuple(8.0 if k in (1, 4) else 0.0 for k in range(len(config.robot.tendons)))
    config = replace(config, contacts=_SKIN, objects=(wall, crate, table))
    return Case(config, full, 0.1, 1.0)


def _gripping() -> Case:
    """Two fingers of the gripper close on a free bar that lies on the palm."""
    gripper = GRIPPERS["gripper"]
    left, middle, _ = gripper.fingers
    x, _, z = left.base.position
    left = replace(left, base=replace(left.base, position=(x, 0.0, z)))
    pair = replace(gripper, fingers=(left, middle))
    place = {"turn": _ACROSS, "position": (0.0, 0.0, gripper.seat(0.03) + 1e-4)}
    bar = Capsule(name="bar", radius=0.03, length=0.06, mass=0.08, **place)
    scene = gripper_scene(pair, (bar,), contacts=_SKIN, control_period=0.01)
    return Case(scene, (20.0, 20.0), 0.3, 0.5)


#: Name -> what makes the case.
CASES: dict[str, Callable[[], Case]] = {
    "rod falls on ground": _falling,
    "arm sweeps into post": _sweeping,
    "rod curls on itself": _curling,
    "arm pushes ball": _pushing,
    "trunk, box and wall": _trunk,
    "gripper closes on bar": _gripping,
}


#: Timesteps of the refined runs, as parts of the rule's, and the least impedance of their contacts.
_REFINED, _LEAST_IMPEDANCE = (8, 16), 0.02

#: What is judged.
Touching = Scene | AssembledScene

#: A truth is good enough if it is known to this share of what is accurate, or of the error.
_CLEAR = 0.25


@dataclass(frozen=True)
class Run:
    """A run of a scene: fields of its `Cell`, and what is judged.

    Attributes:
        places: (periods, k, 3) [m] of the tip and the free objects; None if it failed.
    """

    places: ndarray | None = None
    why: str | None = None
    warning: str | None = None
    wall_time: float | None = None
    most_touches: int | None = None


def judged(name: str, ratio: float, friction: float, steps: Sequence[int]) -> list[Cell]:
    """Cells of a scene with a stiffness and friction, one for each timestep over the rule's."""
    case = CASES[name]()
    stiffness = ratio * min(map(material_stiffness, case.robot.backbone.sections))  # the softest
    build = partial(case.build, stiffness, friction)
    with runs.unwarned():
        rule = build().timestep.timestep
        coarse, truth = (_refined(case, build(rule / parts)) for parts in _REFINED)
    about = {"scene": name, "stiffness_ratio": ratio, "stiffness": stiffness, "friction": friction}
    about |= {"uncertainty": _distance(coarse, truth), "duration": case.duration}
    cells, length = [], case.robot.length
    for multiple in steps:
        timestep = None if multiple == 1 else multiple * rule
        ran, warning = runs.with_warning(partial(_own_run, case, build, timestep))
        own = replace(ran, warning=warning)
        error = _distance(own.places, truth)
        found = {name: value for name, value in vars(own).items() if name != "places"}
        found |= {"steps_ratio": multiple, "timestep": multiple * rule, "error": error}
        found["error_share"] = None if error is None else error / length
        found["verdict"] = _verdict(own, error, about["uncertainty"], length)
        cells.append(Cell(**about, **found))
    return cells


def _own_run(case: Case, build: Callable[..., Touching], timestep: float | None) -> Run:
    """As a user would run it."""
    try:
        return _run(case, build(timestep))
    except ValueError as error:
        return Run(why=str(error))


def _refined(case: Case, scene: Touching) -> ndarray | None:
    tune(scene.model, scene.pairs, scene.timestep.timestep, _LEAST_IMPEDANCE)
    return _run(case, scene).places


def _run(case: Case, scene: Touching) -> Run:
    """Places of a run, whose contacts are counted when the time is no longer taken."""
    simulation = Simulation(scene)
    simulation.reset(scene.model.qpos0, case.inputs(0.0))
    model, data = scene.model, simulation.data
    names = [thing.name for thing in case.config.objects if thing.is_free]
    sites = [model.site(k).name for k in range(model.nsite)]
    tips = [name for name in sites if name.rpartition(SEPARATOR)[2] == TIP_SITE]
    seen = [*(data.site(n).xpos for n in tips), *(data.body(n).xpos for n in names)]
    places, touches = [], 0
    begin = perf_counter()
    for number in range(round(case.duration / scene.config.control_period)):
        simulation.ctrl[:] = case.inputs(number * scene.config.control_period)
        if not simulation.advance():
            return Run(why=simulation.failure())
        places.append(np.array(seen))
        touches = max(touches, int(simulation.data.ncon))
    return Run(np.array(places), wall_time=perf_counter() - begin, most_touches=touches)


def _distance(one: ndarray | None, other: ndarray | None) -> float | None:
    """Largest distance [m] between two runs at any instant; None if one of them failed."""
    return None if one is None or other is None else runs.distance(one, other)


def _verdict(own: Run, error: float | None, known: float | None, length: float) -> runs.Verdict:
    asked = ACCURATE_SHARE * length
    if error is not None and (known is None or known > _CLEAR * max(asked, error)):
        error = None
    return runs.verdict_of(error, asked, length, failure=own.why, warning=own.warning)


def check(name: str, pieces: int, repeats: int = 3) -> list[Check]:
    """A rod of so many pieces against the truth; its time is the best of some."""
    truth = CHECKS[name]()
    scene = build_scene(replace(truth.config, pieces=pieces))
    u = np.ones(scene.n_inputs)
    wall_time, q = runs.best_of(lambda: scene.equilibrium(u), repeats)
    touches = scene.contacts(State(q, np.zeros(scene.model.nv)), u)
    force = np.sum([touch.force for touch in touches], axis=0)
    pressed = sum(np.linalg.norm(touch.force) for touch in touches)
    exact, exact_pressed = truth.contact(touches), truth.pressed(touches)
    size, length = np.linalg.norm, scene.config.robot.length
    found = {
        "force": float(size(force)),
        "force_error": float(size(force - exact) / size(exact)),
        "pressed_error": float(pressed / exact_pressed - 1),
        "tip_error": None if truth.tip is None else float(size(scene.tip(q) - truth.tip) / length),
    }
    about = {"case": name, "pieces": pieces, "stiffness": STIFFNESS, "wall_time": wall_time}
    return [Check(timestep=scene.timestep.timestep, **about, **found)]


# -------------------- the study

#: Stiffnesses over that of the robot's material [1], friction coefficients [1], and timesteps over
#: the rule's [1].
STIFFNESSES = (0.01, 0.1, 1.0, 10.0, 100.0)
FRICTIONS = (0.0, 0.3, 1.0)
STEPS = (1, 2, 4, 8, 16)

#: Scenes that take more computing than the others together.
LONGEST = ("trunk, box and wall", "gripper closes on bar")

#: Pieces of the rods at rest.
PIECES = (6, 12, 24, 48)


def cases(quick: bool = False) -> list[tuple]:
    """Scene, stiffness, friction and timesteps; rod and pieces. Quickly none of the `LONGEST`."""
    stiffnesses, frictions = ((1.0,), (1.0,)) if quick else (STIFFNESSES, FRICTIONS)
    steps, pieces = ((1, 8), PIECES[:2]) if quick else (STEPS, PIECES)
    scenes = [name for name in CASES if not (quick and name in LONGEST)]
    return [*product(scenes, stiffnesses, frictions, [steps]), *product(CHECKS, pieces)]


def _errors(cells: list[Cell]) -> str | None:
    """Largest error in % and mean run time over simulated time."""
    known = [c for c in cells if c.error_share is not None]
    if not known:
        return None
    worst = max(c.error_share for c in known)
    cost = sum(c.wall_time / c.duration for c in known) / len(known)
    return f"{100 * worst:.2f} % {cost:.3f}"


STUDY = Study(
    kinds=(Cell, Check),
    cases=cases,
    measure=lambda case: judged(*case) if len(case) == 4 else check(*case),
    label=lambda case: ", ".join(map(str, case[:3])),
    tables=[
        pivot(
            f"Verdicts of cells by timestep: accurate within {100 * ACCURATE_SHARE:g} %, wrong "
            f"beyond {100 * runs.WRONG_SHARE:g} % of the length",
            ("steps_ratio",),
            *("verdict", len),
            of=Cell,
            headings=("timestep / the rule's",),
        ),
        pivot(
            "Largest error over the length, and mean run time over simulated time, by timestep "
            "over the rule's",
            ("scene",),
            "steps_ratio",
            _errors,
            of=Cell,
            heading="{} x".format,
        ),
        table(
            "Cells that are not accurate",
            of=Cell,
            where=lambda cell: cell.verdict != runs.Verdict.ACCURATE,
        ),
        table(
            "Rods at rest on something, against closed form and elastica",
            of=Check,
            caption="pressed: sum of the sizes of the forces; force: their vector sum",
        ),
    ],
)
