"""Extreme cases: large bends, slack tendons, jumps, extreme sections and a long free oscillation.

The chain runs with what the timestep rule picks, the beam models with sdirk4 at a fixed step and
with steps adapted to its error estimate.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from math import ceil, pi
from typing import Any

import numpy as np
from numpy import ndarray
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

from softrobot_env.beams import signals
from softrobot_env.beams.constant_curvature import ConstantCurvatureStatics
from softrobot_env.beams.model import State
from softrobot_env.evaluation.models.runs import WRONG_SHARE
from softrobot_env.robots import ARM, CANTILEVER_WEAK, RobotParams
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.robots.loads import Load
from softrobot_env.scene.config import SceneConfig
from studies.accuracy.cases import SHEAR
from studies.beams import make_beam, weightless
from studies.stability import runs
from studies.stability.map import damped
from studies.stability.runs import ADAPTIVE, CHAIN, Plan, Row, Trace
from studies.truths.analytic import arc_tip, elastica
from studies.truths.continuum_arc import TEXT as CONTINUUM_ARC
from studies.truths.continuum_arc import continuum_arc_tip
from studies.truths.tendon_rod import tendon_rod

#: Method of the beam models, and its steps per first period.
BEAM_METHOD = "sdirk4"
BEAM_STEPS = 250

#: Share of the amplitude that the tip may be off in a free oscillation.
OSCILLATION_SHARE = 0.2

#: Growth of the amplitude that rounding and the sampling of the peaks explain.
_GROWTH = 1.01
_AMPLITUDE = 2e-3  # of the length
_CONTROL_PERIOD = 0.01
_MOST_STEPS = 10_000_000
_REFINE = (4, 8)


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
        tip: (2,) [m], where the tip comes to rest; None compares with a refined run.
        truth: What the tip is compared with.
        angle: Start of the coordinates, for robots that start straight but for rounding.
        tips: The same by model, (2,) [m] and a text, for models of other physics: rods that
            can be compressed, and the continuum with its large strains.
    """

    name: str
    robot: RobotParams
    values: ndarray
    hold: float
    duration: float
    loads: tuple[Load, ...] = ()
    drive: str = "tension"
    tip: ndarray | None = None
    truth: str = runs.REFINED
    angle: float = 0.0
    tips: dict[str, tuple[ndarray, str]] = field(default_factory=dict)


def settling(
    name: str,
    robot: RobotParams,
    tip: ndarray | None = None,
    truth: str = runs.REFINED,
    **load: Any,
) -> Case:
    """A load at the tip that grows over one first period of a well damped robot, which settles."""
    robot = damped(robot, 0.5)
    period = 1 / robot.first_frequency
    ramp = np.linspace(0, 1, max(2, ceil(period / _CONTROL_PERIOD)))[:, None]
    loads = (Load("load", robot.length, **load),)
    return Case(name, robot, ramp, _CONTROL_PERIOD, 5 * period, loads=loads, tip=tip, truth=truth)


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
    tip, load = arc_tip(robot.length, curvature), {"moment": (0.0, moment, 0.0), "follows": True}
    case = settling("curl_moment", robot, tip, "circular arc (exact)", **load)
    return replace(case, tips={"ancf2d": (continuum_arc_tip(robot, moment), CONTINUUM_ARC)})


def follower_tip(length: float, bending_stiffness: float, force: float) -> ndarray:
    """Tip (2,) [m] of a rod under a lateral tip force [N] that turns with the tip.

    In axes that turn with the tip the force is fixed, EI p'' = -F cos p with p = p' = 0 there: an
    initial-value problem from the tip to the base.
    """

    def toward_base(s: float, y: ndarray) -> list[float]:
        return [-y[1], force / bending_stiffness * np.cos(y[0]), -np.sin(y[0]), -np.cos(y[0])]

    end = solve_ivp(toward_base, (0, length), np.zeros(4), rtol=1e-11, atol=1e-13)
    angle, _, x, z = end.y[:, -1]
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([-cos * x + sin * z, -sin * x - cos * z])


def follower(strength: float = 3.0) -> Case:
    """A lateral tip force that turns with the tip, in units of EI / L^2."""
    robot = bare(ARM)
    force = strength * robot.bending_stiffness / robot.length**2
    tip = follower_tip(robot.length, robot.bending_stiffness, force)
    load = {"force": (force, 0.0, 0.0), "follows": True}
    return settling("follower_force", robot, tip, "elastica from the tip (exact)", **load)


