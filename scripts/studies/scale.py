"""What a million robot-seconds and a sweep on many cores cost, and where the time goes.

What one process does is measured in its own computing time, so that other programs do not count.
Several cores can only be compared with one while nothing else runs on them.
"""

import os
import tracemalloc
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

import gymnasium
import numpy as np

from softrobot_env.core.processes import (
    Workers,
    chosen_processes,
    usable_cores,
    using,
    worker_processes,
)
from softrobot_env.core.runs import KEPT, kept_rows, run_cases
from softrobot_env.robots import find_robot
from softrobot_env.training.rl_config import preset
from studies.lab import Column, Job, Record, Study, quantity
from studies.speed import block_time, tabled

#: [USD] of a core for an hour: an assumption, of the order of what clouds ask for.
PRICE = 0.04

#: Cores of the sweep that is reckoned.
CORES = 1000


@dataclass(frozen=True)
class Row(Record):
    """A cost; None where a field does not apply.

    Attributes:
        what: "robots", "workers", "training", "jobs" or "sweep".
        variant: Robot, way to run jobs, or algorithm.
        way: Of robots: "one", "batch" or "GPU".
        robot_seconds: That a core simulates in a second [1].
        core_hours: For a million robot-seconds [h].
        cost: Of them [USD], or of an hour of all cores of a sweep, at the price.
        price: [USD] of a core for an hour, an assumption.
        cores: That were measured, or are reckoned with.
        efficiency: Speed-up over the number of cores.
        started: [s] until workers have loaded what they need.
        physics, python, learner: Shares of a training's computing time: simulation, the rest of the
            environments, and networks and their updates.
        seconds: [s] that the driver computes for a job, its result being kept; what Ray's servers
            compute is not in it.
        memory: [B] that the driver holds for a job while a study runs.
        kept: [B] of a row that is kept, a line of a file.
        shortest_job: [s], the shortest one with which one driver keeps all cores busy.
        failure: Why there is no number.
    """

    what: str
    variant: str
    way: str | None = quantity("", "", "on", default=None)
    robot_seconds: float | None = quantity("", ".3g", "robot-s per core-s", default=None)
    core_hours: float | None = quantity("", ".3g", "core-h per million", default=None)
    cost: float | None = quantity("", ".2g", "USD", default=None)
    price: float | None = None
    cores: int | None = quantity("", "d", default=None)
    efficiency: float | None = quantity("", ".2f", default=None)
    started: float | None = quantity("s", ".1f", "ready after", default=None)
    physics: float | None = quantity("%", ".0f", default=None)
    python: float | None = quantity("%", ".0f", "Python", default=None)
    learner: float | None = quantity("%", ".0f", default=None)
    seconds: float | None = quantity("ms", ".2f", "the driver computes", default=None)
    memory: float | None = quantity("kB", ".1f", "in the driver", default=None)
    kept: float | None = quantity("kB", ".2f", default=None)
    shortest_job: float | None = quantity("s", ".2g", "shortest job", default=None)
    failure: str | None = None


def cost_of(robot_seconds: float) -> dict[str, float]:
    """Fields of a row for robot-seconds [1] per core-second."""
    hours = 1e6 / robot_seconds / 3600
    cost = {"cost": hours * PRICE, "price": PRICE}
    return {"robot_seconds": robot_seconds, "core_hours": hours, **cost}


# -------------------- jobs

#: Numbers of jobs whose costs are compared, so that starts do not count.
_FEW, _MANY, _QUICK = 20, 1020, 120


def job_rows(ways: dict[str, Workers], quick: bool) -> list[Row]:
    """A row of jobs, and one of a sweep on many cores, for each way to job_rows them."""
    many = _QUICK if quick else _MANY
    rows = []
    for name, workers in ways.items():
        with using(workers), chosen_processes():  # which keeps the connection to a cluster
            _timed(_FEW)
            (few, _), (all_, kept) = _timed(_FEW), _timed(many)
            held = _memory(many) - _memory(_FEW)
        seconds, memory = (all_ - few) / (many - _FEW), held / (many - _FEW)
        rows.append(Row("jobs", name, seconds=seconds, memory=memory, kept=kept))
        sweep = {"cost": CORES * PRICE, "price": PRICE, "shortest_job": CORES * seconds}
        rows.append(Row("sweep", name, cores=CORES, **sweep))
    return rows


