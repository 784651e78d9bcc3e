"""The gripper: its grips, the size of what it encloses, holds under pulls, and what they cost."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import islice
from math import degrees, pi
from time import perf_counter, process_time
from typing import Any

import numpy as np
from numpy import ndarray

from softrobot_env.control import gripper
from softrobot_env.envs.gripper import VectorGripperEnv
from softrobot_env.envs.rendering import finger_shapes
from softrobot_env.robots import GRIPPERS
from softrobot_env.scene.assembly import AssembledScene, build_assembly, gripper_scene
from softrobot_env.scene.objects import Capsule, Ellipsoid, Object
from softrobot_env.scene.simulation import Simulation
from studies.lab import Column, Lab, Record, Study, quantity, table

GRIPPER = GRIPPERS["gripper"]


@dataclass(frozen=True)
class Grip(Record):
    """A clamped object under a tension that rises slowly.

    Attributes:
        thing: What is gripped.
        tension: [N].
        kind: "open", "enclosing" or "fingertip".
        angles: (sensors,) [deg], bends of the middle finger's sensors.
        touching: Share [1] of the links of the middle finger that press on it.
        tip_share: Share [1] in the last tenth of that finger of the forces beyond its first 40 %.
        turn: [deg], of a sensor that lies on a cylinder altogether; None of others.
    """

    thing: str
    tension: float = quantity("N", ".0f")
    kind: str = quantity(form="", label="grip")
    angles: tuple[float, ...]
    touching: float = quantity("%", ".0f")
    tip_share: float = quantity("%", ".0f", "tip")
    turn: float | None = quantity("deg", ".1f")

    sensor_1 = property(lambda self: self.angles[0])
    sensor_2 = property(lambda self: self.angles[1])
    sensor_3 = property(lambda self: self.angles[2])


@dataclass(frozen=True)
class Size(Record):
    """Errors of estimated diameters of bars that were not used to fit, from one enclosing grip.

    Attributes:
        method: How they are estimated.
        task: "enclose" of clamped bars, "hold" of free ones.
        pieces: Of the fingers that grip.
        fitted: Pieces of the fingers of the examples; None where nothing is fitted.
        errors: Imperfections of the fingers' sensors, over the usual ones; None of exact bends.
        count: Number of bars.
        mean, high, most: [m], mean, 95th percentile and largest size of the errors.
    """

    method: str = quantity(form="")
    task: str = quantity(form="")
    pieces: int = quantity("", "d")
    fitted: int | None = quantity("", "d", "fitted with")
    errors: float | None = quantity("", "g", "sensors")
    count: int = quantity("", "d", "bars")
    mean: float = quantity("mm", ".2f")
    high: float = quantity("mm", ".2f", "95 %")
    most: float = quantity("mm", ".2f")


@dataclass(frozen=True)
class Shape(Record):
    """How far calibrated sensors err in the same grips, and the shape of three arcs by them.

    Attributes:
        task, pieces, errors: As of `Size`.
        count: Number of fingers.
        bend, high_bend, most_bend: [deg], mean, 95th percentile and largest error of a sensor.
        tip, high_tip, most_tip: [m], the same of the tip.
    """

    task: str = quantity(form="")
    pieces: int = quantity("", "d")
    errors: float | None = quantity("", "g", "sensors")
    count: int = quantity("", "d", "fingers")
    bend: float = quantity("deg", ".2f")
    high_bend: float = quantity("", ".2f", "95 %")
    most_bend: float = quantity("", ".2f", "most")
    tip: float = quantity("mm", ".2f")
    high_tip: float = quantity("mm", ".2f", "95 %")
    most_tip: float = quantity("mm", ".2f", "most")


@dataclass(frozen=True)
class Outcome(Record):
    """Episodes of a task with random bars and fingers, and pulls and shaking where bars are held.

    Attributes:
        task, policy: Names.
        pieces: Of each finger.
        timestep: [s].
        count: Number of episodes.
        success: Share [1] that succeeded.
        lost: Share [1] in which the bar was lost.
        error: Median, over what counts as success [1]: of holds the largest of each episode, of
            enclosing grips the last.
        tension: [N], mean at the end.
        ms_per_step: Of one gripper.
    """

    task: str = quantity(form="")
    policy: str = quantity(form="")
    pieces: int = quantity("", "d")
    timestep: float = quantity("ms", ".3g", "dt")
    count: int = quantity("", "d", "bars")
    success: float = quantity("%", ".1f")
    lost: float = quantity("%", ".1f")
    error: float = quantity("", ".2f")
    tension: float = quantity("N", ".1f")
    ms_per_step: float = quantity("", ".2f", "ms/step")


@dataclass(frozen=True)
class Speed(Record):
    """What a step costs with some pieces and timestep, and how far it is off.

    Attributes:
        task: Name of the task.
        pieces: Of each finger.
        timestep: [s].
        fineness: Name of the setting.
        count: Grippers at once.
        threads: That share the work.
        steps_per_s: Of all together.
        mean_error, bend_error: [deg], mean and largest difference of a sensor's angle from that
            by the rule, during closings on some bars; None of many at once.
    """

    task: str = quantity(form="")
    pieces: int = quantity("", "d")
    timestep: float = quantity("ms", ".3g", "dt")
    fineness: str = quantity(form="")
    count: int = quantity("", "d", "grippers")
    threads: int = quantity("", "d")
    steps_per_s: float = quantity("", ".0f", "steps/s")
    mean_error: float | None = quantity("deg", ".2f", "bend")
    bend_error: float | None = quantity("", ".2f", "most")


# -------------------- grips of clamped objects

#: Cylinders by their diameters [m], and the oval by its semi-axes [m] in the plane of the fingers.
CYLINDERS, OVAL = (0.094, 0.060, 0.048), (0.020, 0.013)

#: [m], semi-axis of the oval along the bar: so long that it hardly tapers between the fingers.
_LONG = 0.15

#: Tension [N] and the time [s] in which it rises; a link presses from some force [N] on.
_FULL, _RISE, _PRESSES = 38.0, 3.8, 1e-3


def things() -> dict[str, tuple[Object, float | None]]:
    """Name -> what is gripped, and the radius [m] of a finger that lies on it."""
    width = float(GRIPPER.fingers[0].robot.backbone.widest)
    out: dict[str, tuple[Object, float | None]] = {}
    for diameter in CYLINDERS:
        size = {"radius": diameter / 2, "length": 0.08, "turn": (-pi / 2, 0, 0)}
        thing = Capsule(name="bar", position=(0.0, 0.0, GRIPPER.seat(diameter / 2)), **size)
        out[f"{1e3 * diameter:g} mm"] = thing, diameter / 2 + width
    place = 0.0, 0.0, GRIPPER.seat(max(OVAL))
    out["oval"] = Ellipsoid(name="bar", semi_axes=(OVAL[0], _LONG, OVAL[1]), position=place), None
    return out


def grips(name: str, step: float = 2.0, pieces: int | None = None) -> list[Grip]:
    """Grips of a thing, one each `step` [N], under a tension that rises slowly."""
    thing, radius = things()[name]
    built = build_assembly(gripper_scene(GRIPPER, (thing,), pieces=pieces))
    simulation, rows = Simulation(built), []
    simulation.reset(built.model.qpos0, np.zeros(built.n_inputs))
    periods = round(_RISE / built.config.control_period)
    every = round(step / _FULL * periods)
    for k in range(1, periods + 1):
        simulation.ctrl[:] = _FULL * k / periods
        if not simulation.advance():
            raise RuntimeError(simulation.failure())
        if k % every == 0:
            rows.append(_grip(name, built, simulation, radius))
    return rows


def _grip(name: str, built: AssembledScene, simulation: Simulation, radius: float | None) -> Grip:
    part = built["middle"]
    robot = part.scene.config.robot
    bends = part.curvature(simulation.posture)[:, 1].reshape(robot.pieces, -1).mean(axis=1)
    pressing = [t for t in simulation.contacts() if t.first.startswith("middle/")]
    forces = np.array([np.linalg.norm(t.force) for t in pressing])
    stations = np.array([t.stations[0] for t in pressing], dtype=float) / robot.length
    outer, tip = stations > 0.4, stations > 0.9
    tip_share = float(forces[tip].sum() / max(forces[outer].sum(), _PRESSES))
    # Fingertip: of all that presses beyond the first sensor most is at the tip, which curls.
    kind = "fingertip" if tip_share > 0.5 and bends[-1] > bends[-2] else "enclosing"
    return Grip(
        thing=name,
        tension=float(simulation.ctrl[0]),
        kind=kind if outer.any() else "open",
        angles=tuple((np.degrees(bends) * robot.length / robot.pieces).tolist()),
        touching=float((forces > _PRESSES).sum() / len(part.scene.layout.stations)),
        tip_share=tip_share,
        turn=None if radius is None else degrees(robot.length / robot.pieces / radius),
    )


# -------------------- episodes

#: [N], tension at which sizes are read: most bars are then enclosed, and no tip has bent far.
READING = 16.0

#: Seeds of the examples that estimators are fitted to, of bars they are tested on, and of holds;
#: what is added to them for the noise while sensors are calibrated.
_FITTED, _TESTED, _HELD, _CALIBRATED = 10_000, 20_000, 30_000, 5_000_000

#: Grippers of which a policy learns, and control period [s].
_LEARNERS, PERIOD = 16, 0.02

#: Bars on which finenesses are compared, and tension [N] and time [s] of that.
_COMPARED, _SQUEEZE, _CLOSED = 8, 25.0, 1.0

#: How what learns sees grippers.
VIEW: dict[str, Any] = {
    "observe": ("curvature", "tendon_tension", "contact", "previous_action"),
    "observe_as": "vector",
}


def make(fineness: str, task: str, count: int, threads: int = 1, **options: Any) -> Any:
    """So many grippers, with other options of the environment."""
    return VectorGripperEnv(count, task, fineness=fineness, threads=threads, **options)


#: What grippers see, what is known of them, and which have failed or whose episodes are over.
Moment = tuple[Any, dict[str, Any], ndarray, ndarray]


def play(
    env: VectorGripperEnv, policy: Any, seed: int, options: dict[str, Any] | None = None
) -> Iterator[Moment]:
    """Moments of grippers under a policy, from a reset on and without end."""
    seen, info = env.reset(seed=seed, options=options)
    failed = over = np.zeros(env.num_envs, bool)
    state = None
    while True:
        yield seen, info, failed, over
        action, state = policy.predict(seen, state, deterministic=True)
        seen, _, failed, over, info = env.step(action)


def closing(tension: float) -> gripper.ScriptedGrip:
    """Closes grippers to a tension [N]."""
    return gripper.ScriptedGrip(GRIPPER, PERIOD, tension)


def _played(env: VectorGripperEnv, policy: Any, first: int) -> tuple[float, ...]:
    """Fields of an `Outcome` from its success on, of episodes of seeds from `first` on."""
    count, steps = env.num_envs, env.max_episode_steps
    lost, success = np.zeros(count, bool), np.zeros(count, bool)
    worst, tension = np.zeros(count), np.zeros(count)
    first_ones, moments = np.ones(count, bool), play(env, policy, first)
    next(moments)
    begin = process_time()
    for _, info, failed, over in islice(moments, steps):
        error = np.maximum(worst, info["error"]) if env.task.free else info["error"]
        worst = np.where(first_ones, error, worst)
        lost |= failed & first_ones
        success |= info["success"] & first_ones
        tension = np.where(first_ones, env.simulation.ctrl.mean(axis=1), tension)
        first_ones &= ~(failed | over)  # what follows are other episodes
    took = 1e3 * (process_time() - begin) / steps / count
    return *map(float, (success.mean(), lost.mean(), np.median(worst), tension.mean())), took


def read_bends(
    fineness: str, task: str, first: int, count: int, errors: float | None
) -> dict[str, ndarray]:
    """Closings on bars of seeds from `first` on, clamped or free as in a task.

    With sensors each gripper is calibrated first; their imperfections are `errors` times the usual.

    Returns:
        bends: (n, pieces) [1/m] by the sensors, or exact; exact: true means over the pieces; qpos:
        (n, nq), postures; diameters: (n,) [m].
    """
    observe = ("tendon_tension",) if errors is None else ("sensors",)
    env = make(fineness, task, count, observe=observe)
    own = {} if errors is None else {"sensor_errors": errors}
    known = None if errors is None else calibrated_to(env, fineness, first, own)
    moments = play(env, closing(READING), first, own)
    (begin, *_), *_, (seen, info, *_) = islice(moments, 1 + round(gripper.CALM / PERIOD))
    exact = bends = env.simulation.curvature
    if known is not None:
        bends = known.curvature(seen["sensors"], begin["sensors"])
    qpos = env.simulation.qpos.copy()
    return {"bends": bends, "exact": exact, "qpos": qpos, "diameters": info["diameter"]}


def calibrated_to(
    env: VectorGripperEnv, fineness: str, first: int, own: dict[str, Any]
) -> gripper.FingerCalibration:
    """Calibrate the grippers of environments, of seeds from `first` on, with other noise."""
    _, sampled = env.reset(seed=first, options=own)
    specimens = {name: sampled[name] for name in ("modulus", "arm", "sensor_errors", "specimen")}
    clamped = make(fineness, "enclose", env.num_envs, observe=("sensors",))
    return gripper.calibrated(clamped, specimens, _CALIBRATED + first)


def fitted_size(
    fineness: str, task: str, count: int, errors: float | None = None
) -> gripper.SizeEstimator:
    """An estimator that is fitted to as many bars."""
    read = read_bends(fineness, task, _FITTED, count, errors)
    return gripper.SizeEstimator.fitted(GRIPPER, READING, read["bends"], read["diameters"])


def sizes(
    fit: str, test: str, task: str, examples: int, count: int, scales: Sequence[float | None]
) -> list[Size | Shape]:
    """Errors of sizes of bars gripped in one fineness, by estimators fitted in another.

    Args:
        fit, test: The two.
        task: Whether bars are clamped or free.
        examples, count: Bars that are fitted to, and tested on.
        scales: Of the sensors' imperfections; None for exact bends.
    """
    (pieces, _), (fitted, _), rows = _built(test, task), _built(fit, task), []
    for errors in scales:
        read = read_bends(test, task, _TESTED, count, errors)
        found = fitted_size(fit, task, examples, errors)(read["bends"])
        ways = [("polynomial", fitted, found)]
        if errors is None:
            ways.insert(0, ("second sensor", None, gripper.size_by_sensor(GRIPPER, read["exact"])))
        for method, pieces_fitted, diameters in ways:
            off = np.abs(diameters - read["diameters"])
            rows.append(Size(method, task, pieces, pieces_fitted, errors, len(off), *_spread(off)))
        rows.append(_shape(test, task, pieces, errors, read))
    return rows


def _shape(fineness: str, task: str, pieces: int, errors: float | None, read: dict) -> Shape:
    robot = GRIPPER.fingers[0].robot
    bend = np.degrees(np.abs(read["bends"] - read["exact"])) * robot.length / robot.pieces
    parts = make(fineness, task, 1).simulation.scene.parts
    true = np.stack([part.tip(read["qpos"]) for part in parts.values()], axis=1)
    tips = [[points[-1] for points in finger_shapes(GRIPPER, row)] for row in read["bends"]]
    away = np.linalg.norm(np.array(tips) - true, axis=2)
    return Shape(task, pieces, errors, away.size, *_spread(bend), *_spread(away))


def _spread(values: ndarray) -> tuple[float, float, float]:
    """Mean, 95th percentile and largest."""
    return float(values.mean()), float(np.percentile(values, 95)), float(values.max())


def _built(fineness: str, task: str) -> tuple[int, float]:
    """Pieces of a finger, and timestep [s]."""
    scene = make(fineness, task, 1).simulation.scene
    return next(iter(scene.parts.values())).scene.config.n_pieces, scene.timestep.timestep


def outcomes(fineness: str, task: str, policy: str, count: int, examples: int = 0) -> list[Outcome]:
    """Episodes under a policy: "scripted 20 N" and the like, "sized" by the sensors, or "ppo".

    Args:
        fineness: How finely grippers are simulated.
        task: Name of the task.
        policy: The policy.
        count: Number of episodes.
        examples: Bars to which "sized" is fitted, or steps with which "ppo" is trained.
    """
    how: dict[str, Any] = {}
    if policy == "ppo":
        by, how = trained(task, examples), VIEW
    elif policy == "sized":
        size, how = fitted_size("quick", task, examples, 1.0), {"observe": ("sensors",)}
    else:
        by = closing(float(policy.split()[1]))
    env = make(fineness, task, count, **how)
    if policy == "sized":
        known = calibrated_to(env, fineness, _HELD, {})
        by = gripper.SizedGrip(GRIPPER, PERIOD, size=size, sensors=known)
    about = task, f"ppo, {examples} steps" if policy == "ppo" else policy
    return [Outcome(*about, *_built(fineness, task), count, *_played(env, by, _HELD))]


def trained(task: str, steps: int) -> Any:
    """A policy of stable-baselines3's PPO, trained with the quick fineness."""
    import torch
    from stable_baselines3 import PPO

    from softrobot_env.training.vec_env import TrackingVecEnv

    torch.set_num_threads(1)
    env = TrackingVecEnv([make("quick", task, _LEARNERS, autoreset_mode="SameStep", **VIEW)])
    env.seed(0)
    settings = {"n_steps": 256, "batch_size": 512, "gamma": 0.98, "learning_rate": 1e-3}
    start = {"policy_kwargs": {"log_std_init": -1.0}, "seed": 0, "device": "cpu"}
    return PPO("MlpPolicy", env, **settings, **start).learn(steps)


