"""The rows of the speed benchmark as tables."""

from rich.console import Group

from softrobot_env.benchmarks.speed.rows import Row
from softrobot_env.rendering.tables import Column, make_table, number

_STEPS = (
    Column("", "variant"),
    Column("envs x\nthreads", lambda row: f"{row.n_envs} x {row.threads}", ">"),
    Column("steps/s", "steps_per_second", ".0f"),
    Column("raw/s", "raw_steps_per_second", ".0f"),
    Column("raw/\nenv", "ratio", ".2f"),
    Column("over-\nhead µs", "overhead", ".1f", "µs"),
    Column("over-\nhead\nratio", "overhead_ratio", ".2f"),
)
_WAITS = (
    Column("", "variant"),
    Column("ms", lambda row: number(row.seconds, ".1f", "ms", missing="no OpenGL"), ">"),
)


def tables(rows: list[Row]) -> Group:
    """One table of steps, one of waiting times."""
    steps = [row for row in rows if row.steps_per_second is not None]
    waits = [row for row in rows if row.steps_per_second is None]
    return Group(make_table("", _STEPS, steps), make_table("", _WAITS, waits))
