"""The rows of the scale benchmark."""

from dataclasses import dataclass

from softrobot_env.benchmarks.records import Record

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
        kept: [B] of a kept result, in a file of its own.
        shortest_job: [s], the shortest one with which one driver keeps all cores busy.
        failure: Why there is no number.
    """

    what: str
    variant: str
    way: str | None = None
    robot_seconds: float | None = None
    core_hours: float | None = None
    cost: float | None = None
    price: float | None = None
    cores: int | None = None
    efficiency: float | None = None
    started: float | None = None
    physics: float | None = None
    python: float | None = None
    learner: float | None = None
    seconds: float | None = None
    memory: float | None = None
    kept: float | None = None
    shortest_job: float | None = None
    failure: str | None = None


def cost_of(robot_seconds: float) -> dict[str, float]:
    """Fields of a row for robot-seconds [1] per core-second."""
    hours = 1e6 / robot_seconds / 3600
    return {
        "robot_seconds": robot_seconds,
        "core_hours": hours,
        "cost": hours * PRICE,
        "price": PRICE,
    }
