"""Extreme cases: large bends, slack tendons, jumps, extreme sections and a long free oscillation.

Every model runs as the package runs it by default; the chain also as `mj_step` would advance it.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from math import ceil, pi
from time import process_time
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.linalg import eigh

from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.beams.model import BeamModel
from softrobot_env.core.motion import IntegrationError, State
from softrobot_env.evaluation.models.runs import (
    WRONG_SHARE,
    Excitation,
    Limit,
    Simulated,
    Verdict,
    distance,
    verdict_of,
    with_warning,
)
from softrobot_env.robots import ARM, CANTILEVER_WEAK, RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.robots.loads import Load
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.config import SceneConfig
from softrobot_env.scene.timestep import linearize
from studies.accuracy.cases import SHEAR
from studies.beams import make_beam, weightless
from studies.lab import Job, Record, quantity
from studies.truths.analytic import arc_tip, elastica, section
from studies.truths.continuum_arc import TEXT as CONTINUUM_ARC
from studies.truths.continuum_arc import continuum_arc_tip
from studies.truths.spatial_rod import followed_rod
from studies.truths.tendon_rod import tendon_rod

CHAIN, BEAMS = "mujoco_chain", ("pcc", "cosserat", "ancf2d")

#: The integrator of the rule for `mj_step` on these robots.
RULE = "implicitfast"

#: Accuracies [m] of refined chains, and steps per first period of refined beams.
_ACCURACIES, _STEPS = (1e-5, 1e-6), (1000, 2000)

#: Share of what a run may be off that its truth may be uncertain by.
_TRUSTED = 0.25

#: Share of the amplitude that the tip may be off in a free oscillation.
OSCILLATION_SHARE = 0.2

_AMPLITUDE = 2e-3  # of the length
_PERIOD = 0.01  # s


@dataclass(frozen=True, kw_only=True)
class ExtremeRow(Record):
    """A run.

    Attributes:
        case, model, n: What was run; model, and its number of hinges or pieces.
        integrator: Its name.
        error: [m], largest distance of the tip from the truth, or where it comes to rest.
        bound: [m], what it may be.
        verdict, why: What became of it; see `evaluation.models.runs.Verdict`.
        cost: [s], processor time of the run.
        reference, uncertainty: The truth, and how well it is known [m].
    """

    case: str
    model: str
    n: int
    integrator: str
    error: float | None = quantity("mm", ".2g")
    bound: float = quantity("mm", ".2g")
    verdict: Verdict
    why: str | None
    cost: float | None = quantity("s", ".2g", "time")
    reference: str
    uncertainty: float | None = None

    @property
    def run(self) -> str:
        """The model for people, and the integrator where it is one of two."""
        name = self.model.removeprefix("mujoco_")
        return f"{name}, mj_step" if self.integrator == RULE else name


#: A tip (2,) [m], and where it comes from.
Truth = tuple[ndarray, str]


@dataclass(frozen=True)
class Case:
    """A robot, its inputs over time and what is known of the motion.

    Attributes:
        name: Name in the report.
        robot: The robot.
        values: (k, n_inputs), inputs, each held for `hold`.
        hold: [s].
        duration: [s].
        loads: Loads.
        drive: "tension" or "length".
        truths: Where the tip comes to rest (2,) [m], and a text: of models of other physics, rods
            that can be compressed and the continuum with its large strains, by their names, and
            of all others by ""; without it a refined run is the truth.
        angle: Start of the coordinates, for robots that start straight but for rounding.
    """

    name: str
    robot: RobotParams
    values: ndarray
    hold: float
    duration: float
    loads: tuple[Load, ...] = ()
    drive: str = "tension"
    truths: Mapping[str, Truth] = field(default_factory=dict)
    angle: float = 0.0

    @property
    def moved(self) -> Excitation:
        """What the drives and loads do."""
        index = np.arange(round(self.duration / _PERIOD)) // round(self.hold / _PERIOD)
        controls = self.values[np.minimum(index, len(self.values) - 1)]
        return Excitation(np.zeros(controls.shape[1]), controls, _PERIOD)

    def build(self, model: str, n: int, **options: Any) -> Simulated:
        """A model with n hinges or pieces; options of `SceneConfig` or `BeamModel.simulate`."""
        if model == CHAIN:
            own = {"actuation": self.drive, "loads": self.loads} | options
            scene = build_scene(SceneConfig(self.robot, pieces=n // 2, **own))
            return Simulated(scene, self.robot)
        beam = make_beam(model, self.robot, n, loads=self.loads, drive=self.drive)
        return Simulated(beam, self.robot, options)

    def start(self, simulated: Simulated) -> State:
        """Straight, but for the angle."""
        model = simulated.model
        scale = 1.0 if isinstance(model, Scene) else model.data.scale
        q, v = model.start()
        return State(q + self.angle * scale, v)


def damped(robot: RobotParams, damping_ratio: float) -> RobotParams:
    """The robot with a damping ratio of its first mode."""
    return replace(robot, damping_time=damping_ratio / (pi * robot.first_frequency))


def settling(name: str, robot: RobotParams, truths: Mapping[str, Truth], **load: Any) -> Case:
    """A load at the tip that grows over one first period of a well damped robot, which settles."""
    robot = damped(robot, 0.5)
    period = 1 / robot.first_frequency
    ramp = np.linspace(0, 1, max(2, ceil(period / _PERIOD)))[:, None]
    loads = (Load("load", robot.length, **load),)
    return Case(name, robot, ramp, _PERIOD, 5 * period, loads=loads, truths=truths)


def bare(robot: RobotParams) -> RobotParams:
    """The robot without tendons and weight."""
    return replace(weightless(robot), tendons=())


def curl(turns: float = 1.25) -> Case:
    """A tip moment that bends a rod to more than a full circle.

    Its length is 40 radii: the arm's thick section would compress a St. Venant-Kirchhoff continuum
    beyond its largest stress.
    """
    robot, curvature = rod_of(40), 2 * pi * turns / ARM.length
    moment = curvature * robot.bending_stiffness
    truths = {
        "": (arc_tip(robot.length, curvature), "circular arc (exact)"),
        "ancf2d": (continuum_arc_tip(robot, moment), CONTINUUM_ARC),
    }
    return settling("curl_moment", robot, truths, moment=(0.0, moment, 0.0), follows=True)


def follower(strength: float = 3.0) -> Case:
    """A lateral tip force that turns with the tip, in units of EI / L^2."""
    robot = bare(ARM)
    force = strength * robot.bending_stiffness / robot.length**2
    load = {"force": (force, 0.0, 0.0), "follows": True}
    loads, ends = (Load("load", robot.length, **load),), np.array([0.0, robot.length])
    tip = followed_rod(robot.length, section(robot, None), loads, ends).tip[[0, 2]]
    return settling("follower_force", robot, {"": (tip, "rod from the tip (exact)")}, **load)


def tip_force(name: str, robot: RobotParams, strength: float, independent: bool = True) -> Case:
    """A dead lateral tip force, in units of EI / L^2, on a robot without tendons and weight."""
    robot = bare(robot)
    force = strength * robot.bending_stiffness / robot.length**2
    tip = elastica(robot.length, robot.bending_stiffness, force=(force, 0.0)).tip
    truths = {"": (tip, "elastica (exact)")} if independent else {}
    return settling(name, robot, truths, force=(force, 0.0, 0.0))


def rod_of(slenderness: float) -> RobotParams:
    """A solid rod of the arm's length and material with length / radius given."""
    return replace(bare(ARM), outer_radius=ARM.length / slenderness, inner_radius=0.0)


