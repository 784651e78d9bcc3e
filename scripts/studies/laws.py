"""Policies of all robots on generic paths: every law on every robot, and on what it does not know.

`LAWS`: at shares of the robot's first frequency. `TRANSFER`: on plants, robots and twins that a
policy was not tuned on.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import compress
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy import ndarray
from rich.table import Table

from softrobot_env.beams.registry import MUJOCO, PLANTS, BeamPlant
from softrobot_env.control.registry import fitting_policies
from softrobot_env.core.files import models_dir
from softrobot_env.envs.randomization import Randomization
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation import runner
from softrobot_env.evaluation.report import variation_label
from softrobot_env.evaluation.rollout import Rollout
from softrobot_env.evaluation.runner import Case
from softrobot_env.learned.network import describe
from softrobot_env.learned.training import train_regularised
from softrobot_env.rendering.figures import BLACK, Axes, Figure
from softrobot_env.robots import ARM, EQUIVALENT_RIG, RIG, RobotParams, find_robot
from softrobot_env.robots.actuation import TendonMap
from softrobot_env.robots.file import read_robot, write_robot
from softrobot_env.robots.registry import EXAMPLES
from softrobot_env.robots.twin import sampled_twin
from softrobot_env.scene.build import build_scene
from softrobot_env.scene.linearised import linearised
from softrobot_env.scene.registry import scene_of
from softrobot_env.tasks import Task
from softrobot_env.tasks.generic import ReachableRegion, generic_tasks, site_of
from softrobot_env.thesis.arm import quasi_static
from softrobot_env.training.artifacts import save, save_vector_policy
from softrobot_env.training.imitation import ImitationConfig, imitate
from softrobot_env.training.references import generic_task
from softrobot_env.training.registry import TRAININGS
from softrobot_env.training.request import TrainingRequest, file_of
from studies import lab, trainings
from studies.policies import PolicyRow, record_of

#: Names of the robots of the studies. The rig is the twin whose parameters come with the package.
ROBOTS = (ARM.name, RIG.name, EQUIVALENT_RIG.name, *EXAMPLES)
RIG_TWIN = 0

#: The policy that does nothing: to be compared with.
HOLD = "hold"

#: What differs where curvature rates are observed, not measured.
OBSERVER = "observer"

Kind = TypeVar("Kind", bound="LapsRow")


@dataclass(frozen=True, kw_only=True)
class LapsRow(PolicyRow):
    """An episode; errors are None after a failure.

    Attributes:
        frequency: Laps per second over the frequency of the robot's first mode [1].
        radius: [m] of the path.
        feedback: What the policy measured.
        what: What differs from the nominal robot and its chain, for people; "" if nothing.
        lap_mean, lap_max: [m], error at full rate, after the ramp; all other errors include it.
        share_mean, share_max: The same over the length of the robot [1].
    """

    frequency: float = lab.quantity("", "g", "laps per second / first frequency")
    radius: float
    feedback: str
    what: str
    lap_mean: float | None
    lap_max: float | None
    share_mean: float | None = lab.quantity("%", ".2g", "error / length")
    share_max: float | None

    @property
    def limited(self) -> float:
        """Share of the decisions that could not be the ones wanted [1]."""
        return sum(self.remarks.values())


@dataclass(frozen=True)
class RefusedRow(lab.Record):
    """A policy, or a plant, that cannot serve a robot.

    Attributes:
        robot, policy: Names.
        what: As of `LapsRow`, or which task.
        reason: Why not.
    """

    robot: str
    policy: str
    what: str
    reason: str


def refusal(robot: str, policy: str, what: str, reason: str) -> RefusedRow:
    """A refusal, without the place of this checkout in its reason."""
    return RefusedRow(robot, policy, what, reason.replace(f"{models_dir().parent}/", ""))


def run_laps(case: Case, kind: type[Kind] = LapsRow, **own: Any) -> Kind | RefusedRow:
    """Run an episode of a task at a frequency; `own` are the fields that another kind of row adds.

    Policies and plants that cannot serve the robot are rows too.
    """
    robot, what = case.task.robot, difference(case)
    try:
        outcome = runner.run(case)
    except ValueError as error:
        return refusal(robot.name, case.policy, what, str(error))
    mean, most = _lap_errors(outcome.rollout, case)
    return record_of(
        outcome,
        kind,
        frequency=case.task.option("frequency"),
        radius=case.task.option("radius"),
        feedback=case.feedback or "state",
        what=what,
        lap_mean=mean,
        lap_max=most,
        share_mean=None if mean is None else mean / robot.length,
        share_max=None if most is None else most / robot.length,
        **own,
    )


def laps_case(task: Task, policy: str, **more: Any) -> Case:
    """An episode of a robot as its policies know it, up to the end of the laps at full rate."""
    run = task.trajectory
    own = {"twin": RIG_TWIN} if task.robot == RIG else {}
    return Case(task, policy, **({"duration": run.end_time - run.ramp} | own | more))


def difference(case: Case) -> str:
    """What differs from the nominal robot, its chain and its full state, for people."""
    twin = case.scene.get("twin")
    seed = case.twin if twin is None else twin.seed
    own = twin is None and seed in (None, RIG_TWIN)
    plant = "" if case.plant == MUJOCO else case.plant
    varied = variation_label({"variation": case.variation})
    feedback = OBSERVER if case.feedback == "output" else ""
    return ", ".join(filter(None, (plant, "" if own else f"twin {seed}", varied, feedback)))


def _lap_errors(rollout: Rollout, case: Case) -> tuple[float | None, float | None]:
    """Mean and largest error [m] at full rate."""
    run, time = case.task.trajectory, rollout.time
    error = rollout.error[time >= run.ramp]
    if rollout.failure is not None or not len(error):
        return None, None
    return float(error.mean()), float(error.max())


# ---------------------------------------------------------------- what a lap asks of the drives

#: Instants of a lap.
_COUNT = 96

#: Largest share of the drives' limits that a path of a study asks for, and of its default radius
#: that is looked for at least.
_WITHIN, _LEAST = 0.9, 0.02
_TRIALS = 8


class Demand(NamedTuple):
    """Largest shares of limits that a lap at full rate asks for [1].

    Attributes:
        inputs: Of the inputs.
        speed: Of the speed of servos; zero of other drives.
    """

    inputs: float
    speed: float


def demand(task: Task) -> Demand:
    """What the laps of a generic task at a frequency ask for; errors as of `inputs_of_lap`."""
    lap, needed = inputs_of_lap(task)
    inputs, rates = site_of(task.robot).inverse.inputs, 2 * np.pi / lap * np.arange(_COUNT // 2 + 1)
    speed = np.fft.irfft(1j * rates[:, None] * np.fft.rfft(needed, axis=0), _COUNT, axis=0)
    return Demand(
        float((np.abs(needed - inputs.input_centre) / inputs.input_scale).max()),
        float(np.abs(speed).max() / task.robot.drive.speed),
    )


def inputs_of_lap(task: Task) -> tuple[float, ndarray]:
    """Duration [s] of a lap at full rate, and inputs (k, n_inputs) at equal instants of it.

    Raises:
        ValueError: The robot cannot hold its tip somewhere on the path.
    """
    site, run = site_of(task.robot), task.trajectory
    points = run.curve.derivative(2 * np.pi * np.arange(_COUNT) / _COUNT, 0)
    held = site.held_along(points, f"task {task.name!r}")[1]
    added = _added(site, run.rate, np.fft.rfft(points, axis=0))
    return 2 * np.pi / run.rate, held + np.fft.irfft(added, _COUNT, axis=0)


def _added(site: ReachableRegion, rate: float, path: ndarray) -> ndarray:
    """What dynamics adds to inputs (k, n_inputs), of a path (k, 3) [m], at multiples of a rate."""
    chain, directions = linearised(site.inverse, site.ground.inputs), site.inverse.directions
    still = np.linalg.pinv(directions @ chain.response(0.0))
    inverses = (np.linalg.pinv(directions @ chain.response(k * rate)) for k in range(len(path)))
    return np.stack([(g - still) @ directions @ p for g, p in zip(inverses, path, strict=True)])


def feasible_task(robot: RobotParams, name: str, frequency: float) -> tuple[Task, Demand]:
    """A generic task of the default radius, or a smaller one that its drives can follow.

    Raises:
        ValueError: None is found, or the robot has no room for it.
    """
    make = generic_tasks(robot)[name]
    task = make(frequency=frequency)
    first = least = task.option("radius")
    for _ in range(_TRIALS):
        asked = demand(task)
        if max(asked) <= _WITHIN:
            return task, asked
        least *= max(0.3, 0.95 * _WITHIN / max(asked))
        if least < _LEAST * first:
            break
        task = make(radius=float(f"{least:.2g}"), frequency=frequency)
    raise ValueError(
        f"task {name!r} at {frequency:g} of the first frequency asks robot {robot.name!r} for "
        f"{max(asked):.2g} times what its drives can do, with a radius of {1e3 * least:.2g} mm too"
    )


# ---------------------------------------------------------------- paths and laws of a robot

#: Generic tasks, and laps per second over the first frequency.
TASKS = ("circle", "figure_eight", "random")
FREQUENCIES = (0.1, 0.3, 0.5)


@dataclass(frozen=True)
class PathRow(lab.Record):
    """A path of a robot.

    Attributes:
        robot, task: Names.
        frequency: Laps per second over the first frequency [1].
        first_frequency: [Hz].
        radius: [m].
        inputs, speed: Largest shares of the drives' limits that a lap asks for [1], see `demand`.
    """

    robot: str
    task: str = lab.quantity(form="", label="path")
    frequency: float = lab.quantity("", "g", "laps/s\nover f1")
    first_frequency: float = lab.quantity("", ".3g", "f1 Hz")
    radius: float = lab.quantity("mm", ".3g")
    inputs: float = lab.quantity("%", ".0f")
    speed: float = lab.quantity("%", ".0f", "servo\nspeed")


@dataclass(frozen=True)
class Prepared:
    """What is known of a robot before any episode.

    Attributes:
        tasks: Its tasks.
        policies: Names of those that can drive it.
        rows: Its paths, and what is refused and why.
    """

    tasks: list[Task]
    policies: list[str]
    rows: list[PathRow | RefusedRow]


#: What is trained for robots that no artifacts are shipped of.
TRAINED = ("qs_nn", "lqi", "lq_preview", "mpc", "mpc_preview")


def trained_robot(name: str, folder: Path, quick: bool = False) -> RobotParams:
    """A robot of a file in a folder, with what its policies learn of it beside."""
    robot = find_robot(name)
    if robot in (ARM, RIG):
        return robot
    file = folder / f"{name}.toml"
    write_robot(robot, file)
    robot = read_robot(file)
    for policy in TRAINED:
        order = TrainingRequest(
            robot, file_of(robot, policy), _SEED, {"quick": True} if quick else {}
        )
        TRAININGS[policy].run(order, lambda description, done, total: None)
    return robot


def prepare(
    name: str,
    tasks: tuple[str, ...],
    frequencies: tuple[float, ...],
    folder: Path,
    quick: bool = False,
) -> Prepared:
    """Train for a robot, lay out its paths, and ask all policies whether they can drive it."""
    robot, made, rows = trained_robot(name, folder, quick), [], []
    for task in tasks:
        for frequency in frequencies:
            try:
                path, asked = feasible_task(robot, task, frequency)
            except ValueError as error:
                rows.append(refusal(name, "", f"{task}, {frequency:g} f1", str(error)))
                continue
            # The rig's camera, and with it the rig's policies, know x and y alone.
            made.append(replace(path, axes="xy") if robot in (RIG, EQUIVALENT_RIG) else path)
            first, radius = site_of(robot).frequency, path.option("radius")
            rows.append(PathRow(name, task, frequency, first, radius, *asked))
    fits = fitting_policies(robot)
    rows += [refusal(name, policy, "", why) for policy, why in fits.items() if why]
    return Prepared(made, [policy for policy, why in fits.items() if not why], rows)


# ---------------------------------------------------------------- goals

#: Frequency over the first one -> largest mean error over the length [1], on the worst path.
LIMITS = {0.1: 0.003, 0.3: 0.01, 0.5: 0.02}

#: What differs from the nominal robot -> so many times these limits are allowed.
ROOM = {"": 1.0, "E x 0.75": 2.0, "E x 1.25": 2.0, OBSERVER: 1.5}


@dataclass(frozen=True)
class GoalRow(lab.Record):
    """A goal, and what the best law of a robot reached.

    Attributes:
        robot, policy: Names.
        what: One of `ROOM`.
        frequency: As of `LapsRow`.
        share: Mean error over the length on the worst path [1]; None if an episode failed or was
            refused.
        ratio: The same over that of the nominal robot [1]; None where there is none.
        limit: The largest share allowed.
        met: Whether it was met.
    """

    robot: str
    policy: str = lab.quantity(form="", label="best law")
    what: str
    frequency: float = lab.quantity("", "g", "laps/s\nover f1")
    share: float | None = lab.quantity("%", ".3f", "error/\nlength")
    ratio: float | None = lab.quantity("", ".2f", "over\nnominal")
    limit: float = lab.quantity("%", ".2f")
    met: bool


def ranked_laws(rows: Iterable[LapsRow]) -> dict[str, list[str]]:
    """Robot -> its laws, first that which is farthest below the limits where it is least so.

    Laws that failed somewhere, or were not run in all that others were, come later.
    """
    known = [row for row in rows if row.what in ROOM and row.policy != HOLD]
    robots = lab.groups(known, "robot").items()
    return {robot: list(lab.ranked(mine, "policy", _over_limit)) for (robot,), mine in robots}


def _over_limit(row: LapsRow) -> float | None:
    """Error over its limit; None after a failure."""
    limit = ROOM[row.what] * LIMITS[row.frequency]
    return row.share_mean / limit if row.failure is None else None


def goal_rows(rows: list[LapsRow]) -> Iterator[GoalRow]:
    """Goals of the best laws, for all that was run."""
    for robot, (law, *_) in ranked_laws(rows).items():
        mine = lab.select(rows, robot=robot, policy=law)
        for (frequency,), nominal in lab.groups(lab.select(mine, what=""), "frequency").items():
            for what, room in ROOM.items():
                found = lab.select(mine, what=what, frequency=frequency)
                pair = [_largest_share(group, len(nominal)) for group in (found, nominal)]
                ratio = None if None in pair else pair[0] / pair[1]
                share, limit = pair[0], room * LIMITS[frequency]
                met = share is not None and share <= limit
                yield GoalRow(robot, law, what, frequency, share, ratio, limit, met)


def _largest_share(rows: list[LapsRow], wanted: int) -> float | None:
    """The largest; None unless there are as many as wanted."""
    shares = [row.share_mean for row in rows if row.share_mean is not None]
    return max(shares) if len(shares) == wanted else None


# ---------------------------------------------------------------- running the laws

#: Factors on Young's modulus that the best laws of a robot meet, and how many laws they are.
MODULI, BEST = (0.75, 1.25), 3

#: Robots, tasks and frequencies, and those of a quick run.
_ALL = (ROBOTS, TASKS, FREQUENCIES)
_QUICK = (("planar_finger",), TASKS[:1], FREQUENCIES[1:2])


def _without(folder: str, row: lab.Record) -> lab.Record:
    """The row with robots' files named without their folder, which is gone."""
    if not isinstance(row, RefusedRow):
        return row
    return replace(row, reason=row.reason.replace(f"{folder}/", ""))


