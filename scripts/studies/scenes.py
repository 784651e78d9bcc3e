"""Random scenes, stepped as environments step them, judged against refined runs.

Every scene runs at the package's own choice of integrator and timestep: is any silently wrong?
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil, isfinite, pi
from time import perf_counter
from typing import Any

import mujoco
import numpy as np
from numpy import ndarray
from rich.table import Table
from scipy.linalg import eigh

from softrobot_env.core.motion import IntegrationError, State
from softrobot_env.evaluation.models import runs
from softrobot_env.rendering import figures
from softrobot_env.rendering.tables import Column, new_table
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.chain import posture
from softrobot_env.scene.config import DEFAULT_SHARE, FINEST, SceneConfig
from softrobot_env.scene.timestep import linearize
from studies.beams import zero_timestep
from studies.lab import Record, Study, lines, pivot, quantity, select, table
from studies.scenes_drawn import G, RandomScene, draw_scene, swing, weight_load

#: An estimate is good if the error is within this factor of it.
GOOD_FACTOR = 3.0


@dataclass(frozen=True)
class Row(Record):
    """A scene.

    Attributes:
        seed, index: What it was drawn from, see `scenes_drawn`.
        bending, torsion, actuation, pieces: See `SceneConfig`.
        joints: Degrees of freedom; None of a scene that was refused.
        length: [m].
        slenderness: Length over outer radius [1].
        youngs_modulus: [Pa].
        density: [kg/m3].
        damping_ratio: [1] of the first elastic mode.
        gravity: In units of that of the earth.
        weight_load: Rho A g L^3 / EI [1].
        tendons: Number.
        guided: Whether any runs through guides, not in a channel.
        friction, pretension: Largest of a tendon, over its tension limit [1].
        head: Its mass over the robot's [1], zero without.
        loaded: Whether a load acts on it.
        excitation: One of `studies.scenes_drawn.EXCITATIONS`.
        control_period, duration: [s].
        verdict: What became of it.
        why: What failed, or why it was not judged; None otherwise.
        refined_fine: Of a failure, whether refined runs end and agree.
        error: [m], largest distance of the tip from the truth.
        error_share: Over the length [1].
        asked_share: What was asked for, over the length [1].
        estimate_share: The package's own estimate of the error, over the length [1]; None if it
            gives none, knows no bound or failed.
        warning: What a `TimestepWarning` said.
        integrator, timestep, substeps: Of the package's choice; timestep in s.
        wall_time: [s] of the package's run.
        reference: How the refined runs were made.
        uncertainty: [m], distance of the two best refined runs; None if one of them diverged.
    """

    seed: int
    index: int = quantity("", "d", "no.")
    bending: str
    torsion: bool
    actuation: str
    pieces: int
    joints: int | None = quantity("", "d")
    length: float
    slenderness: float = quantity("", ".0f", "L/r")
    youngs_modulus: float = quantity("Pa", ".0e", "E")
    density: float
    damping_ratio: float = quantity("", ".0e", "zeta")
    gravity: float
    weight_load: float = quantity("", ".0e", "sag")
    tendons: int
    guided: bool
    friction: float
    pretension: float
    head: float
    loaded: bool
    excitation: str
    control_period: float
    duration: float
    verdict: runs.Verdict
    why: str | None
    refined_fine: bool | None
    error: float | None
    error_share: float | None = quantity("%", ".2g", "error")
    asked_share: float
    estimate_share: float | None = quantity("%", ".2g", "estimate")
    warning: str | None
    integrator: str | None
    timestep: float | None
    substeps: int | None
    wall_time: float | None
    reference: str | None
    uncertainty: float | None

    @property
    def estimate_is_good(self) -> bool | None:
        """Whether error and estimate are within a factor of `GOOD_FACTOR`; None without both."""
        if self.estimate_share is None or not self.error_share:
            return None
        ratio = self.estimate_share / self.error_share
        return bool(1 / GOOD_FACTOR <= ratio <= GOOD_FACTOR)

    @property
    def excess(self) -> float:
        """Error over the estimate [1], less what the truth's doubt and rounding make of it.

        0 without both.
        """
        if self.estimate_share is None or self.error is None:
            return 0.0
        doubt = FINEST * self.length + (self.uncertainty or 0.0)
        return max(self.error - doubt, 0.0) / max(self.estimate_share * self.length, 1e-300)

    @property
    def beyond_twice(self) -> bool:
        """Whether the error is beyond twice the estimate."""
        return self.excess > 2

    @property
    def beyond_tenfold(self) -> bool:
        """Whether the error is beyond ten times the estimate."""
        return self.excess > 10


# -------------------- refined runs
#
# The same chain in ever finer steps, until two runs agree. A chain whose fastest mode swings freely
# is integrated by the Runge-Kutta scheme of order four, one whose fast modes creep (explicit steps
# would have to be tiny) by implicitfast, extrapolated to zero timestep, from three runs. Tendons
# that rub take discrete, extrapolated too: the others find the friction as if the joints were
# undamped, and on a stiff overdamped chain are far off until the steps resolve its fastest creep.
# None knows the rule that picks a scene's timestep. Steps are halved until two successive results
# agree, or the next ones would cost more than `BUDGET`.

#: Nominal cost [s] that the refined runs of a scene may have: of a step, not the clock's, so that
#: verdicts do not depend on the machine.
BUDGET = 10.0

#: Explicit steps are taken while they are not shorter than implicit ones by more than this factor.
_SHORTER = 4.0

#: First refined step, in first periods and in stability limits, and steps per control period at
#: least.
_OF_PERIOD, _OF_LIMIT, _LEAST = 1 / 60, 0.6, 4

#: First refined step in first periods where tendons rub and stick in turns.
_RUBBING = 1 / 400

#: [s], time constant of dry friction in refined runs. MuJoCo's friction is soft: a tendon that
#: should stick creeps for about that long, or for two timesteps if they are longer. So Coulomb's
#: law is met in the limit of short steps.
_FRICTION = 1e-9

#: MuJoCo's warnings of a diverged state. Accelerations are left out: those of small, stiff robots
#: exceed what it takes for sane (1e10 rad/s2).
_DIVERGED = (int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADQVEL))


@dataclass(frozen=True)
class Refined:
    """What refined runs say.

    Attributes:
        tips: (1 + periods, 3) [m] at the start and after each control period; None if no two of
            them ended.
        uncertainty: [m], distance between the two best; None without them.
        substeps: Steps per control period of the finest.
        method: "RK4", or "implicitfast extrapolated", "discrete extrapolated".
    """

    tips: ndarray | None
    uncertainty: float | None
    substeps: int
    method: str


def step_cost(nv: int, integrator: str) -> float:
    """Nominal time [s] of a step of a chain with nv degrees of freedom.

    Fitted to chains of 12 to 180 on one core of a server (`studies.beams.step_cost`).
    """
    one = 1e-6 * (1.5 + 0.1 * nv + 0.016 * nv**2)
    return one * {"RK4": 3.0, "implicitfast": 1.0, "discrete": 1.0}.get(integrator, 2.0)


def neutral_scene(config: SceneConfig) -> Scene:
    """The scene with an integrator that no timestep warns of; both are set before every run."""
    return build_scene(replace(config, integrator="discrete", timestep=config.control_period))


def start_posture(scene: Scene, drawn: RandomScene) -> ndarray:
    """Posture (nq,) in which a drawn scene starts."""
    kinds = 1 if scene.config.bending == "planar" else 3 if scene.config.torsion else 2
    return posture(scene.model, np.outer(scene.layout.weights, drawn.curvature[:kinds]))


def refine(scene: Scene, drawn: RandomScene, enough: Callable[[ndarray, float], bool]) -> Refined:
    """Halve the timestep until results agree.

    Args:
        scene: The compiled scene, whose integrator, timestep and friction are changed.
        drawn: Where it starts and what drives it.
        enough: Whether tips (1 + periods, 3) [m] with an uncertainty [m] are good enough.
    """
    scene.model.tendon_solref_fri[:, 0] = _FRICTION
    method, substeps = _first(scene)
    name = method if method == "RK4" else f"{method} extrapolated"
    cost = step_cost(scene.model.nv, method)
    found, series, spent = None, [], 0.0
    while spent + cost * substeps * len(drawn.controls) <= BUDGET:
        run = refined_run(scene, drawn, method, substeps)
        spent += cost * substeps * len(run)
        ended = len(run) > len(drawn.controls)
        series = [*series, run] if ended else []  # a failed step size ends a series
        found = _estimate(method, series) or found
        if found is not None and enough(*found):
            break
        substeps *= 2
    tips, uncertainty = found or (None, None)
    return Refined(tips, uncertainty, substeps, name)


def _first(scene: Scene) -> tuple[str, int]:
    """Method, and its steps per control period in the coarsest of the refined runs."""
    chain, period = linearize(scene.model), scene.config.control_period
    fastest = float(eigh(chain.stiffness, chain.mass, eigvals_only=True)[-1]) ** 0.5
    creep = float(eigh(chain.damping, chain.mass, eigvals_only=True)[-1])
    implicit = max(2 / fastest, 2 * creep / fastest**2)
    steps = {"RK4": 2 / max(fastest, creep), "implicitfast": implicit}
    method = "RK4" if _SHORTER * steps["RK4"] >= steps["implicitfast"] else "implicitfast"
    step = min(_OF_LIMIT * steps[method], _OF_PERIOD / swing(scene.config.robot))
    if scene.config.robot.has_friction:
        method, step = "discrete", min(step, _RUBBING / swing(scene.config.robot))
    return method, max(_LEAST, ceil(period / step))


def _estimate(method: str, series: list[ndarray]) -> tuple[ndarray, float] | None:
    """Best tips of successive refinements and how far they are from the next best."""
    if method == "RK4":
        return (series[-1], runs.distance(series[-1], series[-2])) if len(series) > 1 else None
    if len(series) < 4:  # friction and tendons that go slack make the error no series in the step
        return None
    best, before = (zero_timestep(three)[0] for three in (series[-3:], series[-4:-1]))
    return best, runs.distance(best, before)


def refined_run(scene: Scene, drawn: RandomScene, integrator: str, substeps: int) -> ndarray:
    """Tips (1 + periods, 3) [m] of a run with fixed steps; fewer if it diverged."""
    model, period = scene.model, scene.config.control_period
    model.opt.timestep = period / substeps
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    data = mujoco.MjData(model)
    data.qpos[:] = start_posture(scene, drawn)
    mujoco.mj_kinematics(model, data)
    tip = data.site("tip").xpos
    tips = [tip.copy()]
    for row in drawn.controls:
        data.ctrl[:] = row
        mujoco.mj_step(model, data, substeps)
        mujoco.mj_kinematics(model, data)
        if any(data.warning[kind].number for kind in _DIVERGED) or not np.all(np.isfinite(tip)):
            break
        tips.append(tip.copy())
    return np.array(tips)


# -------------------- the package's own run, and its row

#: A truth is good enough if it is known to this share of the accuracy asked for, or of the error.
_CLEAR, _CLEARLY_WRONG = 0.25, 0.1

#: Nominal cost [s] above which the package's own run is not made.
_DEAREST = 10.0


@dataclass(frozen=True)
class OwnRun:
    """What the package does by itself.

    Attributes:
        scene: The compiled scene; None if it was refused.
        tips: (1 + periods, 3) [m]; None if the run failed or was not made.
        failure: Why it failed, or None.
        wall_time: [s] of the steps.
        estimate: [m], the package's own estimate of the error in time; None if it gives none.
    """

    scene: Scene | None
    tips: ndarray | None = None
    failure: str | None = None
    wall_time: float | None = None
    estimate: float | None = None


def judge(drawn: RandomScene) -> Row:
    """Run a scene and judge it."""
    with runs.silent_warnings():
        own, warning = runs.with_warning(lambda: _own_run(drawn))
        truth = _truth(drawn, own)
    error = None if own.tips is None or truth.tips is None else runs.distance(own.tips, truth.tips)
    asked, length = drawn.config.wanted_accuracy, drawn.config.robot.length
    verdict = runs.verdict_of(error, asked, length, failure=own.failure, warning=warning)
    why = own.failure or (_why_unjudged(truth, length) if error is None else None)
    lengths = {"error": error, "asked": asked, "estimate": _bounded(own.estimate)}
    shares = {f"{name}_share": x if x is None else x / length for name, x in lengths.items()}
    judged = {"verdict": verdict, "why": why, "warning": warning, "wall_time": own.wall_time}
    failed = own.failure is not None and own.scene is not None
    choice = own.scene and own.scene.timestep
    return Row(
        **_description(drawn),
        **{name: getattr(choice, name, None) for name in ("integrator", "timestep", "substeps")},
        joints=own.scene and own.scene.model.nv,
        **shares,
        error=error,
        **judged,
        refined_fine=truth.tips is not None if failed else None,
        reference=f"{truth.method}, {truth.substeps} steps a period" if truth.substeps else None,
        uncertainty=_bounded(truth.uncertainty),
    )


def _own_run(drawn: RandomScene) -> OwnRun:
    try:
        scene = build_scene(drawn.config)
    except Exception as error:  # what a user sees instead of a scene, whatever it is
        return OwnRun(None, failure=f"{type(error).__name__}: {error}")
    choice = scene.timestep
    cost = step_cost(scene.model.nv, choice.integrator) * choice.substeps * len(drawn.controls)
    if cost > _DEAREST:
        return OwnRun(scene)
    start = State(start_posture(scene, drawn), np.zeros(scene.model.nv))
    begin = perf_counter()
    try:
        period = drawn.config.control_period
        motion = scene.simulate(drawn.duration, drawn.controls, start, samples=period)
    except IntegrationError as error:
        return OwnRun(scene, failure=str(error), wall_time=perf_counter() - begin)
    wall_time = perf_counter() - begin
    estimates = motion.integration_error
    estimate = None if estimates is None else float(estimates[-1])
    return OwnRun(scene, scene.tip(motion.q), None, wall_time, estimate)


def _truth(drawn: RandomScene, own: OwnRun) -> Refined:
    """Refined runs, as fine as it takes to judge the own one."""
    if own.scene is None or (own.tips is None and own.failure is None):
        return Refined(None, None, 0, "none")

    def enough(tips: ndarray, uncertainty: float) -> bool:
        error = 0.0 if own.tips is None else runs.distance(own.tips, tips)
        return uncertainty <= max(_CLEAR * drawn.config.wanted_accuracy, _CLEARLY_WRONG * error)

    truth = refine(neutral_scene(drawn.config), drawn, enough)
    clear = truth.tips is not None and enough(truth.tips, truth.uncertainty)
    return truth if clear else replace(truth, tips=None)


def _bounded(value: float | None) -> float | None:
    return value if value is not None and isfinite(value) else None


def _description(drawn: RandomScene) -> dict[str, Any]:
    config, robot = drawn.config, drawn.config.robot
    found = {name: getattr(drawn, name) for name in ("seed", "index", "excitation", "duration")}
    for name in ("bending", "torsion", "actuation", "control_period"):
        found[name] = getattr(config, name)
    for name in ("length", "youngs_modulus", "density"):
        found[name] = getattr(robot, name)
    for name in ("friction", "pretension"):
        shares = (getattr(tendon, name) / tendon.tension_limit for tendon in robot.tendons)
        found[name] = max(shares, default=0.0)
    return found | {
        "pieces": config.n_pieces,
        "slenderness": robot.length / robot.outer_radius,
        "damping_ratio": robot.damping_time * pi * robot.first_frequency,
        "gravity": float(np.linalg.norm(robot.gravity)) / G,
        "weight_load": weight_load(robot),
        "tendons": len(robot.tendons),
        "guided": any(tendon.guides for tendon in robot.tendons),
        "head": 0.0 if robot.head is None else robot.head.mass / robot.mass,
        "loaded": bool(config.loads),
    }


def _why_unjudged(truth: Refined, length: float) -> str:
    if not truth.substeps:
        return "the scene's own steps are too many"
    if truth.uncertainty is None:
        return "too few refined runs ended within the budget"
    return f"refined runs differ by {100 * truth.uncertainty / length:.2g} % of the length"


# -------------------- tables and pictures

#: Groups of scenes that are compared.
_GROUPS: dict[str, Callable[[Row], bool]] = {
    "planar": lambda r: r.bending == "planar",
    "spatial, rigid in torsion": lambda r: r.bending == "spatial" and not r.torsion,
    "spatial with torsion": lambda r: r.torsion,
    "driven by tension": lambda r: r.actuation == "tension",
    "driven by length": lambda r: r.actuation == "length",
    "tendons through guides": lambda r: r.guided,
    "tendons that rub": lambda r: r.friction > 0,
    "tendons with pretension": lambda r: r.pretension > 0,
    "with a head": lambda r: r.head > 0,
    "with a load": lambda r: r.loaded,
    "no gravity": lambda r: r.gravity == 0,
    "rho A g L^3 / EI up to 10": lambda r: 0 < r.weight_load <= 10,
    "rho A g L^3 / EI up to 1000": lambda r: 10 < r.weight_load <= 1000,
    "rho A g L^3 / EI above 1000": lambda r: r.weight_load > 1000,
    "damping ratio below 0.003": lambda r: r.damping_ratio < 0.003,
    "damping ratio 0.003 to 0.03": lambda r: 0.003 <= r.damping_ratio < 0.03,
    "damping ratio above 0.03": lambda r: r.damping_ratio >= 0.03,
    "steps": lambda r: r.excitation == "steps",
    "sines": lambda r: r.excitation == "sines",
    "let go": lambda r: r.excitation == "let_go",
}


def _count(name: str) -> Callable[[list[Row]], int]:
    """How many rows have, or are, something."""
    return lambda rows: sum(bool(getattr(row, name)) for row in rows)


def _compared(rows: Sequence[Row]) -> Table:
    out = new_table("Verdicts by what the scenes have", ("scenes",), tuple(runs.Verdict))
    by = [select(rows, verdict=verdict) for verdict in runs.Verdict]
    for name, test in _GROUPS.items():
        out.add_row(name, *(sum(map(test, mine)) for mine in by))
    return out


def _chain(row: Row) -> str:
    chain = "2-D" if row.bending == "planar" else "torsion" if row.torsion else "3-D"
    return f"{chain} {row.actuation} {row.excitation.replace('_', ' ')}"


def _steps(row: Row) -> str | None:
    short = {"extrapolation": "ex", "Euler": "eu", "RK4": "rk", "implicitfast": "if"}
    return row.substeps and f"{row.substeps} {short.get(row.integrator, row.integrator[:2])}"


def _why(row: Row) -> str | None:
    """What failed and when, without the names of coordinates."""
    if row.why is None:
        return None
    before, _, after = row.why.partition("in the control period ending ")
    return (before + after.split(": not finite")[0]).removeprefix("simulation ")


def _listed(rows: Sequence[Row]) -> list[Table]:
    """All scenes that are not accurate or whose estimate is too small, the worst first."""
    return table(
        "Scenes that are {verdict}",
        *("index", "joints", Column("chain", _chain), "slenderness", "youngs_modulus"),
        *("damping_ratio", "weight_load", Column("steps", _steps, ">"), "error_share"),
        *("estimate_share", "refined_fine", Column("why", _why)),
        where=lambda row: row.verdict != runs.Verdict.ACCURATE or row.beyond_twice,
        per=("verdict",),
        caption="sag: rho A g L^3 / EI; steps per control period and integrator; accurate ones "
        "whose error is beyond twice the estimate",
    )(sorted(rows, key=lambda row: -(row.error_share or 0.0)))


#: Verdict -> how it looks.
_STYLES = {
    runs.Verdict.ACCURATE: figures.Style(figures.GREEN, "o"),
    runs.Verdict.WARNED: figures.Style(figures.BLUE, "v"),
    runs.Verdict.INACCURATE: figures.Style(figures.ORANGE, "^"),
    runs.Verdict.WRONG: figures.Style(figures.VERMILLION, "D"),
}


def _message(rows: Sequence[Row]) -> str:
    good = sum(map(bool, (row.estimate_is_good for row in rows)))
    return f"Of {len(rows)} estimates {good} are within a factor of {GOOD_FACTOR:g} of the error"


def _bounds(axis: figures.Axes, rows: Sequence[Row], _: str) -> None:
    """Where estimates are good, what was asked for, and from where on a run is wrong."""
    line = np.array([1e-5, 1e2])
    axis.plot(line, line, color=figures.GREY, linewidth=0.9)
    axis.fill_between(line, line / GOOD_FACTOR, line * GOOD_FACTOR, color="0.93", zorder=0)
    axis.axhline(100 * rows[0].asked_share, **figures.REFERENCE | {"label": "asked for"})
    axis.set(xlim=line, ylim=line)


# -------------------- the study

#: Number of scenes, and of a quick run.
COUNT, QUICK_COUNT = 200, 20


def cases(quick: bool = False, count: int | None = None, seed: int = 0) -> list[tuple[int, int]]:
    """Seeds and indices of scenes; a larger count adds scenes to the same ones."""
    count = (QUICK_COUNT if quick else COUNT) if count is None else count
    return [(seed, index) for index in range(count)]


def measure(case: tuple[int, int]) -> Row:
    """The row of one random scene."""
    return judge(draw_scene(*case))


STUDY = Study(
    kinds=(Row,),
    cases=cases,
    measure=measure,
    label=lambda case: f"scene {case[1]}",
    tables=[
        pivot(
            f"Verdicts; accuracy asked for {DEFAULT_SHARE} of the length",
            ("verdict",),
            {
                "scenes": len,
                "warned": _count("warning"),
                "refined fine": _count("refined_fine"),
                f"within {GOOD_FACTOR:g}x": _count("estimate_is_good"),
                "beyond 2x": _count("beyond_twice"),
                "beyond 10x": _count("beyond_tenfold"),
            },
        ),
        _compared,
        _listed,
    ],
    note=f"inaccurate, wrong: without a warning, up to and beyond {100 * runs.WRONG_SHARE:g} % of "
    "the length; unjudged: refined runs disagree or cost too much; refined fine: refined runs end "
    "and agree where the scene failed; within, beyond: the error, of so many times the estimate",
    plots={
        "{}": lines(
            "estimate_share",
            "error_share",
            "verdict",
            title=_message,
            subject="Random scenes: tip errors over the length, against refined runs",
            where=lambda row: row.error_share is not None and row.estimate_share is not None,
            log="xy",
            style=_STYLES.__getitem__,
            line={"linestyle": "none", "markersize": 5},
            size=(7.5, 5.0),
            legend=True,
            decorate=_bounds,
        )
    },
    options=("count", "seed"),
)