def tension_limit() -> Case:
    """The longest upper tendon jumps to its limit.

    All three at once would swing the arm beyond the curvature 1 / outer radius, where the inner
    side folds. A St. Venant-Kirchhoff continuum (ANCF) has no equilibrium at this tension: its
    fibres soften under compression (`studies.truths.continuum_arc` finds none from about 75 N on).
    """
    tension = np.array([0.0] * (len(ARM.tendons) - 2) + [ARM.tendons[-2].tension_limit, 0.0])
    tip = ConstantCurvatureStatics(ARM).tip(TendonMap(ARM).reduced(tension))
    pressed = tendon_rod(ARM, tension, [ARM.length], SHEAR.shear_coefficient).tip[[0, 2]]
    truths = {
        "": (tip, "constant curvature (exact)"),
        "cosserat": (pressed, "constant curvature and compression (exact)"),
        "ancf2d": (tip, "constant curvature; this continuum has no equilibrium"),
    }
    return Case("tension_limit", ARM, tension[None], 1.0, 8.0, truths=truths)


def slack_taut(pull: float = 0.01, stiffness: float = 2e4) -> Case:
    """Elastic tendons driven by length, pulled in and let go in turn: half of them hang slack."""
    tendons = tuple(replace(t, stiffness=stiffness, pretension=1.0) for t in ARM.tendons)
    sides = np.array([np.sign(t.offset[0]) for t in tendons])
    values = pull * np.array([(-1) ** k * sides for k in range(12)])
    return Case("slack_taut", replace(ARM, tendons=tendons), values, 0.25, 3.0, drive="length")