def laws(bench: lab.Lab) -> list[lab.Record]:
    """Paths, what is refused, episodes of all laws that fit, of the best on other robots, goals."""
    robots, tasks, frequencies = _QUICK if bench.quick else _ALL
    with TemporaryDirectory() as folder:
        known = _prepared(bench, robots, tasks, frequencies, Path(folder))
        rows: list[lab.Record] = [row for prepared in known.values() for row in prepared.rows]
        every = [(t, law) for p in known.values() for law in p.policies for t in p.tasks]
        rows += bench.measure([laps_case(*each) for each in every], run_laps)
        rows += _varied(bench, known, lab.of_kind(rows, LapsRow))
        rows += goal_rows(lab.of_kind(rows, LapsRow))
    return [_without(folder, row) for row in rows]


def _prepared(bench: lab.Lab, robots: tuple[str, ...], *given: Any) -> dict[str, Prepared]:
    given = *given, bench.quick
    jobs = [(f"training and paths of {name}", partial(prepare, name, *given)) for name in robots]
    return dict(zip(robots, bench.tasks(jobs), strict=True))


def _varied(
    bench: lab.Lab, known: dict[str, Prepared], rows: list[LapsRow]
) -> list[LapsRow | RefusedRow]:
    """The best laws of each robot on softer and stiffer ones, and with an observer."""
    cases, unchanged = [], []
    best = [(name, law) for name, laws in ranked_laws(rows).items() for law in laws[:BEST]]
    for name, law in best:
        ways: list[dict[str, Any]] = [{"variation": {"youngs_modulus": f}} for f in MODULI]
        if _reads_rates(laps_case(known[name].tasks[0], law)):
            ways.append({"feedback": "output"})
        else:
            same = {"what": OBSERVER, "feedback": "output"}
            unchanged += [replace(row, **same) for row in lab.select(rows, robot=name, policy=law)]
        cases += [laps_case(task, law, **way) for way in ways for task in known[name].tasks]
    return [*bench.measure(cases, run_laps), *unchanged]