def _timed(count: int) -> tuple[float, float]:
    """Computing time [s] of the driver on empty jobs, and size [B] of a row that is kept."""
    with TemporaryDirectory() as folder, kept_rows(Path(folder, KEPT), "scale") as kept:
        begin = process_time()
        run_cases(range(count), _row_of, kinds=(Row,), kept=kept)
        taken = process_time() - begin
        return taken, Path(folder, KEPT).stat().st_size / count


def _memory(count: int) -> int:
    """Most memory [B] of Python's that empty jobs take in the driver."""
    tracemalloc.start()
    try:
        run_cases(range(count), _row_of)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def _row_of(number: int) -> Row:
    """What a job returns."""
    return Row(f"job {number}", "empty", seconds=float(number))


# -------------------- trainings

WHAT, ALGORITHMS = "training", ("ppo", "sac")

#: Environment steps of all environments together that are timed, and those before.
_STEPS, _QUICK_STEPS, _FIRST = {"ppo": 16_384, "sac": 4_096}, {"ppo": 2_048, "sac": 512}, 64


def _clocked(owner: Any, name: str) -> list[float]:
    """Computing times [s] of the calls of a method from now on."""
    function, times = getattr(owner, name), []

    def timed(*args: Any, **kwargs: Any) -> Any:
        begin = process_time()
        found = function(*args, **kwargs)
        times.append(process_time() - begin)
        return found

    setattr(owner, name, timed)
    return times


def training_rows(quick: bool) -> list[Row]:
    """A row for each algorithm, from scratch with its usual settings, on one core."""
    return [_training_row(name, (_QUICK_STEPS if quick else _STEPS)[name]) for name in ALGORITHMS]


def _training_row(algorithm: str, steps: int) -> Row:
    import torch

    from softrobot_env.training.learners import make_model
    from softrobot_env.training.rl import make_training_env

    torch.set_num_threads(1)
    config = replace(preset(algorithm, False, False), warm_up=_FIRST)
    env = make_training_env(config, 0)
    model = make_model(config, env, 0)
    model.learn(_FIRST)  # what is compiled at its first use
    stepped = _clocked(env, "step_wait")
    physics = [_clocked(part.simulation, "advance") for part in env.parts]
    begin = process_time()
    model.learn(steps)
    taken = process_time() - begin
    done, period = model.num_timesteps, env.parts[0].control_period
    env.close()
    inside, around = sum(map(sum, physics)) / taken, sum(stepped) / taken
    shares = {"physics": inside, "python": around - inside, "learner": 1 - around}
    return Row(WHAT, algorithm, cores=1, **shares, **cost_of(done * period / taken))


# -------------------- several cores: processes, Ray, threads of a batch; each job steps an arm

#: [s] of a job, jobs per core, robots of a batch; rounds of which the best counts.
_JOB, _QUICK_JOB, _EACH, _ROBOTS, _ROUNDS = 5.0, 0.5, 2, 256, 5

_SWING = "SoftRobot/ArmSwing-v0"


def worker_rows(quick: bool) -> list[Row]:
    """A row for processes, for Ray if it is installed, and for the threads of a batch.

    Efficiency is how much faster all cores are than one, over their number.
    """
    cores, rows = usable_cores(), []
    steps = max(1, round((_QUICK_JOB if quick else _JOB) / step_arm(2000) * 2000))
    for name, workers in ways_of_working().items():
        # What other programs take counts least in the best round.
        found = [_jobs(name, workers, cores, steps) for _ in range(1 if quick else 2)]
        rows.append(max(found, key=lambda row: row.efficiency))
    return [*rows, _threads(cores)]


def ways_of_working() -> dict[str, Workers]:
    """Processes, and Ray if it is installed."""
    ray = {} if find_spec("ray") is None else {"Ray": Workers(ray="local")}
    return {"processes": Workers(usable_cores()), **ray}


def step_arm(count: int) -> float:
    """Time [s] of some steps of an arm that swings."""
    env = gymnasium.make(_SWING).unwrapped
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    env.step(action)
    begin = perf_counter()
    for done in range(count):
        if done % 1000 == 999:
            env.reset(seed=0)
        env.step(action)
    return perf_counter() - begin