def repeated_steps(tension: float = 40.0) -> Case:
    """Tensions that jump from one side to the other before the arm comes to rest."""
    up = np.array([t.offset[0] > 0 for t in ARM.tendons])
    values = tension * np.array([up if k % 2 == 0 else ~up for k in range(12)])
    return Case("repeated_steps", ARM, values, 0.3, 3.6)


def straight(angle: float) -> Case:
    """A tension step that starts from the straight pose, exactly or but for rounding."""
    values = np.array([[20.0] + [0.0] * (len(ARM.tendons) - 1)])
    return Case(f"straight_start_{angle:g}", ARM, values, 1.0, 2.0, angle=angle)


def longest_pair(name: str) -> Case:
    """A tension step with the longest pair alone, which leaves the number of pieces free."""
    return Case(name, replace(ARM, tendons=ARM.tendons[-2:]), np.array([[20.0, 0.0]]), 1.0, 3.0)


# ---------------------------------------------------------------- running


def jobs(quick: bool = False) -> Iterator[Job]:
    """All cases on all models; n is chosen per case."""
    weak = replace(CANTILEVER_WEAK, poisson_ratio=0.49)
    cases = [  # with hinges of the chain, and pieces of the beams
        (curl(), 24, 24),
        (tension_limit(), 12, 12),
        (slack_taut(), 12, 6),
        (straight(0.0), 12, 6),
        (straight(1e-12), 12, 6),
        (longest_pair("one_piece"), 2, 1),
    ]
    if not quick:
        cases += [
            (follower(), 24, 12),
            (repeated_steps(), 12, 6),
            (tip_force("near_incompressible", weak, 3.0), 24, 12),
            (tip_force("slender_500", rod_of(500), 2.0), 24, 12),
            (tip_force("thick_2", rod_of(2), 1.0, independent=False), 12, 6),
            (longest_pair("many_pieces"), 64, 64),
        ]
    for (case, hinges, pieces), model in product(cases, (CHAIN, *BEAMS)):
        n = hinges if model == CHAIN else pieces
        yield f"{case.name}, {model}", partial(rows_of, case, model, n)
    duration = 60.0 if quick else 600.0
    for damping, model in product((0.0, 1e-4), (CHAIN, *BEAMS)):
        yield f"free oscillation, {model}", partial(oscillation_rows, model, 6, damping, duration)


def built(model: str, build: Callable[..., Simulated]) -> Iterator[Simulated]:
    """A model as the package runs it; the chain also as `mj_step` does."""
    for options in [{}, {"integrator": RULE}] if model == CHAIN else [{}]:
        yield build(**options)


def rows_of(case: Case, model: str, n: int) -> list[ExtremeRow]:
    """Runs of one case on one model, judged where the tip comes to rest or by refined runs."""
    tip, text = case.truths.get(model, case.truths.get("", (None, "")))
    first, moved = 0 if tip is None else -1, case.moved
    truth = refined(case, model, n) if tip is None else Limit(np.insert(tip, 1, 0.0)[None], 0, text)
    about = {"case": case.name, "model": model, "n": n, "bound": WRONG_SHARE * case.robot.length}
    about |= {"reference": truth.text, "uncertainty": truth.uncertainty}
    return [
        run(each, case.start(each), moved, lambda tips: distance(tips[first:], truth.tips), **about)
        for each in built(model, partial(case.build, model, n))
    ]