def _reads_rates(case: Case) -> bool:
    """Whether a policy reads curvature rates, which an observer can give."""
    with closing(case.environment()) as env:
        return "curvature_rate" in getattr(case.make_policy(env.control_period), "requires", ())


# ---------------------------------------------------------------- tables of the laws

_LAW_NOTES = (
    "Errors are those of two laps at full rate, after a ramp of one lap. "
    "Decision times are medians of cores that are all busy. Limited: share of the decisions whose "
    "status says that the action, or the motion that it gives, is not the one wanted. What a lap "
    "asks of drives is by exact statics and the chain linearised in the middle of its ground; a "
    "radius that is not the default is the largest, to two digits, with at most 90 % of the "
    "limits. The rig is twin 0 with camera and servos, whose errors policies know as far as they "
    "were identified; its errors are those in x and y. The best law is the one of the three "
    "best on the nominal robot that is farthest below its goals on all robots and feedbacks."
)


def refused(rows: Sequence[Any]) -> Table:
    """What is refused, and why: a line per robot and reason."""
    out = lab.new_table("Refused", ("robot", "policies", "with", "reason"))
    for (robot, what, reason), same in lab.groups(
        lab.of_kind(rows, RefusedRow), "robot", "what", "reason"
    ).items():
        out.add_row(robot, ", ".join(row.policy for row in same), what, reason)
    return out