# -------------------- speed


def speeds(task: str, many: int, threads: Sequence[int]) -> list[Speed]:
    """What steps cost by the rule and quickly, one gripper or many on some threads."""
    robot, truth, rows = GRIPPER.fingers[0].robot, _bends("rule", task), []
    for fineness in ("rule", "quick"):
        off = np.degrees(np.abs(_bends(fineness, task) - truth)) * robot.length / robot.pieces
        rows.append(_speed(fineness, task, 1, 1, float(off.mean()), float(off.max())))
    return rows + [_speed("quick", task, many, count, None, None) for count in threads]


def _speed(fineness: str, task: str, count: int, threads: int, *errors: float | None) -> Speed:
    own = *_built(fineness, task), fineness, count, threads
    return Speed(task, *own, _rate(fineness, task, count, threads), *errors)


def _bends(fineness: str, task: str) -> ndarray:
    """Curvatures (steps, n, pieces) [1/m] of grippers that close, with neither pull nor shake."""
    env = make(fineness, task, _COMPARED)
    moments = play(env, closing(_SQUEEZE), _TESTED, {"pull": 0.0, "shake": 0.0})
    steps = round(_CLOSED / PERIOD)
    return np.stack([env.simulation.curvature for _ in islice(moments, 1, 1 + steps)])


