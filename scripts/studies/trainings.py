"""Trained policies over several seeds, and what PPO learns with nobody's tuning."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

import gymnasium
import numpy as np

from softrobot_env.control.registry import make_policy, policy_environment
from softrobot_env.core.interfaces import Policy
from softrobot_env.evaluation.run import play
from softrobot_env.learned.network import Network
from softrobot_env.rendering.figures import COLOURS, REFERENCE, Axes, Figure, Style, style_of
from softrobot_env.rendering.learning import checks_figure
from softrobot_env.robots import ARM
from softrobot_env.training.artifacts import check
from softrobot_env.training.imitation import ImitationConfig, imitate
from softrobot_env.training.request import TrainingRequest
from softrobot_env.training.rl_config import DISTURBED, preset
from studies import lab

SEEDS = (0, 1, 2)

#: Processes that train at the same time, each on one core.
_PROCESSES = 2

# ---------------------------------------------------------------- presets over several seeds

IMITATION = "imitation"

#: Artifact or curve -> algorithm, whether it starts from the imitation of its seed, and whether
#: robots and disturbances vary broadly.
CASES = {
    "ppo": ("ppo", False, False),
    "sac": ("sac", False, False),
    "sac_randomized": ("sac", False, True),
    "ppo_tuned": ("ppo", True, False),
    "ppo_randomized": ("ppo", True, True),
}

#: What is trained one after the other, in one process: what starts from a network comes after it.
CHAINS = ((IMITATION, "ppo_tuned", "ppo_randomized"), ("ppo",), ("sac",), ("sac_randomized",))

#: All that is cut short in a quick run.
_QUICK_RL = {
    "steps": 2000,
    "critic_steps": 0,
    "envs_per_task": 1,
    "drawn_tasks": 1,
    "trials": ({},),
    "trial_duration": 0.2,
}
_QUICK_IMITATION = {"rounds": 1, "samples": 200, "shares": 1, "epochs": 1, "last_epochs": 1}


@dataclass(frozen=True)
class LearnedRow(lab.Record):
    """A training and closed-loop checks of its network.

    Attributes:
        policy, seed: What was trained.
        minutes: That it took.
        curve: Closed-loop checks during the training, see `watch.Point`.
        swing_max, lshape_max: Largest error [m] on the nominal robot.
        overshoot, settling_time: Of a step of 50 mm; None where it has none.
        worst_modulus: Largest error [m] on swing and L-shape with another Young's modulus.
        worst: The same with all other robots and disturbances as well.
        failures, trials: Numbers of failed episodes and of all.
    """

    policy: str
    seed: int
    minutes: float = lab.quantity()
    curve: list[dict[str, Any]]
    swing_max: float = lab.quantity("mm", label="swing max")
    lshape_max: float = lab.quantity("mm", label="L-shape max")
    overshoot: float | None = lab.quantity("%", label="step 50 mm: overshoot")
    settling_time: float | None = lab.quantity("s", label="settling")
    worst_modulus: float = lab.quantity("mm", label="E x 0.5 to 1.5: max")
    worst: float = lab.quantity("mm", label="disturbed: max")
    failures: int
    trials: int


def learning_cases(quick: bool) -> list[tuple]:
    """Names of a chain, seed, and whether all is cut short."""
    return [(chain, seed, quick) for seed in SEEDS[: 1 if quick else None] for chain in CHAINS]


def learn(case: tuple[tuple[str, ...], int, bool]) -> list[LearnedRow]:
    """Train and check what a chain names, one after the other."""
    from softrobot_env.training.rl import train

    names, seed, quick = case
    rows, start = [], None
    for name in names:
        began, curve = perf_counter(), []
        if name == IMITATION:
            short = _QUICK_IMITATION if quick else {}
            network = start = imitate(
                replace(ImitationConfig(), processes=0, **short), seed, lab.quiet
            )
        else:
            config = replace(preset(*CASES[name]), **(_QUICK_RL if quick else {}))
            order = TrainingRequest(ARM, Path(f"{name}.npz"), seed, {"checkpoint": None})
            network, curve = train(config, order, lab.quiet, start if CASES[name][1] else None)
        minutes = (perf_counter() - began) / 60
        rows.append(_checked(network, quick, policy=name, seed=seed, minutes=minutes, curve=curve))
    return rows


def _checked(network: Network, quick: bool, **own: Any) -> LearnedRow:
    """Figures of a network, on the nominal robot and on others."""
    rows = check(network, ({},) if quick else DISTURBED, 0.2 if quick else None)
    tracking = {label: row.e_max for label, row in rows.items() if row.step is None}
    moduli = [e for label, e in tracking.items() if "," not in label or "youngs_modulus" in label]
    step = rows["step 50 mm"].step
    return LearnedRow(
        swing_max=tracking["swing"],
        lshape_max=tracking["lshape"],
        overshoot=step.overshoot,
        settling_time=step.settling_time,
        worst_modulus=max(moduli),
        worst=max(tracking.values()),
        failures=sum(row.failure is not None for row in rows.values()),
        trials=len(rows),
        **own,
    )


def _in_order(rows: list[LearnedRow]) -> list[LearnedRow]:
    order = (IMITATION, *CASES)
    return sorted(rows, key=lambda row: (order.index(row.policy), row.seed))


_CHECKS = (
    "Closed-loop checks: swing, L-shape and steps of 50, 100 and 200 mm, nominal, Young's modulus "
    "x 0.5 and 1.5, and (disturbed) density x 0.6, damping x 0.5, tension gain 0.9, friction "
    "0.5 N, delay 10 ms, sensor noise 1 as well. The best network of a training was chosen by the "
    "first kinds of checks, of a randomised one by all. Failed checks count up to their failure. "
    "Minutes on one core, two trainings at a time; a warm training comes after its imitation."
)
_CURVES = (
    "Checks of the mean action during training, swing and L-shape also with E x 0.5 and x 1.5: "
    "median and range of the seeds"
)


def _learning_curves(rows: list[LearnedRow]) -> Figure:
    learned = lab.groups((row for row in rows if row.curve), "policy")
    return checks_figure(
        {name: (style_of(name), [row.curve for row in mine]) for (name,), mine in learned.items()},
        _CURVES,
    )


LEARNING = lab.Study(
    kinds=(LearnedRow,),
    cases=learning_cases,
    measure=learn,
    derive=_in_order,
    processes=_PROCESSES,
    tables=[
        lab.pivot(f"{title}: median of the seeds (least to largest)", ("policy",), columns)
        for title, columns in {
            "nominal robot": ("swing_max", "lshape_max", "overshoot", "settling_time"),
            "other robots, disturbances, cost": ("worst_modulus", "worst", "failures", "minutes"),
        }.items()
    ],
    note=_CHECKS,
    plots={"{}": _learning_curves},
)

# ---------------------------------------------------------------- PPO as it comes

#: Environments side by side. More of them make fewer updates of as many steps.
ENVIRONMENTS = 4

#: Steps of a training; stable-baselines3 goes on to the end of the last rollout.
STEPS = 200_000

#: Rollouts between two checks.
_BETWEEN = 3

#: Seed of the first episode that policies are compared on; none of a training has it.
_FIRST_EPISODE = 10_000


@dataclass(frozen=True)
class Goal:
    """An environment, and the error to undercut.

    Attributes:
        env_id: Of the environment.
        goal: [m], mean error, or the policy whose mean error on the same episodes it is.
        episodes: On which it counts; one where all are alike.
        options: Of the environment.
    """

    env_id: str
    goal: float | str
    episodes: int = 1
    options: dict[str, Any] = field(default_factory=dict)


GOALS = {
    "ArmStep": Goal("SoftRobot/ArmStep-v0", 1e-3),
    "ArmSwing": Goal("SoftRobot/ArmSwing-v0", 5e-3),
    "RigReach": Goal("SoftRobot/RigReach-v0", "rig_nn", 5),
    "hanging_trunk": Goal(
        "SoftRobot/Track-v0", "static", 1, {"robot": "hanging_trunk", "task": "circle"}
    ),
}


@dataclass(frozen=True)
class DefaultsRow(lab.Record):
    """A training.

    Attributes:
        case: Name of the environment.
        seed: Of the training.
        steps: That it took, of all environments together.
        error: Mean error of the mean action after it; None if an episode failed.
        goal: Mean error to undercut.
        goal_policy: The policy whose error that is, on the same episodes; None for a number.
        minutes: That it took, checks included.
        curve: Steps and mean error [m] before, during and after it.
    """

    case: str
    seed: int = lab.quantity(form="d")
    steps: int = lab.quantity(form="d")
    error: float | None = lab.quantity("mm", ".3g", "mean error")
    goal: float = lab.quantity("mm", ".3g")
    goal_policy: str | None
    minutes: float = lab.quantity(form=".2g")
    curve: list[tuple[int, float | None]]

    @property
    def good(self) -> bool:
        """Whether the goal is undercut."""
        return self.error is not None and self.error < self.goal


def mean_error(env: gymnasium.Env, policy: Policy, episodes: int) -> float:
    """Mean error [m] of a policy over all instants of some episodes, infinite if one failed."""
    seeds = range(_FIRST_EPISODE, _FIRST_EPISODE + episodes)
    moments = [moment for seed in seeds for moment in [*play(env, policy, seed)][1:]]
    failed = any(moment.failed for moment in moments)
    return np.inf if failed else float(np.mean([moment.info["error"] for moment in moments]))


def goal_of(goal: Goal) -> float:
    """The mean error [m] to undercut."""
    if not isinstance(goal.goal, str):
        return goal.goal
    env = gymnasium.make(goal.env_id, **goal.options, **policy_environment(goal.goal))
    return mean_error(env, make_policy(goal.goal, env), goal.episodes)


def train_ppo(
    env: Any, seed: int, steps: int, check: Callable | None = None, **settings: Any
) -> tuple[Any, list[tuple[int, float]]]:
    """Train a policy by PPO with default settings, on one core.

    Args:
        env: Environments of stable-baselines3, with observations that are vectors.
        seed: Of everything random.
        steps: Of all environments together; the last rollout is finished.
        check: From a policy to a figure of what was learned.
        **settings: Of PPO, others than its default.

    Returns:
        The policy; steps and figure before the training, after every few rollouts, and after it.
    """
    import torch
    from stable_baselines3 import PPO

    torch.set_num_threads(1)
    model = PPO("MlpPolicy", env, seed=seed, device="cpu", **settings)
    if check is None:
        return model.learn(steps), []
    between, curve = _BETWEEN * model.n_steps * model.n_envs, [(0, check(model))]
    while model.num_timesteps < steps:
        model.learn(min(between, steps - model.num_timesteps), reset_num_timesteps=False)
        curve.append((model.num_timesteps, check(model)))
    return model, curve


def train_defaults(case: tuple[str, int, bool]) -> DefaultsRow:
    """Train in the environment of a name with a seed; quick: one rollout and one episode."""
    from softrobot_env.training.vec_env import make_vec_env

    name, seed, quick = case
    goal = replace(GOALS[name], episodes=1) if quick else GOALS[name]
    options = goal.options | {"observe_as": "vector"}
    env, began = gymnasium.make(goal.env_id, **options), perf_counter()
    training = make_vec_env(goal.env_id, ENVIRONMENTS, threads=1, **options)
    error_of = partial(mean_error, env, episodes=goal.episodes)
    _, found = train_ppo(training, seed, 1 if quick else STEPS, error_of)
    training.close()
    minutes = (perf_counter() - began) / 60
    curve = [(step, error if error < float("inf") else None) for step, error in found]
    policy = goal.goal if isinstance(goal.goal, str) else None
    return DefaultsRow(name, seed, *curve[-1], goal_of(goal), policy, minutes, curve)


def _goal_line(axis: Axes, rows: list[DefaultsRow], name: str) -> None:
    axis.axhline(1e3 * rows[0].goal, **REFERENCE)


def _defaults_curves(rows: list[DefaultsRow]) -> Figure | None:
    """The mean error over environment steps, each seed a line, and the goal."""
    good = sum(row.good for row in rows)
    return lab.lines(
        "steps",
        "error",
        "seed",
        title=f"PPO with its default settings reaches the goal in {good} of {len(rows)} trainings",
        subject="Colours: seeds; crosses: a failed episode; dashes: the goal",
        panel="case",
        log="y",
        style=lambda seed: Style(COLOURS[seed]),
        columns=4,
        size=(2.7, 2.7),
        decorate=_goal_line,
    )([replace(row, steps=k, error=error) for row in rows for k, error in row.curve])


PPO_DEFAULTS = lab.Study(
    kinds=(DefaultsRow,),
    cases=lambda quick: [(name, k, quick) for name in GOALS for k in SEEDS[: 1 if quick else None]],
    measure=train_defaults,
    processes=_PROCESSES,
    tables=[
        lab.table(
            "PPO as stable-baselines3 comes, from nothing",
            lab.Column("environment", "case"),
            "seed",
            "steps",
            "error",
            "goal",
            lab.Column("goal is", lambda row: row.goal_policy or "given"),
            lab.Column("met", lambda row: lab.verdict(row.good), ">"),
            "minutes",
        )
    ],
    note=f'PPO("MlpPolicy", env) on {ENVIRONMENTS} environments of make_vec_env(id, '
    f'{ENVIRONMENTS}, observe_as="vector"). Mean error over whole episodes, the first instants of '
    "a step included, of the mean action; a goal that is a policy is its mean error on the same "
    "episodes.",
    plots={"{}": _defaults_curves},
)