def tip_force(name: str, robot: RobotParams, strength: float, independent: bool = True) -> Case:
    """A dead lateral tip force, in units of EI / L^2, on a robot without tendons and weight."""
    robot = bare(robot)
    force = strength * robot.bending_stiffness / robot.length**2
    if not independent:
        return settling(name, robot, force=(force, 0.0, 0.0))
    tip = elastica(robot.length, robot.bending_stiffness, force=(force, 0.0)).tip
    truth = "elastica (boundary-value solution)"
    return settling(name, robot, tip, truth, force=(force, 0.0, 0.0))


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
    case = Case("tension_limit", ARM, tension[None], 1.0, 8.0)
    tips = {
        "cosserat": (pressed, "constant curvature and compression (exact)"),
        "ancf2d": (tip, "constant curvature; this continuum has no equilibrium"),
    }
    return replace(case, tip=tip, truth="constant curvature (exact)", tips=tips)


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


def jobs(beams: tuple[str, ...], quick: bool = False) -> Iterator[runs.Job]:
    """All cases on the chain and the given beam models; n is chosen per case."""
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
    for case, hinges, pieces in cases:
        yield f"{case.name}, chain", partial(rows_of, case, CHAIN, hinges)
        for beam in beams:
            yield f"{case.name}, {beam}", partial(rows_of, case, beam, pieces)
    duration = 60.0 if quick else 600.0
    for damping in (0.0, 1e-4):
        for model in (CHAIN, *beams):
            run = partial(oscillation_row, model, 6, damping, duration)
            yield f"free oscillation, {model}", lambda r=run: [r()]


def rows_of(case: Case, model: str, n: int) -> list[Row]:
    """Runs of one case on one model; beams with fixed and with adapted steps."""
    methods = (BEAM_METHOD,) if model == CHAIN else (BEAM_METHOD, BEAM_METHOD + ADAPTIVE)
    return [run_case(case, model, n, method) for method in methods]


def run_case(case: Case, model: str, n: int, method: str = BEAM_METHOD) -> Row:
    """Run one case on one model; `method` is for beams. Of adapted steps the mean is reported."""
    tip, truth = case.tips.get(model, (case.tip, case.truth))
    system, bound = _system(case, model, n), WRONG_SHARE * case.robot.length
    plan = _plan(case.robot, system, case.duration)
    if model != CHAIN:
        plan = replace(plan, integrator=method)
    trace, finer = system.run(plan), None
    if tip is None:  # smaller fixed steps, also for a run with adapted ones
        fixed = replace(plan, integrator=plan.integrator.removesuffix(ADAPTIVE))
        finer = runs.refined(_system(replace(case, angle=0.0), model, n), fixed, _REFINE)
        verdict = runs.judge(trace, finer, bound)
    else:
        gap = np.linalg.norm(trace.tip[-1:] - tip, axis=1)
        verdict = runs.judge_errors(trace, gap, bound, truth)
    if trace.steps:
        time = plan.timestep * plan.steps
        plan = replace(plan, timestep=time / trace.steps, steps=trace.steps)
    known = {"reference": truth, "uncertainty": finer and finer.uncertainty}
    about = {"case": case.name, "model": model, "n": n, "e_bound": bound}
    return Row.of(plan, trace, verdict, **about, **known)


