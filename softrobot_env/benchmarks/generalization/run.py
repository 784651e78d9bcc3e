"""All policies on references that they have not met, and on robots that they do not know."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from softrobot_env.benchmarks.episodes import EpisodeRecord, record_of
from softrobot_env.benchmarks.episodes import policies as known_policies
from softrobot_env.control.registry import installed_policies
from softrobot_env.core.jobs import Progress, run_in_processes
from softrobot_env.evaluation import runner
from softrobot_env.evaluation.labels import variation_label
from softrobot_env.evaluation.runner import Case
from softrobot_env.tasks import make_task

Variation = dict[str, float]

#: Paths that no policy has met; the thesis' tasks on robots that no policy knows.
PARTS = ("unseen", "disturbed")

#: Largest speeds [m/s] of the unseen references.
SPEEDS = {
    "circle": (0.05, 0.1, 0.2, 0.4),
    "figure_eight": (0.05, 0.1, 0.2, 0.4),
    "random": (0.1, 0.2, 0.4),
}
SEEDS = (0, 1, 2, 3, 4)

#: Task and step width [m] of the disturbed robots.
TASKS = (("swing", None), ("lshape", None), ("step", 0.05))

#: Duration [s] of a step, in which the slow policies settle too.
STEP_DURATION = 10.0

#: What the reset option `vary` gets, in the groups of the tables. A tendon radius acts as a tension
#: gain does on the lever arms of channels, and is left out.
PARAMETERS: tuple[Variation, ...] = (
    {"youngs_modulus": 0.5},
    {"youngs_modulus": 0.75},
    {"youngs_modulus": 1.25},
    {"youngs_modulus": 1.5},
    {"density": 0.6},
    {"density": 1.5},
    {"damping_time": 0.5},
    {"damping_time": 2.0},
)
DISTURBANCES: tuple[Variation, ...] = (
    {"tension_gain": 0.9},
    {"tension_gain": 1.1},
    {"tendon_friction": 0.5},
    {"tendon_friction": 1.0},
    {"delay": 0.01},
    {"delay": 0.02},
    {"sensor_noise": 1.0},
    {"sensor_noise": 3.0},
)
NOMINAL: Variation = {}

_QUICK_SPEED, _QUICK_SEEDS = 0.2, (0, 1)
_QUICK_VARIATIONS: dict[str, tuple[Variation, ...]] = {
    "swing": (NOMINAL, {"youngs_modulus": 0.5}),
    "step": (NOMINAL, {"delay": 0.02}),
}


@dataclass(frozen=True, kw_only=True)
class Row(EpisodeRecord):
    """An episode.

    Attributes:
        part: One of `PARTS`.
        speed: [m/s], the largest of an unseen reference.
        path_seed: Of a random path.
        seed: Of the episode.
    """

    part: str
    speed: float | None
    path_seed: int | None
    seed: int = 0


def run(quick: bool = False, progress: Progress | None = None) -> list[Row]:
    """Run all policies in all cases, one process per core.

    Args:
        quick: Fewer speeds, seeds, tasks and variations.
        progress: Called with (description, done, total), or None.

    Returns:
        Rows of the episodes. Policy times are those of cores that are all busy.
    """
    return run_cases(list(cases(quick)), progress)


def run_cases(
    wanted: Sequence[Case], progress: Progress | None = None, processes: int | None = None
) -> list[Row]:
    """Rows of cases in their order, run in `processes` processes, one per core unless given."""
    tasks = [(case.label, partial(run_case, case)) for case in wanted]
    return run_in_processes(tasks, progress, processes)


def variation_name(variation: Variation) -> str:
    """A variation for people."""
    return variation_label({"variation": variation}) or "nominal"


def policies() -> list[str]:
    """The installed policies, the thesis' first, without the one that does nothing."""
    return [name for name in known_policies() if name in installed_policies()]


def cases(quick: bool = False) -> Iterator[Case]:
    """Every episode of the benchmark."""
    names = policies()
    for task, speeds in SPEEDS.items():
        for speed in (_QUICK_SPEED,) if quick else speeds:
            for seed in _seeds(task, quick):
                yield from (unseen(name, task, speed, seed) for name in names)
    every = (NOMINAL, *PARAMETERS, *DISTURBANCES)
    for task, width in TASKS:
        for variation in _QUICK_VARIATIONS.get(task, ()) if quick else every:
            yield from (disturbed(name, task, width, variation) for name in names)


def _seeds(task: str, quick: bool) -> Sequence[int | None]:
    if task != "random":
        return (None,)
    return _QUICK_SEEDS if quick else SEEDS


def unseen(policy: str, task: str, speed: float, path_seed: int | None = None) -> Case:
    """An episode on a path that no policy has met, with its largest speed [m/s]."""
    options = {"speed": speed} | ({} if path_seed is None else {"seed": path_seed})
    return Case(make_task(task, **options), policy)


def disturbed(policy: str, task: str, width: float | None, variation: Variation) -> Case:
    """An episode on a robot that no policy knows; a step has a width [m]."""
    duration = None if width is None else STEP_DURATION
    return Case(make_task(task, width), policy, variation, duration=duration)


def run_case(case: Case) -> Row:
    """Run an episode."""
    speed, seed = case.task.option("speed"), case.task.option("seed")
    part = "disturbed" if speed is None else "unseen"
    return record_of(runner.run(case), Row, part=part, speed=speed, path_seed=seed)