def _rate(fineness: str, task: str, count: int, threads: int) -> float:
    """Steps per second of all grippers, over an episode: they close, hold, are pulled and shaken.

    Of processor time on one thread, which a busy machine does not change, else of wall time.
    """
    env = make(fineness, task, count, threads)
    clock = process_time if threads == 1 else perf_counter
    seen, _ = env.reset(seed=_TESTED)
    policy, state, took, steps = closing(_SQUEEZE), None, 0.0, env.max_episode_steps
    for _ in range(steps):
        action, state = policy.predict(seen, state)
        begin = clock()
        seen, *_ = env.step(action)
        took += clock() - begin
    return steps * count / took


# -------------------- the study

#: Policies that hold, and that enclose; steps with which reinforcement learning is trained to.
HOLDERS = ("scripted 20 N", "scripted 30 N", "scripted 40 N", "sized")
CLOSERS = ("scripted 12 N", "scripted 16 N", "scripted 20 N")
LEARNED = {"enclose": 80_000, "hold": 80_000}

#: Imperfections of sensors, over the usual ones; None of exact bends.
SCALES = None, 0.0, 1.0, 2.0

#: Bars that sizes are fitted to and tested on, held bars, and those tested and held by the rule.
EXAMPLES, TESTED, HELD, TESTED_BY_RULE, HELD_BY_RULE = 300, 100, 200, 40, 60

