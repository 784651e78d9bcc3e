"""Grips of the thesis' objects, sizes told by curvatures, holds, and what they cost."""

from functools import partial
from importlib.util import find_spec

from softrobot_env.benchmarks.gripper.episodes import outcomes, sizes, speeds
from softrobot_env.benchmarks.gripper.grips import grips, things
from softrobot_env.benchmarks.gripper.rows import Grip, Outcome, Shape, Size, Speed
from softrobot_env.core.jobs import Progress, run_in_processes

Row = Grip | Size | Shape | Outcome | Speed

#: Policies that hold, and that enclose.
HOLDERS = ("scripted 20 N", "scripted 30 N", "scripted 40 N", "sized")
CLOSERS = ("scripted 12 N", "scripted 16 N", "scripted 20 N")

#: Steps with which reinforcement learning is trained to enclose and to hold.
LEARNED = {"enclose": 80_000, "hold": 80_000}

#: Imperfections of sensors, over the usual ones; None of exact bends.
SCALES = None, 0.0, 1.0, 2.0

#: Bars that sizes are fitted to and tested on, held bars, and those told and held by the rule.
EXAMPLES, TESTED, HELD, TESTED_BY_RULE, HELD_BY_RULE = 300, 100, 200, 40, 60

#: Grippers at once, on so many threads.
MANY, THREADS = 64, (1, 2, 4)


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Measure, in a process for each core; what needs several threads by itself.

    Args:
        quick: Few bars, and coarse fingers.
        progress: Called with (description, done, total), or None.
    """
    tasks = _quick() if quick else _whole()
    rows = [row for rows in run_in_processes(tasks, progress) for row in rows]
    return rows if quick else rows + [r for t in LEARNED for r in speeds(t, MANY, THREADS)]


def _quick() -> list:
    name = next(iter(things()))
    return [
        ("grips", partial(grips, name, 4.0, 6)),
        ("sizes", partial(sizes, "quick", "quick", "enclose", 40, 10, (None, 1.0))),
        ("hold", partial(outcomes, "quick", "hold", "scripted 30 N", 20)),
        ("speed", partial(speeds, "enclose", 4, (1,))),
    ]


def _whole() -> list:
    by_rule = partial(sizes, "quick", "rule", "enclose", EXAMPLES, TESTED_BY_RULE, SCALES[::2])
    tasks = [("sizes, rule", by_rule)]
    tasks.append(("hold, rule", partial(outcomes, "rule", "hold", "scripted 30 N", HELD_BY_RULE)))
    if find_spec("stable_baselines3") is not None:
        tasks += [
            (f"ppo, {task}", partial(outcomes, "quick", task, "ppo", HELD, steps))
            for task, steps in LEARNED.items()
        ]
    tasks += [
        (f"sizes, {task}", partial(sizes, "quick", "quick", task, EXAMPLES, TESTED, SCALES))
        for task in LEARNED
    ]
    tasks += [(name, partial(grips, name)) for name in things()]
    tasks += [
        (f"hold, {p}", partial(outcomes, "quick", "hold", p, HELD, EXAMPLES)) for p in HOLDERS
    ]
    return tasks + [
        (f"enclose, {p}", partial(outcomes, "quick", "enclose", p, HELD)) for p in CLOSERS
    ]
