"""Derivatives of motions against differences of runs, what they cost, and paths found by them.

Random robots of all kinds move in steps whose lengths do not depend on what happens, so that runs
with other numbers are alike but for them; differences of such runs are extrapolated.
"""

import tracemalloc
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter, process_time
from typing import Any

import gymnasium
import numpy as np
from numpy import ndarray

from softrobot_env.core.motion import State
from softrobot_env.core.processes import usable_cores
from softrobot_env.envs.simulation.batch import Batch
from softrobot_env.evaluation.models.runs import best_of
from softrobot_env.gradients import Motion, Rollout, on_threads
from softrobot_env.gradients.parameters import parameter
from softrobot_env.gradients.tracking import follow
from softrobot_env.robots import find_robot
from softrobot_env.scene.build import Scene, build_scene
from softrobot_env.scene.registry import scene_of
from softrobot_env.scene.simulation import Simulation
from softrobot_env.scene.timestep import TimestepWarning
from studies import lab
from studies.truths.moving_robots import FRICTION, Moving, moving, touching

#: Random robots, and robots whose derivatives are timed.
SCENES, TIMED = 200, ("arm", "planar_finger", "silicone_rod", "hanging_trunk", "ftdcr_v4")

#: Coefficient of friction [1] along tendons of those that are timed once more.
ROUGH = {"arm": 0.15, "hanging_trunk": 0.15}

#: Paths that are found from zero inputs.
PATHS = ("SoftRobot/ArmLShape-v0", "SoftRobot/ArmSwing-v0")

#: What must hold: relative errors, adjoint against tangent, cost ratio, memory [byte], error [m].
GOALS = {"relative_error": 1e-6, "mismatch": 1e-10, "cost_ratio": 6.0, "memory": 64e6, "path": 1e-3}

#: Those of them, without friction along tendons, that touch a ball.
TOUCHING = [k for k in range(25) if FRICTION[k % len(FRICTION)] != "along"]

#: Steps as long as asked for whatever their errors.
_ALIKE = {"accuracy": 1e4, "timestep": 2e-3}

#: Extrapolated differences are a truth where they agree to this share with those before.
_AGREES = 1e-7

_STEP, _PARAMETERS, _MANY = 1e-3, 30, 256

#: Steps of differences, shorter where many zones, or contacts, may change their law.
_FINE, _FINEST = 1e-5, 1e-6

#: Each scene has one of so many parts of its parameters.
_THIRDS = 3


@dataclass(frozen=True)
class SceneRow(lab.Record):
    """A random robot in random motion.

    Attributes:
        scene: Seed.
        bending, actuation: Of its scene.
        friction: Of its tendons, see `moving_robots.FRICTION`, or the coefficient of a ball's that
            it touches.
        kinds: Derivatives that differences are a truth for: by the start, inputs and parameters.
        kinks: Those for which they are none: a drive or friction changes its law within the
            differences.
        relative_error: Largest of the others, over the largest derivative by a change of its scale.
        mismatch: Largest difference of adjoint and tangent, likewise.
        switches: Intervals in which a drive or friction changed its law.
        strays: Those in which another solution was found than that of the simulation.
    """

    scene: int = lab.quantity("", "d")
    bending: str
    actuation: str
    friction: str
    kinds: int = lab.quantity("", "d")
    kinks: int = lab.quantity("", "d")
    relative_error: float = lab.quantity("", ".1e", "error")
    mismatch: float = lab.quantity("", ".1e", "adjoint - tangent")
    switches: int = lab.quantity("", "d")
    strays: int = lab.quantity("", "d")