#: Grippers at once, on so many threads.
MANY, THREADS = 64, (1, 2, 4)


def cases(quick: bool = False) -> list[tuple]:
    """Names of what measures, with arguments; all but speeds."""
    if quick:
        return [
            ("grips", next(iter(things())), 4.0, 6),
            ("sizes", "quick", "quick", "enclose", 40, 10, (None, 1.0)),
            ("outcomes", "quick", "hold", "scripted 30 N", 20),
        ]
    ppo = LEARNED.items() if find_spec("stable_baselines3") is not None else ()
    return [
        ("sizes", "quick", "rule", "enclose", EXAMPLES, TESTED_BY_RULE, SCALES[::2]),
        ("outcomes", "rule", "hold", "scripted 30 N", HELD_BY_RULE),
        *(("outcomes", "quick", task, "ppo", HELD, steps) for task, steps in ppo),
        *(("sizes", "quick", "quick", task, EXAMPLES, TESTED, SCALES) for task in LEARNED),
        *(("grips", name) for name in things()),
        *(("outcomes", "quick", "hold", policy, HELD, EXAMPLES) for policy in HOLDERS),
        *(("outcomes", "quick", "enclose", policy, HELD) for policy in CLOSERS),
    ]


def measure(case: tuple) -> list[Record]:
    """Rows of a case."""
    what, *given = case
    return {"grips": grips, "sizes": sizes, "outcomes": outcomes}[what](*given)