def _lap_error(rows: list[LapsRow]) -> str:
    """Mean and largest error in mm and % of the length of an episode."""
    row = rows[0]
    if row.lap_mean is None:
        return "failed"
    size = "/".join(lab.number(v, ".2g", "mm") for v in (row.lap_mean, row.lap_max))
    return f"{size} ({lab.number(row.share_mean, '.2g', '%')})"


#: Failed episodes, if any.
FAILED = lab.failures(
    "robot", "policy", "task", "frequency", lab.Column("with", "what"), of=LapsRow
)


def _slowest(rows: list[LapsRow]) -> str:
    return lab.number(max(row.policy_time_median for row in rows), ".0f", "µs")


# ---------------------------------------------------------------- picture of the laws

#: Laws in a panel, those at the top of the ranking; the tables have all.
_BEST_LAWS = 5


def law_picture(rows: Sequence[Any]) -> Figure:
    """Draw the mean error over the length on the worst path against the frequency."""
    laps, goals = lab.of_kind(rows, LapsRow), lab.select(lab.of_kind(rows, GoalRow), what="")
    ranks = ranked_laws(laps)
    best = {robot: laws[0] for robot, laws in ranks.items()}
    reached = sum(all(g.met for g in mine) for mine in lab.groups(goals, "robot").values())

    def chosen(row: LapsRow) -> bool:
        laws = [*ranks.get(row.robot, [])[:_BEST_LAWS], HOLD]
        return row.what == "" and row.policy in laws

    def goal(axis: Axes, rows: list[LapsRow], name: str) -> None:
        axis.plot(LIMITS.keys(), [100 * v for v in LIMITS.values()], "_", color=BLACK, ms=22)
        axis.set_xticks(list(LIMITS))

    return lab.lines(
        "frequency",
        "share_mean",
        "policy",
        title=f"The best law stays within the goal at every speed on {reached} of {len(best)} "
        "robots",
        subject=f"Mean error on the worst path, at full rate; the {_BEST_LAWS} best laws of each "
        "robot and the resting robot, the best one thick; crosses: failed; black: goal of the best",
        panel="robot",
        where=chosen,
        join=max,
        log="y",
        line=lambda rows: {"linewidth": 2.6 if best.get(rows[0].robot) == rows[0].policy else 1.2},
        columns=2,
        size=(4.75, 2.7),
        decorate=goal,
    )(laps)


