"""Error and computing time beside SoRoMoX, and environment steps beside gym-softrobot.

Each package is as fast as it can be made, on one core. One that is not installed is noted, and the
rest is measured. Times are computing times of the process, with one thread, so that they hold on a
busy machine as well; compilation stands beside them.
"""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from importlib.util import find_spec
from math import cos, pi, sin
from time import process_time
from typing import Any

import gymnasium
import numpy as np
from numpy import ndarray
from rich.table import Table
from rich.text import Text
from scipy.optimize import root

from softrobot_env.core.motion import State
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.models.runs import Limit, best_of, front
from softrobot_env.gradients.rollout import Motion, Rollout
from softrobot_env.robots import ARM, RobotParams, Tendon
from softrobot_env.robots.sections import Section
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.config import SceneConfig
from studies.accuracy import tension_step as case
from studies.accuracy.cases import DISTRIBUTED, DURATION, TimedMotion, beam_limit
from studies.accuracy.shown import setting
from studies.lab import Column, Lab, Record, Study, groups, quantity, select, table

#: Who is compared; ours goes first in tables.
OURS = "softrobot_env"

#: Peers by the names of their packages -> module.
PEERS = {"soromox": "soromox", "gym-softrobot": "gym_softrobot"}
PEER, PEER_OF_STEPS = PEERS


@dataclass(frozen=True)
class Row(Record):
    """A motion, an environment, a ratio, or a note; None where a field does not apply.

    Attributes:
        kind: "motion", "environment", "ratio" or "note".
        package: What simulates; of a ratio and a note the peer.
        version: Of the package.
        model: Model or environment.
        n: Degrees of freedom.
        integrator: Of the motion.
        timestep, tolerance: [s] of fixed steps, or relative and absolute of adapted ones.
        e_mean, e_max: [m], distance of the tip from the converged motion.
        core_seconds: Computing time [s] of one core for a simulated second.
        compiled: Computing time [s] of the first call beyond that of a later one.
        period: [s] of a step of an environment.
        steps_per_second: Of an environment, by one core.
        value: Of a ratio: computing time of the peer over that of the fastest of ours with no
            larger mean error.
        text: Of a note; of a motion what it is compared with.
    """

    kind: str
    package: str
    version: str | None = None
    model: str | None = quantity("", "", "model", default=None)
    n: int | None = quantity("", "d", default=None)
    integrator: str | None = quantity("", "", "by", default=None)
    timestep: float | None = None
    tolerance: float | None = quantity("", ".0e", default=None)
    e_mean: float | None = quantity("mm", ".2g", "mean", default=None)
    e_max: float | None = quantity("mm", ".2g", "max", default=None)
    core_seconds: float | None = quantity("ms", ".2g", "core", default=None)
    compiled: float | None = quantity("s", ".0f", "compile", default=None)
    period: float | None = quantity("ms", ".3g", "step", default=None)
    steps_per_second: float | None = quantity("", ".3g", "steps a second", default=None)
    value: float | None = quantity("", ".2g", "times", default=None)
    text: str | None = None


@dataclass(frozen=True)
class Gradient(Record):
    """A gradient of a motion; fields of the same names as those of `Row`.

    Attributes:
        kind: "gradient".
        e_gradient: [1], relative to the converged one.
        core_seconds: Computing time [s] of one core for the gradient, motion included, over the
            simulated seconds.
        over_motion: Over that of the motion alone.
        times: Of a peer: computing time over that of the fastest of ours with no larger error.
    """

    kind: str
    package: str
    version: str
    model: str
    n: int = quantity("", "d")
    integrator: str = quantity("", "", "by")
    tolerance: float | None = quantity("", ".0e")
    e_gradient: float = quantity("%", ".2g", "error")
    core_seconds: float = quantity("ms", ".2g", "core")
    compiled: float = quantity("s", ".0f", "compile")
    over_motion: float = quantity("", ".2g", "over the motion")
    times: float | None = quantity("", ".2g", "over ours", default=None)


# -------------------- the arm's tension step
#
# The robot is the arm, made solid (SoRoMoX has no hollow sections) and hung up under gravity. Only
# bending strains are active there (`PlanarPCS`, the planar of its models), so all of the models
# converge to the same rod that does not shear or stretch: the limit of our PCC model with the
# inertia of its sections. SoRoMoX damps by the modulus eta: eta times three times the area moment
# per curvature rate. Each is integrated by the methods that its package offers; SoRoMoX also by the
# implicit ones of diffrax, which are far faster here than Tsit5, its default in rollouts.

