"""Grips of the thesis' objects, sizes told by curvatures, holds, and what they cost."""

from functools import partial
from importlib.util import find_spec

from softrobot_env.benchmarks.gripper.episodes import MIDDLE, QUICK, RULE, outcomes, sizes, speeds
from softrobot_env.benchmarks.gripper.grips import grips, things
from softrobot_env.benchmarks.jobs import Progress, run_in_processes
from softrobot_env.benchmarks.records import Record

#: Policies that hold, and that enclose.
HOLDERS = ("scripted 20 N", "scripted 30 N", "scripted 40 N", "sized")
CLOSERS = ("scripted 12 N", "scripted 16 N", "scripted 20 N")

#: Steps with which reinforcement learning is trained to enclose.
LEARNED = 80_000

#: Bars that sizes are fitted to and tested on, held bars, and those held with the rule's timestep.
EXAMPLES, TESTED, HELD, HELD_BY_RULE = 300, 60, 200, 20


def run(quick: bool = False, progress: Progress | None = None) -> list[Record]:
    """Measure, in a process for each core.

    Args:
        quick: Few bars, and coarse fingers.
        progress: Called with (description, done, total), or None.
    """
    tasks = _quick() if quick else _whole()
    return [row for rows in run_in_processes(tasks, progress) for row in rows]


def _quick() -> list:
    name = next(iter(things()))
    return [
        ("grips", partial(grips, name, 4.0, 6)),
        ("sizes", partial(sizes, QUICK, QUICK, 60, 20)),
        ("hold", partial(outcomes, QUICK, "hold", "scripted 30 N", 20)),
        ("speed", partial(speeds, "hold", (QUICK,), 4)),
    ]


def _whole() -> list:
    tasks = [(name, partial(grips, name)) for name in things()]
    tasks += [
        (f"sizes, {label}", partial(sizes, MIDDLE, test, EXAMPLES, TESTED))
        for label, test in (("as fitted", MIDDLE), ("rule", RULE))
    ]
    tasks += [(f"hold, {p}", partial(outcomes, MIDDLE, "hold", p, HELD, EXAMPLES)) for p in HOLDERS]
    tasks.append(("hold, rule", partial(outcomes, RULE, "hold", "scripted 30 N", HELD_BY_RULE)))
    tasks += [(f"enclose, {p}", partial(outcomes, QUICK, "enclose", p, HELD)) for p in CLOSERS]
    if find_spec("stable_baselines3") is not None:
        tasks.append(("ppo", partial(outcomes, QUICK, "enclose", "ppo", HELD, LEARNED)))
    settings = (RULE, MIDDLE, QUICK)
    return tasks + [(f"speed, {t}", partial(speeds, t, settings, 16)) for t in ("enclose", "hold")]