def stages(lab: Lab) -> list[Record]:
    """All cases in processes; then what needs several threads by itself."""
    rows = lab.measure(cases(lab.quick), measure)
    if lab.quick:
        return rows + speeds("enclose", 4, (1,))
    return rows + [row for task in LEARNED for row in speeds(task, MANY, THREADS)]


STUDY = Study(
    kinds=(Grip, Size, Shape, Outcome, Speed),
    stages=stages,
    tables=[
        table(
            "Grips of clamped cylinders, and of the oval: bends of the middle finger's sensors",
            *("thing", "tension", "kind", Column("bends deg", "sensor_1", ".1f")),
            *(Column("", "sensor_2", ".1f"), Column("", "sensor_3", ".1f")),
            *("turn", "touching", "tip_share"),
            of=Grip,
            caption="turn: of a sensor that lies on the cylinder altogether",
        ),
        table(
            "Diameters from one enclosing grip, of bars and fingers that were not fitted to",
            of=Size,
            caption="sensors: their imperfections over the usual ones; none: exact mean bends",
        ),
        table(
            "Bends and tips by calibrated sensors",
            of=Shape,
        ),
        table(
            "Random bars and fingers, held under random pulls and shaking, or enclosed",
            of=Outcome,
            caption="error: over what counts as success, median",
        ),
        table(
            "Speed, with closings to 25 N",
            of=Speed,
            caption="bend: difference of a sensor from the rule's, mean and largest in a closing",
        ),
    ],
)