#: Gravity acts towards the tip.
ROBOT = replace(ARM, inner_radius=0.0, gravity=(0.0, 0.0, 9.81))

_TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)


def truth(quick: bool) -> Limit:
    """The motion with infinitely many pieces."""
    return beam_limit(case.beam_motion, DISTRIBUTED, (3, 6, 12) if quick else (6, 12, 24), ROBOT)


def our_rows(limit: Limit, quick: bool) -> Iterator[Row]:
    """The MuJoCo chain and the PCC model."""
    for n in (6, 12) if quick else (6, 12, 24, 48):
        for timestep in (1e-3, 2e-3, 5e-3, 1e-2):
            for integrator in ("implicitfast", "discrete"):
                yield _our_row(limit, case.chain_motion("gauss2", n, timestep, integrator, ROBOT))
    for n in (3, 6) if quick else (3, 6, 12):
        for tolerance in _TOLERANCES:
            motion = replace(case.beam_motion(DISTRIBUTED, n, ROBOT), tolerance=tolerance)
            yield _our_row(limit, motion)


def _our_row(limit: Limit, motion: TimedMotion) -> Row:
    motion()  # compiles
    seconds, tips = best_of(motion, 5, process_time)
    own = motion.settings
    timestep = None if own.tolerance else own.timestep
    steps = {"integrator": own.integrator, "timestep": timestep, "tolerance": own.tolerance}
    return _motion_row(OURS, limit, tips, seconds, model=own.model, n=own.n, **steps)


def _motion_row(package: str, limit: Limit, tips: ndarray, seconds: float, **about: Any) -> Row:
    error = np.linalg.norm(tips - limit.tips, axis=1)
    found = {"e_mean": float(error.mean()), "e_max": float(error.max()), "text": limit.text}
    cost = {"core_seconds": seconds / DURATION}
    return Row("motion", package, version(package), **about, **found, **cost)


def peer_rows(limit: Limit, quick: bool) -> Iterator[Row]:
    """SoRoMoX by number of segments, integrator and tolerance."""
    for n in (3,) if quick else (3, 6, 12):
        for integrator in ("Kvaerno5",) if quick or n > 6 else ("Kvaerno5", "Kvaerno3", "Tsit5"):
            simulate, compiled = _motion(n, integrator), None
            for tolerance in _TOLERANCES[:2] if integrator == "Tsit5" else _TOLERANCES:
                run = partial(simulate, tolerance)
                first, _ = best_of(run, 1, process_time)
                seconds, tips = best_of(run, 3, process_time)
                compiled = first - seconds if compiled is None else compiled
                about = {"model": "PlanarPCS", "n": n, "integrator": integrator}
                about |= {"tolerance": tolerance, "compiled": compiled}
                yield _motion_row(PEER, limit, tips, seconds, **about)


def _motion(n: int, integrator: str) -> Callable[[float], ndarray]:
    """A function that simulates the motion by a tolerance, with tips (300, 2) in (x, z) [m]."""
    import jax

    run = jax.jit(partial(_traced(n, integrator), case.tensions(ROBOT, case.END)))
    return lambda tolerance: np.asarray(run(tolerance))


def _traced(n: int, integrator: str) -> Callable[[Any, float], Any]:
    """A function of JAX from tensions (6,) [N] and a tolerance to tips (300, 2) in (x, z) [m]."""
    import diffrax
    import jax
    from soromox.actuation import ThreadlikeActuator, ThreadlikeRouting
    from soromox.systems import LinkSpec, PlanarPCS, PlanarPCSStructure, SystemState

    jax.config.update("jax_enable_x64", True)
    jnp = jax.numpy
    link = LinkSpec.circular(
        length=ROBOT.length / n,
        radius=ROBOT.outer_radius,
        density=ROBOT.density,
        reference_strain=[0, 1, 0],
        young_modulus=ROBOT.youngs_modulus,
        poisson_ratio=0.0,
        material_damping_coefficient=ROBOT.damping_time * ROBOT.youngs_modulus / 3,
    )
    routing = ThreadlikeRouting.linear(
        intercept=jnp.array([[0, -tendon.offset[0], 0] for tendon in ROBOT.tendons]),
        end_segment_index=tuple(round(t.end / ROBOT.length * n) - 1 for t in ROBOT.tendons),
    )
    robot = PlanarPCS.from_links(
        [link] * n,
        structure=PlanarPCSStructure(strain_selector=jnp.array([True, False, False] * n)),
        gravity=jnp.array([0.0, ROBOT.gravity[2]]),
        base_pose=jnp.array([np.pi / 2, 0, 0]),
        actuators=ThreadlikeActuator.tendons(routing),
        backend="jax",
    )
    before = jnp.array(case.tensions(ROBOT, case.START))
    rate = jax.jit(lambda y, u: robot.forward_dynamics(0.0, y, (u, jnp.zeros(n))))
    q = np.zeros(n)
    for share in (0.25, 0.5, 0.75, 1.0):  # of the tensions
        force = partial(rate, u=share * before)
        q = root(lambda q, f=force: np.asarray(f(jnp.array([*q, *(0 * q)]))[n:]), q, tol=1e-10).x
    start = jnp.array([*q, *(0 * q)])
    times = case.PERIOD * jnp.arange(1, round(DURATION / case.PERIOD) + 1)

    def run(tensions: Any, tolerance: float) -> Any:
        motion = robot.rollout_to(
            SystemState(t=0.0, y=start),
            u=jnp.asarray(tensions),
            t1=DURATION,
            solver_dt=1e-4,
            save_ts=times,
            solver=getattr(diffrax, integrator)(),
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
            max_steps=1_000_000,
        )
        return jax.vmap(lambda y: robot.forward_kinematics(y[:n], ROBOT.length)[1:])(motion.y)

    return run


