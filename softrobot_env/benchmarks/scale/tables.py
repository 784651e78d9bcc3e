"""The rows of the scale benchmark as tables."""

from rich.console import Group

from softrobot_env.benchmarks.records import select
from softrobot_env.benchmarks.scale.rows import CORES, PRICE, Row
from softrobot_env.rendering.tables import Column, make_table, number

_ROBOTS = (
    Column("robots", "variant"),
    Column("on", "way"),
    Column("robot-s per core-s", "robot_seconds", ".3g"),
    Column("core-h per million", "core_hours", ".3g"),
    Column("USD", "cost", ".2g"),
    Column("", "failure"),
)
_WORKERS = (
    Column("workers", "variant"),
    Column("cores", form="d"),
    Column("efficiency", form=".2f"),
    Column("ready after s", lambda row: number(row.started, ".1f"), ">"),
    Column("", "failure"),
)
_TRAINING = (
    Column("training", "variant"),
    Column("physics %", "physics", ".0f", "%"),
    Column("Python %", "python", ".0f", "%"),
    Column("learner %", "learner", ".0f", "%"),
    Column("robot-s per core-s", "robot_seconds", ".3g"),
    Column("USD per million", "cost", ".2g"),
)
_JOBS = (
    Column("jobs", "variant"),
    Column("ms the driver computes", "seconds", ".2f", "ms"),
    Column("kB in the driver", lambda row: number(row.memory / 1e3, ".1f"), ">"),
    Column("kB kept", lambda row: number(row.kept / 1e3, ".2f"), ">"),
)
_SWEEP = (
    Column("sweep", "variant"),
    Column("cores", form="d"),
    Column("USD an hour", "cost", ".0f"),
    Column("shortest job s", "shortest_job", ".2g"),
)


def tables(rows: list[Row]) -> Group:
    """A table of each kind of row."""
    parts = {
        "robots": _ROBOTS,
        "workers": _WORKERS,
        "training": _TRAINING,
        "jobs": _JOBS,
        "sweep": _SWEEP,
    }
    found = [(columns, select(rows, what=what)) for what, columns in parts.items()]
    note = (
        f"A core-hour at {PRICE} USD is an assumption. The shortest job keeps {CORES} cores busy "
        "with one driver."
    )
    return Group(*(make_table("", columns, mine) for columns, mine in found if mine), note)