LAWS = lab.Study(
    kinds=(LapsRow, RefusedRow, PathRow, GoalRow),
    stages=laws,
    tables=[
        lab.table(
            "Paths, and what a lap asks of the drives, of their limits",
            *("robot", "task", "frequency", "first_frequency", "radius", "inputs", "speed"),
            of=PathRow,
        ),
        lab.pivot(
            "{robot}: error in mm (mean in % of the length), decision time, limited decisions",
            ("policy", "task"),
            "frequency",
            _lap_error,
            of=LapsRow,
            where={"what": ""},
            per=("robot",),
            heading=lambda frequency: f"{frequency:g} f1\nmean/max mm (%)",
            headings=("law", "path"),
            more={
                "µs": _slowest,
                "limited\n%": lambda rows: "/".join(f"{100 * row.limited:.0f}" for row in rows),
            },
            sections=True,
        ),
        lab.table(
            "Goals: the worst path of the best law",
            *(
                "robot",
                "policy",
                lab.Column("with", lambda row: row.what or "nominal"),
                "frequency",
            ),
            *("share", "ratio", "limit", lab.Column("met", lambda row: lab.verdict(row.met))),
            of=GoalRow,
        ),
        FAILED,
        refused,
    ],
    note=_LAW_NOTES,
    plots={"{}": law_picture},
)

# ---------------------------------------------------------------- worlds of the transfer

#: Groups of worlds.
PLANT, VARIED, TWIN = "plant", "varied", "twin"

#: Of the nominal robot, one at a time.
VARIATIONS = ({"youngs_modulus": 0.75}, {"youngs_modulus": 1.25})

#: All of them at once; seeds of what is sampled.
SAMPLED = Randomization(youngs_modulus=(0.7, 1.4), density=(0.7, 1.4), damping_time=(0.5, 2.0))
SEEDS = (1,)


@dataclass(frozen=True)
class World:
    """Something to test a policy on.

    Attributes:
        name: For people.
        group: One of `PLANT`, `VARIED` and `TWIN`.
        case: Keywords of a `Case`.
    """

    name: str
    group: str
    case: Mapping[str, Any] = field(default_factory=dict)