# -------------------- gradients of the same motion
#
# Of the mean squared distance of the tip from where it comes to rest, by the tensions of the three
# tendons that pull. Each gradient is that of the steps taken, so errors are those of the models, as
# differences of the converged motion show them.

#: [N], half of the difference.
_APART = 0.25


def true_gradient(limit: Limit, quick: bool) -> ndarray:
    """Gradient (3,) [m2/N] of the motion with infinitely many pieces."""
    sizes, pulled = (3, 6, 12) if quick else (6, 12, 24), case.tensions(ROBOT, case.END)

    def loss(change: ndarray) -> float:
        def make(*about: Any) -> TimedMotion:
            return replace(case.beam_motion(*about), inputs=pulled + change)

        return _loss(beam_limit(make, DISTRIBUTED, sizes, ROBOT).tips, limit)

    ways = _APART * np.eye(len(pulled))[pulled > 0]
    return np.array([(loss(way) - loss(-way)) / (2 * _APART) for way in ways])


def _loss(tips: Any, limit: Limit) -> Any:
    return ((tips - limit.tips[-1]) ** 2).sum(axis=1).mean()


def our_gradients(limit: Limit, true: ndarray, quick: bool) -> Iterator[Gradient]:
    """Of the MuJoCo chain, by the adjoint of its steps."""
    for n in (6, 12) if quick else (6, 12, 24, 48):
        scene = build_scene(SceneConfig(ROBOT, pieces=n, control_period=case.PERIOD))
        rollout, pulled = Rollout(scene), case.tensions(ROBOT, case.END)
        q = scene.equilibrium(case.tensions(ROBOT, case.START))
        inputs = np.tile(pulled, (round(DURATION / case.PERIOD), 1))
        run = partial(rollout.run, inputs, State(q, np.zeros_like(q)))
        about = {"model": "mujoco_chain", "n": n, "integrator": scene.timestep.integrator}
        about |= {"tolerance": None}
        found = partial(_our_gradient, run, limit)
        yield _gradient_row(OURS, true, run, found, **about)


def _our_gradient(run: Callable[[], Motion], limit: Limit) -> ndarray:
    motion = run()
    weights, tips = np.zeros_like(motion.observed.tip), motion.observed.tip[1:, [0, 2]]
    weights[1:, [0, 2]] = 2 * (tips - limit.tips[-1]) / len(tips)
    return motion.vjp(tip=weights).inputs.sum(axis=0)


def peer_gradients(limit: Limit, true: ndarray, quick: bool) -> Iterator[Gradient]:
    """Of SoRoMoX, by reverse differentiation."""
    import jax

    pulled = case.tensions(ROBOT, case.END)
    for n in (3,) if quick else (3, 6, 12):
        traced = _traced(n, "Kvaerno5")
        run = jax.jit(traced)
        slope = jax.jit(jax.grad(lambda u, tol, traced=traced: _loss(traced(u, tol), limit)))
        for tolerance in (1e-2,) if quick else (1e-2, 1e-3):
            about = {"model": "PlanarPCS", "n": n, "integrator": "Kvaerno5", "tolerance": tolerance}
            motion, found = (
                lambda f=f, tol=tolerance: np.asarray(f(pulled, tol)) for f in (run, slope)
            )
            yield _gradient_row(PEER, true, motion, found, **about)