def refined(case: Case, model: str, n: int) -> Limit:
    """A run without the angle in far smaller steps, and how far it is from a coarser one.

    Those of beams are of one length, so that they are independent of steps that adapt.
    """
    period, moved = 1 / case.robot.first_frequency, case.moved
    finer = [{"step": _PERIOD / ceil(_PERIOD * steps / period)} for steps in _STEPS]
    if model == CHAIN:
        finer = [{"accuracy": accuracy} for accuracy in _ACCURACIES]
    coarse, fine = (
        each.motion(moved, each.model.start())
        for each in (case.build(model, n, **options) for options in finer)
    )
    return Limit(fine, distance(coarse, fine), "refined run of the same model")


def run(
    simulated: Simulated,
    start: State,
    moved: Excitation,
    error_of: Callable[[ndarray], float],
    **about: Any,
) -> ExtremeRow:
    """A run whose tips (1 + periods, 3) [m] have an error [m]."""
    failure = warning = error = None
    begin = process_time()
    try:
        tips, warning = with_warning(lambda: simulated.motion(moved, start))
        if (about.get("uncertainty") or 0.0) <= _TRUSTED * about["bound"]:
            error = error_of(tips)
    except IntegrationError as failed:
        failure = str(failed)
    model, bound = simulated.model, about["bound"]
    return ExtremeRow(
        **about,
        integrator=model.timestep.integrator if isinstance(model, Scene) else "sdirk4",
        error=error,
        verdict=verdict_of(error, bound, simulated.robot.length, failure=failure, warning=warning),
        why=failure or warning,
        cost=process_time() - begin,
    )


def oscillation_rows(model: str, n: int, damping: float, duration: float) -> list[ExtremeRow]:
    """A small free oscillation in the first mode, against the linear solution of the model."""
    robot = damped(bare(ARM), damping)
    amplitude, time = _AMPLITUDE * robot.length, _PERIOD * np.arange(round(duration / _PERIOD) + 1)
    case = Case("", robot, np.empty((1, 0)), duration, duration)
    name = "oscillation_damped" if damping else "oscillation"
    about = {"case": name, "model": model, "n": n}
    about |= {"bound": OSCILLATION_SHARE * amplitude, "reference": "linear solution"}
    rows = []
    for each in built(model, partial(case.build, model, n)):
        q, frequency = _released(each.model, amplitude)
        expected = _linear(time, frequency, damping, robot.damping_time) * amplitude
        start, moved = State(q, each.model.start().v), case.moved
        rows.append(
            run(each, start, moved, lambda tips, x=expected: np.abs(tips[:, 0] - x).max(), **about)
        )
    return rows


def _linear(time: ndarray, frequency: float, damping: float, mu: float) -> ndarray:
    """Free oscillation (k,) from unit deflection at rest; `frequency` undamped [rad/s]."""
    if damping == 0:
        return np.cos(frequency * time)
    rate = mu * frequency**2 / 2
    swing = np.sqrt(frequency**2 - rate**2)
    decay = np.exp(-rate * time)
    return decay * (np.cos(swing * time) + rate / swing * np.sin(swing * time))


def _released(model: Scene | BeamModel, amplitude: float) -> tuple[ndarray, float]:
    """Coordinates in the first mode with a tip deflection [m], and its frequency [rad/s]."""
    rest, v = model.start()
    if isinstance(model, Scene):
        linear = linearize(model.model)
        arms = model.config.robot.length - model.layout.stations
        shape, frequency = _first_mode(linear.mass, linear.stiffness, arms)
        return shape * amplitude, frequency
    space = model.linearize(State(rest, v))
    shape, frequency = _first_mode(space.mass, space.stiffness, space.c[0, : len(space.mass)])
    return rest + model.tangent(rest) @ (shape * amplitude), frequency


def _first_mode(mass: ndarray, stiffness: ndarray, arms: ndarray) -> tuple[ndarray, float]:
    """Shape of the slowest mode, of unit tip deflection, and its frequency [rad/s].

    Bending in two planes is equally slow: `arms` (m,), from joints to the tip, pick the plane.
    """
    squares, shapes = eigh(stiffness, mass)
    slow = shapes[:, squares < squares[0] * (1 + 1e-6)]
    weights = arms @ slow
    return slow @ weights / float(weights @ weights), float(np.sqrt(squares[0]))