def worlds(robot: RobotParams) -> list[World]:
    """All worlds of a robot, the plants first; twins are those of robots driven by length."""
    found = [World(plant, PLANT, {"plant": plant}) for plant in PLANTS]
    found += [
        World(variation_label({"variation": v}), VARIED, {"variation": v}) for v in VARIATIONS
    ]
    draws = (SAMPLED.draw(np.random.default_rng(seed)) for seed in SEEDS)
    found += [World(f"drawn {k}", VARIED, {"variation": v}) for k, v in enumerate(draws)]
    if robot == RIG:
        found += [World(f"twin {seed}", TWIN, {"twin": seed}) for seed in SEEDS]
    elif robot.drive.kind == "length":
        twins = {seed: {"twin": sampled_twin(robot, seed)} for seed in SEEDS}
        found += [World(f"twin {seed}", TWIN, {"scene": twin}) for seed, twin in twins.items()]
    return found


# ---------------------------------------------------------------- trainings for the transfer

#: Of their random numbers.
_SEED = 0

#: Much less than what is shipped was trained with; the same for every plant.
_PAIRS = 1500
_IMITATION = ImitationConfig(
    rounds=3, samples=5000, shares=2, epochs=6, last_epochs=30, processes=0
)

#: Steps of PPO as stable-baselines3 comes, of each of its environments between two updates, and
#: the paces of their random paths, in laps per period of the first mode.
_STEPS, _BETWEEN, _PACES = 120_000, 1024, (0.1, 0.2, 0.3, 0.4) * 2

#: Tables that are also designed from another plant than the chain, and that plant.
TABLES, OTHER = ("lqi", "lq_preview", "mpc", "mpc_preview"), "pcc"


@dataclass(frozen=True)
class Tuned:
    """A policy of a robot, as shipped, or trained for this study.

    Attributes:
        robot, policy: Names.
        plant: That it was tuned or trained on.
        given: The policy's keyword argument for its file, if it was trained for this study.
    """

    robot: str
    policy: str
    plant: str = MUJOCO
    given: Mapping[str, Path] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """As of `TransferRow`."""
        return f"{self.policy} of {self.plant}" if self.given else self.policy


def train_qs_nn(plant: str, path: Path) -> None:
    """Train the quasi-static network on a plant's statics, and save it."""
    tip, how = _statics(plant), quasi_static.Sampling(pairs=_PAIRS)
    drawn, start = (np.random.default_rng(s) for s in np.random.SeedSequence(_SEED).spawn(2))
    samples = quasi_static.sample(tip, TendonMap(ARM).n_inputs, how, drawn)
    fit = train_regularised(samples.new_network(quasi_static.HIDDEN, start), samples)
    reached = quasi_static.workspace(samples.inputs[:, 2:4])
    fit.network.save(path, {**describe(ARM), "workspace": reached, "seed": _SEED})


def train_imitation(plant: str, path: Path) -> None:
    """Train an imitation on a plant, and save it."""
    save(imitate(replace(_IMITATION, plant=plant), _SEED, lab.quiet), path, _SEED)


def train_ppo(plant: str, path: Path) -> None:
    """Train PPO on a few random paths on a plant, single environments one after the other."""
    from stable_baselines3.common.vec_env import DummyVecEnv

    env = DummyVecEnv([partial(_vectors, plant, k, pace) for k, pace in enumerate(_PACES)])
    model, _ = trainings.train_ppo(env, _SEED, _STEPS, n_steps=_BETWEEN)
    save_vector_policy(path, model, env.envs[0], _SEED)
    env.close()


def _vectors(plant: str, seed: int, pace: float) -> TrackingEnv:
    """The arm on a random path, as learning libraries see it."""
    own = {} if plant == MUJOCO else {"plant": BeamPlant(plant)}
    task = generic_task("random", ARM, seed=seed, frequency=pace)
    return TrackingEnv(task, observe_as="vector", **own)


#: Policy of the arm -> how it is trained, and the plants that it is trained on.
NETWORKS: dict[str, tuple[Callable[[str, Path], None], tuple[str, ...]]] = {
    "qs_nn": (train_qs_nn, (MUJOCO, "pcc", "cosserat")),
    "imitation": (train_imitation, (MUJOCO, "pcc")),
    "ppo": (train_ppo, (MUJOCO, "pcc")),
}


def train_network(policy: str, plant: str, folder: Path) -> list[Tuned]:
    """Train one of `NETWORKS`."""
    path = folder / f"{ARM.name}_{policy}_{plant}.npz"
    NETWORKS[policy][0](plant, path)
    return [Tuned(ARM.name, policy, plant, {"weights": path})]


def tune_tables(name: str, folder: Path) -> list[Tuned | RefusedRow]:
    """Design the tables of a robot from the other plant, or say why not."""
    robot, out = find_robot(name), []
    for policy in TABLES:
        path = folder / f"{name}_{policy}_{OTHER}.npz"
        why = _untunable(robot)
        try:
            if why is None:
                TRAININGS[policy].run(
                    TrainingRequest(robot, path, _SEED, {"plant": OTHER}), lab.quiet
                )
        except ValueError as error:
            why = str(error)
        refused = None if why is None else refusal(name, policy, f"tuned on {OTHER}", why)
        out.append(refused or Tuned(name, policy, OTHER, {"gains": path}))
    return out


