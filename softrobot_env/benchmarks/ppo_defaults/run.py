"""PPO with the default settings of stable-baselines3 on every kind of robot, over three seeds."""

from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter

from softrobot_env.benchmarks.ppo_defaults.cases import CASES, Case, goal_of, train_case
from softrobot_env.benchmarks.records import Record
from softrobot_env.core.jobs import Progress, run_in_processes

SEEDS = (0, 1, 2)

#: Steps of a training; stable-baselines3 goes on to the end of the last rollout.
STEPS = 200_000

#: Processes that train at the same time, each on one core.
_PROCESSES = 2


@dataclass(frozen=True)
class Row(Record):
    """A training.

    Attributes:
        case: Name of the environment.
        seed: Of the training.
        steps: That it took, of all environments together.
        error: [m], mean error of the mean action after it; None if an episode failed.
        goal: [m], mean error to undercut.
        goal_policy: The policy whose error that is, on the same episodes; None for a number.
        minutes: That it took, checks included.
        curve: Steps and mean error [m] before, during and after it.
    """

    case: str
    seed: int
    steps: int
    error: float | None
    goal: float
    goal_policy: str | None
    minutes: float
    curve: list[tuple[int, float | None]]

    @property
    def good(self) -> bool:
        """Whether the goal is undercut."""
        return self.error is not None and self.error < self.goal


def run(quick: bool, progress: Progress | None = None) -> list[Row]:
    """A row per environment and seed.

    Args:
        quick: One rollout and one episode each, which shows that everything works and nothing else.
        progress: Told what is done.
    """
    seeds, steps, less = (SEEDS[:1], 1, {"episodes": 1}) if quick else (SEEDS, STEPS, {})
    tasks = [
        (f"{name}, seed {seed}", partial(_row, name, replace(case, **less), seed, steps))
        for name, case in CASES.items()
        for seed in seeds
    ]
    return run_in_processes(tasks, progress, _PROCESSES)


def _row(name: str, case: Case, seed: int, steps: int) -> Row:
    began = perf_counter()
    found = train_case(case, seed, steps)
    minutes = (perf_counter() - began) / 60
    curve = [(step, error if error < float("inf") else None) for step, error in found]
    return Row(
        case=name,
        seed=seed,
        steps=curve[-1][0],
        error=curve[-1][1],
        goal=goal_of(case),
        goal_policy=case.goal if isinstance(case.goal, str) else None,
        minutes=minutes,
        curve=curve,
    )
