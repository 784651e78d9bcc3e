"""The rows of the speed benchmark as tables."""

from rich.console import Group

from softrobot_env.benchmarks.speed import warp
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
_MOVING = (
    Column("random steps of the action\nby half of its range, 0.1 s", "variant"),
    Column("accuracy %", lambda row: number(100 * row.accuracy, ".3g"), ">"),
    Column("steps/s", "steps_per_second", ".0f"),
    Column("error mm", "error", ".3f", "mm"),
    Column("estimate\nmm", "estimate", ".3f", "mm"),
)
_ROBOTS = (
    Column("env.step, moving", "variant"),
    Column("DOF", "dof", "d"),
    Column("robots x\nthreads", lambda row: f"{row.n_envs} x {row.threads}", ">"),
    Column("µs a robot\nand period", "seconds", ".1f", "µs"),
    Column("periods/s", "steps_per_second", ".0f"),
    Column("bare/s", "raw_steps_per_second", ".0f"),
    Column("bare/\nenv", "ratio", ".2f"),
)
_DECISIONS = (
    Column("policy", "variant"),
    Column("period\nms", lambda row: number(1e3 * row.period, "g"), ">"),
    Column("decision µs,\nmedian", "seconds", ".1f", "µs"),
    Column("longest ms\nof computing", "longest", ".3f", "ms"),
    Column("256 stacked\nms", "stacked", ".2f", "ms"),
)
_SCALING = (
    Column("several cores", "variant"),
    Column("cores", "threads", "d"),
    Column("efficiency", "efficiency", ".2f"),
    Column("ready\nafter s", lambda row: number(row.started, ".1f", missing="-"), ">"),
    Column("job or\nstep s", "seconds", ".2g"),
)
_WARP = (
    Column("many arms on MuJoCo Warp", "variant"),
    Column("robots", "n_envs", "d"),
    Column("steps/s", lambda row: number(row.steps_per_second, ".0f", missing="-"), ">"),
)
_WAITS = (
    Column("", "variant"),
    Column("ms", lambda row: number(row.seconds, ".1f", "ms", missing="no OpenGL"), ">"),
)


def tables(rows: list[Row]) -> Group:
    """Steps, arms on Warp, a moving arm by accuracy, batches, decisions, several cores, waits."""
    moving = [row for row in rows if row.accuracy is not None]
    robots = [row for row in rows if row.dof is not None]
    decisions = [row for row in rows if row.period is not None]
    scaling = [row for row in rows if row.efficiency is not None]
    warped = [row for row in rows if row.what == warp.WHAT]
    others = moving + robots + decisions + scaling + warped
    waits = [row for row in rows if row.steps_per_second is None and row not in others]
    steps = [row for row in rows if row not in others + waits]
    parts = (
        (_STEPS, steps),
        (_WARP, warped),
        (_MOVING, moving),
        (_ROBOTS, robots),
        (_DECISIONS, decisions),
        (_SCALING, scaling),
        (_WAITS, waits),
    )
    return Group(*(make_table("", columns, kind) for columns, kind in parts if kind))