def _untunable(robot: RobotParams) -> str | None:
    """Why tables of a robot cannot be designed from another plant; None if they can."""
    if robot == ARM:
        return "the arm's gains are those of the closed form of constant curvature on any plant"
    if robot == RIG:
        return (
            f"tables are tuned for {EQUIVALENT_RIG.name!r}, which stands as it does, in its place"
        )
    return None


def _statics(plant: str) -> quasi_static.Statics:
    """Static tip (2,) [m] of a plant by reduced inputs (n_inputs,) [N]."""
    tendons = TendonMap(ARM)
    if plant == MUJOCO:
        scene = build_scene(scene_of(ARM))
        return lambda inputs: scene.tip(scene.equilibrium(tendons.command(inputs)))[[0, 2]]
    model = BeamPlant(plant)(ARM).model
    return lambda inputs: model.tip(model.equilibrium(tendons.command(inputs)))[[0, 2]]


# ---------------------------------------------------------------- running the transfer

#: The path, and its laps per second over the first frequency.
TASK, FREQUENCY = "figure_eight", 0.3

#: The thesis' robots, and of the others one in the plane, one driven by length, and one of two
#: sections.
TRANSFER_ROBOTS = (ARM.name, RIG.name, "planar_finger", "silicone_rod", "hanging_trunk")

#: The plant on which wild motions take minutes, and the error on the chain, over the length, that
#: keeps a policy from it.
_SLOW_PLANT, _LOST = "ancf", 0.1
_LEFT_OUT = (
    f"it misses the path by over {100 * _LOST:g} % of the length on the chain, and wild motions "
    "take minutes on this plant"
)

_QUICK_ROBOTS, _QUICK_WORLDS = ("planar_finger",), ("mujoco", "pcc", "E x 0.75")


@dataclass(frozen=True, kw_only=True)
class TransferRow(LapsRow):
    """An episode in some world.

    Attributes:
        tuned_on: The plant of the policy's tuning or training.
        trained_here: Whether that was done for this study, with less data than what is shipped.
        world, group: See `World`.
        ratio: Mean error over that on the plant it was tuned on [1]; None where there is none.
    """

    tuned_on: str
    trained_here: bool
    world: str
    group: str
    ratio: float | None = None

    @property
    def label(self) -> str:
        """The policy for people, with what it was trained on for this study."""
        return f"{self.policy} of {self.tuned_on}" if self.trained_here else self.policy


def transfer(bench: lab.Lab) -> list[lab.Record]:
    """What is refused, and episodes of all policies in all worlds; a quick run trains nothing."""
    robots = _QUICK_ROBOTS if bench.quick else TRANSFER_ROBOTS
    with TemporaryDirectory() as folder:
        known = _prepared(bench, robots, (TASK,), (FREQUENCY,), Path(folder))
        made = [] if bench.quick else _trained(bench, Path(folder))
        shipped = [Tuned(n, law) for n, p in known.items() for law in p.policies if law != HOLD]
        cases = [
            (tuned, world, task)
            for name, prepared in known.items()
            for world in worlds(find_robot(name))
            if not bench.quick or world.name in _QUICK_WORLDS
            for tuned in lab.select([*shipped, *lab.of_kind(made, Tuned)], robot=name)
            for task in prepared.tasks
        ]
        rows = bench.measure([c for c in cases if c[1].name != _SLOW_PLANT], travel, _label)
        slow = [case for case in cases if case[1].name == _SLOW_PLANT]
        able = [_follows(case[0], lab.of_kind(rows, TransferRow)) for case in slow]
        for (tuned, *_), follows in zip(slow, able, strict=True):
            if not follows:
                rows.append(refusal(tuned.robot, tuned.label, _SLOW_PLANT, _LEFT_OUT))
        rows += bench.measure(compress(slow, able), travel, _label)
    order = {world.name: k for name in robots for k, world in enumerate(worlds(find_robot(name)))}
    found = sorted(
        lab.of_kind(rows, TransferRow), key=lambda r: (robots.index(r.robot), order[r.world])
    )
    why_not = [row for p in known.values() for row in p.rows] + made + rows
    return [
        *(_without(folder, row) for row in lab.of_kind(why_not, RefusedRow)),
        *(_with_ratio(row, found) for row in found),
    ]


def _label(case: tuple[Tuned, World, Task]) -> str:
    tuned, world, _ = case
    return f"{world.name}, {tuned.robot}, {tuned.label}"