def _gradient_row(
    package: str,
    true: ndarray,
    motion: Callable[[], Any],
    gradient: Callable[[], ndarray],
    **about: Any,
) -> Gradient:
    motion()
    first, _ = best_of(gradient, 1, process_time)
    alone, _ = best_of(motion, 3, process_time)
    seconds, found = best_of(gradient, 3, process_time)
    found = found[case.tensions(ROBOT, case.END) > 0]
    about |= {"e_gradient": float(np.linalg.norm(found - true) / np.linalg.norm(true))}
    about |= {"core_seconds": seconds / DURATION, "compiled": first - seconds}
    return Gradient("gradient", package, version(package), over_motion=seconds / alone, **about)


def compared(rows: list[Gradient]) -> list[Gradient]:
    """Gradients, those of a peer with their times over ours."""
    ours = [row for row in rows if row.package == OURS]

    def times(row: Gradient) -> float | None:
        alike = [own.core_seconds for own in ours if own.e_gradient <= row.e_gradient]
        return row.core_seconds / min(alike) if alike else None

    return [row if row in ours else replace(row, times=times(row)) for row in rows]


# -------------------- steps of an arm with twelve tendons
#
# Ours has the length, radii (with a linear taper), material and tendons' ends of gym-softrobot's,
# and two hinge stations less than it has elements. gym-softrobot damps velocities, ours strain
# rates, and its rod shears and stretches, so the two are alike in size, not the same; errors are
# known of ours alone.

PEER_ENV = "TendonArmReach-v0"

#: [s] of a step of theirs: 1111 timesteps of 30 µs.
PERIOD = 0.03333

#: Largest action of both, as a share: theirs ends an episode early if it pulls harder.
_SHARE, _STEPS = 0.2, 20


def robot() -> RobotParams:
    """Our arm of the same size."""
    half = {"length": 0.15, "youngs_modulus": 3e6, "density": 1000.0, "poisson_ratio": 0.5}
    half |= {"damping_time": 0.03, "pieces": 6}
    tendons = (
        Tendon(f"{name}{i}", (0.01 * cos(i * pi / 3), 0.01 * sin(i * pi / 3)), end, group, 55.2)
        for group, (name, end) in enumerate((("long", 0.30), ("short", 0.15)))
        for i in range(6)
    )
    radii = (0.023, 0.0167), (0.0167, 0.0104)
    sections = tuple(Section(outer_radius=pair, **half) for pair in radii)
    return RobotParams("spirob", tendons=tuple(tendons), sections=sections)


def our_row(quick: bool) -> Row:
    """A row of ours, with the error that the environment reports."""
    env = TrackingEnv("reach", robot=robot(), control_period=PERIOD)
    seconds = _step_time(env, -_SHARE, quick)
    *_, info = env.step(np.zeros(env.action_space.shape, np.float32))
    size, error = env.simulation.scene.model.nv, float(info["integration_error"])
    return _steps_row(OURS, "TrackingEnv, reach", size, seconds, period=PERIOD, e_max=error)


def peer_row(quick: bool) -> Row:
    """A row of gym-softrobot's."""
    import gym_softrobot  # noqa: F401 (registers its environments)

    env = gymnasium.make(PEER_ENV, disable_env_checker=True)
    seconds = _step_time(env, 0.0, quick)
    rod, package = env.unwrapped, PEER_OF_STEPS
    period = rod.time_step * rod.simulation_steps_per_action
    steps = {"timestep": rod.time_step, "period": period}
    return _steps_row(package, PEER_ENV, 6 * rod.n_elements, seconds, **steps)


def _steps_row(package: str, model: str, n: int, seconds: float, **others: Any) -> Row:
    cost = {"core_seconds": seconds / PERIOD, "steps_per_second": 1 / seconds}
    return Row("environment", package, version(package), model, n, **others, **cost)


def _step_time(env: gymnasium.Env, least: float, quick: bool) -> float:
    """Computing time [s] of a step under random actions, the best of some blocks of steps."""
    rng = np.random.default_rng(0)

    def block() -> None:
        env.reset(seed=0)
        for _ in range(_STEPS):
            action = rng.uniform(least, _SHARE, env.action_space.shape).astype(np.float32)
            if any(env.step(action)[2:4]):
                env.reset(seed=0)

    block()  # compiles
    return best_of(block, 3 if quick else 10, process_time)[0] / _STEPS


# -------------------- the study