def _system(case: Case, model: str, n: int) -> runs.System:
    if model == CHAIN:
        config = SceneConfig(case.robot, pieces=n // 2, actuation=case.drive, loads=case.loads)

        def controls(time: float) -> ndarray:
            return case.values[min(int(time / case.hold + 1e-6), len(case.values) - 1)]

        return runs.ChainSystem(config, np.full(n, case.angle), controls)
    beam = make_beam(model, case.robot, n, loads=case.loads, drive=case.drive)
    q = beam.rest() + case.angle * beam.data.scale
    return runs.BeamSystem(beam, q, signals.held(case.values, case.hold))


def _plan(robot: RobotParams, system: runs.System, duration: float) -> Plan:
    """The rule's choice for the chain; sdirk4 for a beam. Steps divide the control period."""
    period = 1 / robot.first_frequency
    if isinstance(system, runs.ChainSystem):
        choice = runs.rule_choice(system)
        integrator, timestep = choice.integrator, choice.timestep
    else:
        integrator = BEAM_METHOD
        timestep = _CONTROL_PERIOD / ceil(_CONTROL_PERIOD * BEAM_STEPS / period)
    steps = runs.steps_for(duration, timestep, 1, _MOST_STEPS)
    return Plan(integrator, timestep, steps, max(timestep, _CONTROL_PERIOD))


def oscillation_row(model: str, n: int, damping: float, duration: float) -> Row:
    """A small free oscillation in the first mode, against the linear solution.

    It fails if the tip leaves the linear solution by more than `OSCILLATION_SHARE` of the
    amplitude, or if the amplitude grows.
    """
    robot = damped(bare(ARM), damping)
    amplitude = _AMPLITUDE * robot.length
    system, frequency = _released(robot, model, n, amplitude)
    plan = replace(_plan(robot, system, duration), sample=0.05 / robot.first_frequency)
    trace = system.run(plan)
    bound = OSCILLATION_SHARE * amplitude
    expected = _linear(trace.time, frequency, damping, robot.damping_time) * amplitude
    gap = np.abs(trace.tip[:, 0] - expected)
    verdict = runs.judge_errors(trace, gap, bound, "the linear solution")
    if trace.failure is None and (growth := _amplitude_growth(trace)) > _GROWTH:
        text = f"finite but wrong: the free amplitude grew by a factor {growth:.3g}"
        verdict = replace(verdict, outcome=runs.WRONG, failure=text)
    name = "oscillation" if damping == 0 else "oscillation_damped"
    about = {"case": f"{name}_{duration / 60:g}min", "model": model, "n": n, "e_bound": bound}
    return Row.of(
        *(plan, trace, verdict),
        **about,
        damping_scale=robot.damping_time / ARM.damping_time,
        damping_ratio=damping,
        reference="linear solution of the same model",
    )


def _linear(time: ndarray, frequency: float, damping: float, mu: float) -> ndarray:
    """Free oscillation (k,) from unit deflection at rest; `frequency` undamped [rad/s]."""
    if damping == 0:
        return np.cos(frequency * time)
    rate = mu * frequency**2 / 2
    swing = np.sqrt(frequency**2 - rate**2)
    decay = np.exp(-rate * time)
    return decay * (np.cos(swing * time) + rate / swing * np.sin(swing * time))


def _amplitude_growth(trace: Trace) -> float:
    """Largest deflection in the last tenth over that in the first."""
    x, tenth = np.abs(trace.tip[:, 0]), len(trace.tip) // 10
    return float(np.max(x[-tenth:]) / np.max(x[:tenth]))


def _released(
    robot: RobotParams, model: str, n: int, amplitude: float
) -> tuple[runs.System, float]:
    """System in its first mode with a tip deflection [m], and the mode's frequency [rad/s]."""
    if model == CHAIN:
        chain = runs.ChainSystem(SceneConfig(robot, pieces=n // 2), np.zeros(n), np.empty(0))
        arms = robot.length - chain.scene.layout.stations
        shape, frequency = _first_mode(chain.linear.mass, chain.linear.stiffness, arms)
        chain.posture = shape * amplitude
        return chain, frequency
    beam = make_beam(model, robot, n)
    rest = beam.rest()
    space = beam.linearize(State(rest, np.zeros(beam.n)))
    shape, frequency = _first_mode(space.mass, space.stiffness, space.c[0, : len(space.mass)])
    q = rest + beam.tangent(rest) @ (shape * amplitude)
    return runs.BeamSystem(beam, q, np.empty(0)), frequency


def _first_mode(mass: ndarray, stiffness: ndarray, arms: ndarray) -> tuple[ndarray, float]:
    """Shape of the slowest mode, of unit tip deflection, and its frequency [rad/s].

    Bending in two planes is equally slow: `arms` (m,), from joints to the tip, pick the plane.
    """
    squares, shapes = eigh(stiffness, mass)
    slow = shapes[:, squares < squares[0] * (1 + 1e-6)]
    weights = arms @ slow
    return slow @ weights / float(weights @ weights), float(np.sqrt(squares[0]))