def _trained(bench: lab.Lab, folder: Path) -> list[Tuned | RefusedRow]:
    """What is trained for this study, and what cannot be."""
    jobs = [
        (f"tables of {name} on {OTHER}", partial(tune_tables, name, folder))
        for name in reversed(TRANSFER_ROBOTS)  # the slowest first
    ]
    jobs += [
        (f"training {policy} on {plant}", partial(train_network, policy, plant, folder))
        for policy, (_, plants) in NETWORKS.items()
        for plant in plants
    ]
    return [made for some in bench.tasks(jobs) for made in some]


def travel(case: tuple[Tuned, World, Task]) -> TransferRow | RefusedRow:
    """An episode that ends a lap earlier than those of the study of laws: some plants are slow."""
    tuned, world, task = case
    run = task.trajectory
    duration = run.end_time - run.ramp - 2 * np.pi / run.rate
    return run_laps(
        laps_case(task, tuned.policy, duration=duration, given=tuned.given, **world.case),
        TransferRow,
        tuned_on=tuned.plant,
        trained_here=bool(tuned.given),
        world=world.name,
        group=world.group,
    )


def _follows(tuned: Tuned, rows: list[TransferRow]) -> bool:
    """Whether a policy follows the path on the chain."""
    home = lab.one(rows, robot=tuned.robot, label=tuned.label, world=MUJOCO)
    return home is not None and home.share_mean is not None and home.share_mean < _LOST


def _with_ratio(row: TransferRow, rows: list[TransferRow]) -> TransferRow:
    """A row with its error over that of the same policy on its own plant."""
    same = {"robot": row.robot, "label": row.label, "task": row.task}
    own = lab.one(rows, **same, group=PLANT, world=row.tuned_on)
    if own is None or not own.lap_mean or row.lap_mean is None:
        return row
    return replace(row, ratio=row.lap_mean / own.lap_mean)


# ---------------------------------------------------------------- tables of the transfer

_TRANSFER_NOTES = (
    f"Mean error over a lap at full rate of {TASK}, {FREQUENCY:g} laps per period of the first "
    "mode, in % of the length, and after a stroke over that on the plant of the tuning: the chain, "
    "unless the name says on which plant it was trained or tuned for this study: networks of the "
    "arm with less data than what is shipped, PPO with 120 000 steps on random paths, tables as "
    "`softrobot train` makes them, from equilibria and linear models of pieces of constant "
    "curvature. Drawn robots vary in E, density and damping at once; twins have errors of "
    "manufacturing, servos and camera; the rig is twin 0 wherever no other is named. A dash: "
    "refused, see below."
)


def _transfer_cell(rows: list[TransferRow]) -> str:
    """Error and ratio of an episode, or what there is in their place."""
    (row,) = rows
    if row.failure is not None:
        return "failed"
    percent = None if row.share_mean is None else 100 * row.share_mean
    return " / ".join(
        lab.number(value, ".2g" if value is None or value < 99.5 else ".0f")
        for value in (percent, row.ratio)
    )


# ---------------------------------------------------------------- picture of the transfer

#: Policies of a robot; the tables have all.
_MOST = 6


def transfer_picture(rows: Sequence[Any]) -> Figure:
    """Draw the mean errors in % of the length of those that err least in their worst world."""
    found, shown, worst = lab.of_kind(rows, TransferRow), [], []
    for (robot,), mine in lab.groups(found, "robot").items():
        ranked = lab.ranked(mine, "label", lambda row: row.share_mean)
        best, *_ = labels = list(ranked)[:_MOST]
        shown += [row for label in labels for row in lab.select(mine, label=label)]
        failed = any(row.share_mean is None for row in lab.select(mine, label=best))
        worst.append((inf if failed else 100 * ranked[best], f"{robot}, {best}"))
    ends = [f"{share:.2g} % ({name})" for share, name in sorted(worst) if np.isfinite(share)]
    message = "No policy stands all worlds of a robot"
    if ends:
        said = " to ".join(dict.fromkeys((ends[0], ends[-1])))
        message = f"In their worst world robots' best policies err by {said}"
    return lab.maps(
        "robot",
        "label",
        "world",
        lambda row: None if row.share_mean is None else 100 * row.share_mean,
        title=message,
        subject="Mean error in % of the length on plants and robots that a policy was not tuned "
        f"on, of the {_MOST} that err least in their worst; a dash: refused, or no such world",
        headings=lambda rows: rows[0].robot,
        colours=lambda rows: (0.1, 100.0),
    )(shown)


TRANSFER = lab.Study(
    kinds=(TransferRow, RefusedRow),
    stages=transfer,
    tables=[
        lab.pivot(
            "{robot}, worlds by {group}: error in % of the length / over that of the tuning",
            ("label",),
            "world",
            _transfer_cell,
            of=TransferRow,
            per=("robot", "group"),
            headings=("policy",),
        ),
        FAILED,
        refused,
    ],
    note=_TRANSFER_NOTES,
    plots={"{}": transfer_picture},
)