@dataclass(frozen=True)
class CostRow(lab.Record):
    """Derivatives of a number by all inputs of 3 s and 30 parameters.

    Attributes:
        robot: Name.
        friction: Coefficient along its tendons.
        dofs: Of its chain.
        forward, gradient: [s] of CPU, of the motion, and of it and its derivatives.
        cost_ratio: Their ratio.
        memory: [byte], most in use by NumPy.
    """

    robot: str
    friction: float = lab.quantity("", "g")
    dofs: int = lab.quantity("", "d")
    forward: float = lab.quantity("ms", ".3g")
    gradient: float = lab.quantity("ms", ".3g")
    cost_ratio: float = lab.quantity("", ".2f", "ratio")
    memory: float = lab.quantity("", ".2g", "bytes")


@dataclass(frozen=True)
class PathRow(lab.Record):
    """Inputs along a path, found from zero.

    Attributes:
        task: Environment.
        largest, mean: [m], distances of the tip from the reference.
        time: [s] of CPU.
        steps: Of the search.
    """

    task: str
    largest: float = lab.quantity("mm", ".2f")
    mean: float = lab.quantity("mm", ".1e")
    time: float = lab.quantity("s", ".0f")
    steps: int = lab.quantity("", "d")


@dataclass(frozen=True)
class ThreadRow(lab.Record):
    """Motions of a second and their derivatives by all inputs, of many robots on threads.

    Attributes:
        robot: Name.
        robots, threads: Numbers.
        speedup, forward: Times as fast as on one thread; `forward` is of motions alone, by the
            batch that vectorised environments have.
        share: Of the one in the other.
    """

    robot: str
    robots: int = lab.quantity("", "d")
    threads: int = lab.quantity("", "d")
    speedup: float = lab.quantity("", ".2f")
    forward: float = lab.quantity("", ".2f")
    share: float = lab.quantity("", ".2f")


def difference(function: Callable[[float], float], step: float) -> tuple[float, float]:
    """Richardson's extrapolated central difference at 0, and how far the one before is."""
    entries: list[float] = []
    for k in range(3):
        h = step / 2**k
        entry = (function(h) - function(-h)) / (2 * h)
        for j, before in enumerate(entries):
            entries[j], entry = entry, entry + (entry - before) / (4 ** (j + 1) - 1)
        entries.append(entry)
    return entry, abs(entries[-1] - entries[-2])


def _scene(seed: int) -> SceneRow:
    warnings.simplefilter("ignore", TimestepWarning)
    robot, friction = moving(seed, **_ALIKE), FRICTION[seed % len(FRICTION)]
    return _compared(seed, robot, friction, _FINE if friction == "along" else _STEP)


def _touching(seed: int) -> SceneRow:
    warnings.simplefilter("ignore", TimestepWarning)
    robot = touching(seed)
    return _compared(seed, robot, f"touches, {robot.scene.config.contacts.friction:g}", _FINEST)


def _exact(scene: Scene) -> Scene:
    """With constraints that are solved to all digits, as differences of runs need it."""
    scene.model.opt.tolerance, scene.model.opt.iterations = 1e-15, 200
    return scene