def _jobs(name: str, workers: Workers, cores: int, steps: int) -> Row:
    """Several jobs at once, and one alone."""
    begin = perf_counter()
    with using(workers), worker_processes(cores) as pool:
        list(pool.map(step_arm, [1] * 4 * cores))  # each process loads what it needs
        started = perf_counter() - begin
        alone = pool.submit(step_arm, steps).result()
        begin = perf_counter()
        list(pool.map(step_arm, [steps] * _EACH * cores))
        efficiency = _EACH * alone / (perf_counter() - begin)
    return Row("workers", name, cores=cores, efficiency=efficiency, started=started)


def _threads(cores: int) -> Row:
    """A batch on one thread and on all."""
    times = {}
    for threads in (1, cores):
        env = gymnasium.make_vec(_SWING, num_envs=_ROBOTS, threads=threads)
        env.reset(seed=0)
        step = partial(env.step, np.zeros(env.action_space.shape, dtype=np.float32))
        step()
        times[threads] = min(block_time(step) for _ in range(_ROUNDS))
        env.close()
    efficiency = times[1] / times[cores] / cores
    return Row("workers", "threads of a batch", cores=cores, efficiency=efficiency)


# -------------------- robots

#: Robots that are timed: what `gymnasium.make_vec` takes.
ROBOTS = {
    "arm": (_SWING, None),
    "rig": ("SoftRobot/RigTriangle-v0", None),
    "hanging_trunk": ("SoftRobot/Track-v0", "hanging_trunk"),
    "ftdcr_v4": ("SoftRobot/Track-v0", "ftdcr_v4"),
}

#: Share of full actions, and times that are taken, of which the least counts.
_SHARE, _TIMES = 0.2, 6

#: Programs that run, per core, from which on the machine is busy.
_BUSY = 0.75


def jobs(quick: bool) -> list[Job]:
    """Robots, workers, trainings and jobs, one after the other; quickly fewer of them."""
    busy, learn = _others() > _BUSY, find_spec("stable_baselines3") is not None
    return [
        ("robots", lambda: _robot_rows(quick)),
        ("workers", lambda: _busy_workers() if busy else worker_rows(quick)),
        ("trainings", lambda: training_rows(quick) if learn else []),
        ("jobs", lambda: job_rows(ways_of_working(), quick)),
    ]


def _robot_rows(quick: bool) -> list[Row]:
    names = list(ROBOTS)[: 2 if quick else None]
    rows = [_robots(name, count, quick) for name in names for count in (1, _ROBOTS)]
    return [*rows, Row("robots", "arm", "GPU", failure="not measured")]


def _others() -> float:
    """Programs that run on this machine, or wait for it, per core; mean of the last minute."""
    return os.getloadavg()[0] / usable_cores()


def _busy_workers() -> list[Row]:
    """Rows without numbers, which would tell of the other programs."""
    own = {"cores": usable_cores(), "failure": "not measured: other programs ran"}
    return [Row("workers", name, **own) for name in ("processes", "Ray", "threads of a batch")]


def _robots(name: str, count: int, quick: bool) -> Row:
    """Robots in random motion, on one core."""
    env_id, robot = ROBOTS[name]
    options = {} if robot is None else {"robot": find_robot(robot), "task": "reach"}
    env = gymnasium.make_vec(env_id, num_envs=count, threads=1, **options)
    env.reset(seed=0)
    actions = _SHARE * np.random.default_rng(0).uniform(-1, 1, env.action_space.shape)
    seconds = min(
        block_time(lambda: env.step(actions), process_time) for _ in range(2 if quick else _TIMES)
    )
    period = env.control_period
    env.close()
    way = "one" if count == 1 else "batch"
    return Row("robots", name, way, cores=1, **cost_of(count * period / seconds))


STUDY = Study(
    kinds=(Row,),
    jobs=jobs,
    tables=[
        tabled("robots", "way", "robot_seconds", "core_hours", "cost", Column("", "failure")),
        tabled("workers", "cores", "efficiency", "started", Column("", "failure")),
        tabled(
            *("training", "physics", "python", "learner", "robot_seconds"),
            Column("USD per million", "cost", ".2g"),
        ),
        tabled("jobs", "seconds", "memory", "kept"),
        tabled("sweep", "cores", Column("USD an hour", "cost", ".0f"), "shortest_job"),
    ],
    note=f"A core-hour at {PRICE} USD is an assumption. The shortest job keeps {CORES} cores busy "
    "with one driver.",
    alone=True,
)