def stages(lab: Lab) -> list[Row | Gradient]:
    """Measure ours, and those of the peers that are installed; then ratios."""
    # Before JAX is loaded; what the user has set already goes first.
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
    limit, quick = truth(lab.quick), lab.quick
    known = {name: find_spec(module) is not None for name, module in PEERS.items()}
    tasks = [("our motions", lambda: list(our_rows(limit, quick)))]
    if known[PEER]:
        tasks.append((PEER, lambda: list(peer_rows(limit, quick))))
    true = true_gradient(limit, quick)
    slopes = [("our gradients", lambda: list(our_gradients(limit, true, quick)))]
    if known[PEER]:
        slopes.append((f"{PEER}, gradients", lambda: list(peer_gradients(limit, true, quick))))
    tasks.append(("our environment", lambda: [our_row(quick)]))
    if known[PEER_OF_STEPS]:
        tasks.append((PEER_OF_STEPS, lambda: [peer_row(quick)]))
    rows, gradients = ([row for found in lab.tasks(x) for row in found] for x in (tasks, slopes))
    text = "{0} is not installed: its rows are left out (pip install {0})"
    notes = [Row("note", peer, text=text.format(peer)) for peer in PEERS if not known[peer]]
    return [*with_ratios(rows), *compared(gradients), *notes]


def with_ratios(rows: list[Row]) -> list[Row]:
    """Rows and, behind those of a peer, its ratios to ours."""
    motions, steps = (select(rows, kind=kind) for kind in ("motion", "environment"))
    return [*motions, *ratios(motions), *steps, *steps_ratio(steps)]


def ratios(motions: list[Row]) -> list[Row]:
    """For each run of SoRoMoX that no faster one of it beats, its time over that of ours."""
    ours, out = select(motions, package=OURS), []
    for row in front(select(motions, package=PEER), cost="core_seconds"):
        for family in ("mujoco_chain", "pcc"):
            alike = [r for r in ours if r.model.startswith(family) and r.e_mean <= row.e_mean]
            if alike:
                value = row.core_seconds / min(r.core_seconds for r in alike)
                known = {"e_mean": row.e_mean, "tolerance": row.tolerance, "value": value}
                about = "ratio", row.package, row.version, family, row.n
                out.append(Row(*about, f"{row.model}, {row.integrator}", **known))
    return out


def steps_ratio(rows: list[Row]) -> list[Row]:
    """Computing time of a step of gym-softrobot's over ours."""
    if len(rows) < 2:
        return []
    ours, theirs = rows
    value = theirs.core_seconds / ours.core_seconds
    return [Row("ratio", theirs.package, theirs.version, theirs.model, theirs.n, value=value)]


def _best(rows: list[Row]) -> list[Table]:
    """Motions that no faster one of the same model beats."""
    found = groups(select(rows, kind="motion"), "package", "model").values()
    title = "Tension step of the arm, 3 s: runs that none of the model beats"
    shown = "model", "n", "integrator", Column("step", setting, ">"), "e_mean", "e_max"
    make = table(title, *shown, "core_seconds", "compiled")
    return make([r for m in found for r in front(m, cost="core_seconds")])


def _notes(rows: list[Row]) -> list[Text]:
    versions = {f"{row.package} {row.version}" for row in rows if row.version}
    lines = {f"Error: to the {row.text}" for row in select(rows, kind="motion")}
    lines |= {row.text for row in select(rows, kind="note")}
    first = "n: degrees of freedom; core ms: computing time of one core for a simulated second"
    return [*map(Text, [first, *sorted(lines), ", ".join(sorted(versions))])]


STUDY = Study(
    kinds=(Row, Gradient),
    stages=stages,
    tables=[
        _best,
        table(
            "Gradient of a loss of the same motion by tensions",
            *("model", "n", "integrator", "tolerance", "e_gradient", "core_seconds"),
            *("over_motion", "times", "compiled"),
            of=Gradient,
        ),
        table(
            "Steps of an arm in space",
            *(Column("environment", "model"), "n", "period", "steps_per_second", "core_seconds"),
            Column("reported error mm", "e_max", ".1g", "mm"),
            where={"kind": "environment"},
        ),
        table(
            "Computing time of a peer over that of ours at no larger mean error",
            Column("peer", lambda row: row.integrator or row.model),
            *("n", "tolerance", "e_mean"),
            Column("ours", lambda row: row.model if row.integrator else ""),
            "value",
            where={"kind": "ratio"},
        ),
        _notes,
    ],
    alone=True,
)