def _compared(seed: int, robot: Moving, friction: str, step: float) -> SceneRow:
    """Derivatives of a motion and differences of others."""
    rollout, start = (
        Rollout(_exact(robot.scene), robot.parameters),
        State(robot.position, robot.velocity),
    )
    rng = np.random.default_rng(seed)
    motion, config = rollout.run(robot.inputs, start), robot.scene.config
    weights = {k: rng.normal(size=x.shape) for k, x in motion.observed._asdict().items()}

    def weighed(observed: Any) -> float:
        return sum(float((weights[k] * x).sum()) for k, x in observed._asdict().items())

    found, (way, push) = motion.vjp(**weights), rng.normal(size=(2, len(start.q)))
    change = rng.normal(size=robot.inputs.shape) * np.abs(robot.inputs).max(axis=0) * 0.1
    ways: dict[str, tuple[float, float, Callable[[float], Motion]]] = {
        "start": (
            found.position @ way + found.velocity @ push,
            weighed(motion.jvp(start=State(way, push))),
            lambda e: rollout.run(robot.inputs, State(start.q + e * way, start.v + e * push)),
        ),
        "inputs": (
            float((found.inputs * change).sum()),
            weighed(motion.jvp(inputs=change)),
            lambda e: rollout.run(robot.inputs + e * change, start),
        ),
    }
    for name in robot.parameters[seed // 6 % _THIRDS :: _THIRDS]:
        one = parameter(config.robot, name)

        def varied(e: float, one: Any = one) -> Motion:
            other = one.apply(config.robot, one.value + e * one.scale)
            scene = _exact(build_scene(replace(config, robot=other)))
            return Rollout(scene).run(robot.inputs, start)

        tangent = weighed(motion.jvp(parameters={name: one.scale}))
        ways[name] = one.scale * found.parameters[name], tangent, varied
    largest = max(abs(adjoint) for adjoint, _, _ in ways.values())
    errors = []
    for adjoint, _, run in ways.values():
        truth, doubt = difference(lambda e, run=run: weighed(run(e).observed), step)
        if doubt < _AGREES * largest:
            errors.append(abs(adjoint - truth) / largest)
    return SceneRow(
        scene=seed,
        bending="twisting" if config.torsion else config.bending,
        actuation=config.actuation,
        friction=friction,
        kinds=len(errors),
        kinks=len(ways) - len(errors),
        relative_error=max(errors, default=np.nan),
        mismatch=max(abs(adjoint - tangent) for adjoint, tangent, _ in ways.values()) / largest,
        switches=found.switches,
        strays=found.strays,
    )


def _cost(case: tuple[str, float]) -> CostRow:
    (name, friction), changed = case, {}
    warnings.simplefilter("ignore", TimestepWarning)
    if friction:
        changed = {"friction_coefficient": friction}
    scene = build_scene(scene_of(find_robot(name).vary(**changed)))
    robot, (low, high) = scene.config.robot, scene.model.actuator_ctrlrange.T
    names = ["youngs_modulus", "density", "damping_time", "tendon_radius", "precurvature.0"]
    wanted = (names * _PARAMETERS)[:_PARAMETERS]
    periods = round(3 / scene.config.control_period)
    held = np.random.default_rng(0).uniform(low, high, (periods // 10, len(low))) * 0.2
    inputs = np.clip(np.repeat(held, 10, axis=0), low, high)
    simulation = Simulation(scene)

    def forward() -> None:
        simulation.reset(scene.model.qpos0, inputs[0])
        for row in inputs:
            simulation.ctrl[:] = row
            simulation.advance()

    def gradient(rollout: Rollout) -> Any:
        motion = rollout.run(inputs)
        return motion.vjp(tip=2 * motion.observed.tip)

    rollout = Rollout(scene, names)
    rollout.parameters, rollout.by_parameters = _repeated(rollout, wanted)
    gradient(rollout)
    times = [best_of(f, 5, process_time)[0] for f in (forward, lambda: gradient(rollout))]
    tracemalloc.start()
    gradient(Rollout(scene))
    memory = float(tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
    ratio = times[1] / times[0]
    return CostRow(robot.name, friction, scene.model.nv, *times, ratio, memory)


def _repeated(rollout: Rollout, wanted: list[str]) -> tuple[tuple[str, ...], ndarray]:
    """As many parameters as wanted, of few that were prepared."""
    rows = [rollout.parameters.index(name) for name in wanted]
    return tuple(f"{name}, {k}" for k, name in enumerate(wanted)), rollout.by_parameters[rows]


def _path(task: str) -> PathRow:
    warnings.simplefilter("ignore", TimestepWarning)
    env = gymnasium.make(task)
    rollout = Rollout.of(env)
    rollout.run(np.zeros((2, rollout.n_inputs))).linearised()  # compiled before
    begin = process_time()
    found = follow(rollout)
    taken = process_time() - begin
    return PathRow(task, float(found.error.max()), float(found.error.mean()), taken, found.steps)


def _threads(count: int) -> ThreadRow:
    warnings.simplefilter("ignore", TimestepWarning)
    scene, threads = build_scene(scene_of(find_robot(TIMED[0]))), usable_cores()
    limits, periods = scene.model.actuator_ctrlrange[:, 1], round(1 / scene.config.control_period)
    inputs = np.random.default_rng(0).uniform(0.0, 0.1, (count, len(limits))) * limits
    rollout, held = Rollout(scene), np.repeat(inputs[:, None], periods, axis=1)
    weights = np.ones((periods + 1, 3))

    def gradients(number: int) -> None:
        on_threads(lambda own, x: own.run(x).vjp(tip=weights).inputs, rollout, held, number)

    def forward(number: int) -> None:
        batch = Batch(scene, count, number)
        batch.ctrl[:] = inputs
        for _ in range(periods):
            batch.advance()

    gradients(1)  # compiles
    speedups = []
    for work in (gradients, forward):
        alone, together = (best_of(partial(work, k), 3, perf_counter)[0] for k in (1, threads))
        speedups.append(alone / together)
    return ThreadRow(scene.config.robot.name, count, threads, *speedups, speedups[0] / speedups[1])


_MEASURES = {
    "scene": _scene,
    "touching": _touching,
    "cost": _cost,
    "path": _path,
    "threads": _threads,
}


def measure(case: tuple[str, Any]) -> Any:
    """A row of a case, by its kind."""
    kind, what = case
    return _MEASURES[kind](what)


def cases(quick: bool = False) -> list[tuple[str, Any]]:
    """Kinds and what they measure."""
    scenes, timed = range(3 if quick else SCENES), TIMED[: 2 if quick else None]
    paths = () if quick else PATHS
    return [
        *(("cost", (x, 0.0)) for x in timed),
        *(("cost", x) for x in (() if quick else ROUGH.items())),
        ("threads", 8 if quick else _MANY),
        *(("scene", k) for k in scenes),
        *(("touching", k) for k in TOUCHING[: 1 if quick else None]),
        *(("path", x) for x in paths),
    ]


def _verdict(rows: list[Any]) -> lab.Text:
    scenes = [row for row in rows if isinstance(row, SceneRow)]
    text = lab.Text("")
    if not scenes:
        return text
    known = sum(row.kinds for row in scenes)
    for name in ("relative_error", "mismatch"):
        values = [getattr(row, name) for row in scenes]
        values = [value for value in values if np.isfinite(value)]
        text += lab.Text(f"{name}: largest {max(values):.1e} (asked: {GOALS[name]:g}) ")
        text += lab.verdict(max(values) <= GOALS[name]) + lab.Text("; ")
    kinks = sum(row.kinks for row in scenes)
    return text + lab.Text(f"{known} derivatives of {len(scenes)} scenes, {kinks} more at kinks")


STUDY = lab.Study(
    kinds=(SceneRow, CostRow, PathRow, ThreadRow),
    cases=cases,
    measure=measure,
    tables=[
        lab.table(
            "Random robots: derivatives against differences of runs",
            *("scene", "bending", "actuation", "friction", "kinds", "kinks", "relative_error"),
            *("mismatch", "switches", "strays"),
            of=SceneRow,
        ),
        _verdict,
        lab.table(
            "Cost of derivatives by all inputs of 3 s and 30 parameters",
            *("robot", "friction", "dofs", "forward", "gradient", "cost_ratio", "memory"),
            of=CostRow,
        ),
        lab.table(
            "Many robots on threads: times as fast as on one",
            *("robot", "robots", "threads", "speedup", "forward", "share"),
            of=ThreadRow,
        ),
        lab.table(
            "Inputs along paths, from zero",
            *("task", "largest", "mean", "time", "steps"),
            of=PathRow,
        ),
    ],
    note="kinks: a drive or friction changes its law within the differences, which are no truth "
    "there",
)
