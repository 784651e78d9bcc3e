"""Random scenes at the package's own choice of integrator and timestep: is any silently wrong?

Every scene runs as an environment would step it, and is judged by refined runs of the same chain,
see `benchmarks.scenes.judge`.
"""

from functools import partial

from softrobot_env.benchmarks.scenes.draw import draw_scene
from softrobot_env.benchmarks.scenes.judge import judge
from softrobot_env.benchmarks.scenes.rows import Row
from softrobot_env.core.jobs import Progress, run_in_processes

#: Number of scenes, and of a quick run.
COUNT, QUICK_COUNT = 200, 20


def run(
    quick: bool = False, progress: Progress | None = None, count: int | None = None, seed: int = 0
) -> list[Row]:
    """Judge random scenes, in a process for each core.

    Args:
        quick: `QUICK_COUNT` scenes.
        progress: Called with (description, done, total), or None.
        count: Number of scenes; `COUNT` unless given or quick.
        seed: What they are drawn from; a larger count adds scenes to the same ones.

    Returns:
        A row per scene, in their order.
    """
    count = (QUICK_COUNT if quick else COUNT) if count is None else count
    tasks = [(f"scene {index}", partial(judged, seed, index)) for index in range(count)]
    return run_in_processes(tasks, progress)


def judged(seed: int, index: int) -> Row:
    """The row of one random scene."""
    return judge(draw_scene(seed, index))
