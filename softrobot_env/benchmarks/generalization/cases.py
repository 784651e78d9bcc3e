"""Episodes of the generalization benchmark, and their rows."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from softrobot_env.beams.registry import MUJOCO
from softrobot_env.benchmarks.controllers.cases import policies as known_policies
from softrobot_env.control.registry import installed_policies, make_policy, policy_environment
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation.labels import variation_label
from softrobot_env.evaluation.report import make_row
from softrobot_env.evaluation.run import run_episode, warm_up
from softrobot_env.tasks import Task, make_task

Row = dict[str, Any]
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


@dataclass(frozen=True)
class Case:
    """One episode to run.

    Attributes:
        part: One of `PARTS`.
        policy: Name of the policy.
        task: Name of the task.
        speed: [m/s] of an unseen task.
        path_seed: Of a random path.
        step_width: [m] of a step.
        variation: Of robot, drives and sensors, see the reset option `vary`.
    """

    part: str
    policy: str
    task: str
    speed: float | None = None
    path_seed: int | None = None
    step_width: float | None = None
    variation: Variation = field(default_factory=dict)

    @property
    def label(self) -> str:
        """For the progress bar."""
        return f"{self.policy}, {self.make_task().label}, {variation_name(self.variation)}"

    def make_task(self) -> Task:
        """The task."""
        return make_task(self.task, self.step_width, speed=self.speed, seed=self.path_seed)


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
                yield from (Case("unseen", name, task, speed, seed) for name in names)
    every = (NOMINAL, *PARAMETERS, *DISTURBANCES)
    for task, width in TASKS:
        for variation in _QUICK_VARIATIONS.get(task, ()) if quick else every:
            yield from (
                Case("disturbed", name, task, step_width=width, variation=variation)
                for name in names
            )


def _seeds(task: str, quick: bool) -> Sequence[int | None]:
    if task != "random":
        return (None,)
    return _QUICK_SEEDS if quick else SEEDS


def run_case(case: Case) -> Row:
    """Run an episode; see `generalization.run` for the row."""
    task = case.make_task()
    env = TrackingEnv(task, observe="all", **policy_environment(case.policy))
    policy = make_policy(case.policy, task.robot, env.control_period)
    warm_up(env, policy)
    options: dict[str, object] = {"vary": case.variation}
    if case.step_width is not None:
        options["duration"] = STEP_DURATION
    rollout = run_episode(env, policy, seed=0, options=options)
    row = make_row(rollout, task, case.policy, MUJOCO, case.variation)
    row |= {"part": case.part, "speed": case.speed, "path_seed": case.path_seed, "seed": 0}
    row["decision_period"] = policy.hold * env.control_period
    failed = rollout.failure is not None
    return row | {"tension_max": None if failed else float(rollout.tendon_tension.max())}
