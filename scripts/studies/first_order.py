"""What first-order learning reaches in a tenth of the steps that PPO takes, in the same tasks."""

from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from softrobot_env.control.learned.neural import NeuralPolicy
from softrobot_env.envs.tracking import TrackingEnv
from softrobot_env.evaluation import stored
from studies import lab
from studies.trainings import SEEDS, DefaultsRow, mean_error

#: Case of the study of PPO -> task of the environment.
CASES = {"ArmStep": "step", "ArmSwing": "swing"}

#: Its committed report.
PPO = Path(__file__).resolve().parents[2] / "docs" / "results" / "ppo_defaults"


@dataclass(frozen=True)
class FirstOrderRow(lab.Record):
    """A training.

    Attributes:
        case: Name of the environment.
        seed: Of the training.
        steps: That it took.
        error: Mean error over an episode after it.
        ppo_steps: That PPO took.
        ppo_least, ppo_most: Mean errors of its seeds.
        minutes: That the training took, on one core.
    """

    case: str
    seed: int = lab.quantity(form="d")
    steps: int = lab.quantity(form="d")
    error: float = lab.quantity("mm", ".3g", "mean error")
    ppo_steps: int = lab.quantity(form="d", label="PPO's steps")
    ppo_least: float = lab.quantity("mm", ".3g", "its least")
    ppo_most: float = lab.quantity("mm", ".3g", "largest")
    minutes: float = lab.quantity(form=".2g")

    @property
    def good(self) -> bool:
        """Whether it is as good as PPO's worst seed, in a tenth of its steps."""
        return self.error <= self.ppo_most and 10 * self.steps <= self.ppo_steps


def train(case: tuple[str, int, bool]) -> FirstOrderRow:
    """Train on the task of a name with a seed; quick: a few steps."""
    from softrobot_env.training.first_order import QUICK, Course, FirstOrderConfig
    from softrobot_env.training.first_order import train as learn

    name, seed, quick = case
    config, began = FirstOrderConfig(**(QUICK if quick else {})), perf_counter()
    course, steps = Course(CASES[name]), []
    network = learn([course], config, seed, watch=lambda count, network: steps.append(count))
    minutes = (perf_counter() - began) / 60
    reading = course.env.reading
    policy = NeuralPolicy(course.env.task.robot, float(reading.period), network, view=reading)
    env = TrackingEnv(CASES[name], observe=policy.requires, **reading.environment)
    ppo = [row for row in stored.read(PPO, (DefaultsRow,)) if row.case == name]
    errors = [row.error for row in ppo]
    found = mean_error(env, policy, 1), ppo[0].steps, min(errors), max(errors)
    return FirstOrderRow(name, seed, steps[-1], *found, minutes)


STUDY = lab.Study(
    kinds=(FirstOrderRow,),
    cases=lambda quick: [(name, k, quick) for name in CASES for k in SEEDS[: 1 if quick else None]],
    measure=train,
    tables=[
        lab.table(
            "First-order learning from nothing, and PPO",
            lab.Column("environment", "case"),
            "seed",
            "steps",
            "error",
            "ppo_steps",
            "ppo_least",
            "ppo_most",
            lab.Column("reached", lambda row: lab.verdict(row.good), ">"),
            "minutes",
        )
    ],
    note='softrobot train shac, on the environment itself as `observe_as="vector"` shows it. Mean '
    "error over a whole episode of the network after the last step; that of PPO with its default "
    "settings is that of the report of ppo_defaults, least and largest of three seeds. Reached: "
    "at most the largest of these, in at most a tenth of the steps.",
)
