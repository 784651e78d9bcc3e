"""Settings of reinforcement learning, and the ones that the shipped policies were trained with."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from softrobot_env.core.records import Count, Positive, Range, Whole, check_fields
from softrobot_env.envs.randomization import Randomization, incompatibility
from softrobot_env.robots import RobotParams

#: What an agent can be trained on: the thesis' tasks, and random references by
#: `references.draw_reference`; and of another robot: what any robot can be given.
TRAINING_TASKS = ("step", "swing", "lshape", "drawn")
ROBOT_TASKS = ("random", "circle", "figure_eight", "reach")

TASKS_OF = (TRAINING_TASKS, ROBOT_TASKS)

#: Networks to start from: that which imitates, or none.
IMITATION, NO_START = "imitation", "none"

#: Robots of a training unless asked otherwise, and robots and disturbances of a randomised one.
NARROW = Randomization(youngs_modulus=(0.5, 1.5))
BROAD = Randomization(
    youngs_modulus=(0.5, 1.5),
    density=(0.6, 1.5),
    damping_time=(0.5, 2.0),
    tendon_radius=(0.9, 1.1),
    tension_gain=(0.9, 1.1),
    tendon_friction=(0.0, 0.5),
    delay=(0.0, 0.02),
    sensor_noise=(0.0, 1.0),
)

#: Robots of the closed-loop checks in a training: Young's modulus alone, and disturbances as well.
MODULI = ({"youngs_modulus": 0.5}, {}, {"youngs_modulus": 1.5})
DISTURBED = (
    *MODULI,
    {"density": 0.6},
    {"damping_time": 0.5},
    {"tension_gain": 0.9},
    {"tendon_friction": 0.5},
    {"delay": 0.01},
    {"sensor_noise": 1.0},
)


_Usual = Annotated[float, Range("from 1e-12 to 100", lambda x: 1e-12 <= x <= 100)]


@dataclass(frozen=True)
class RLConfig:
    """Size and settings of a training.

    Attributes:
        algorithm: "ppo", "sac" or "td3".
        tasks: Out of `TRAINING_TASKS`, of another robot than the arm out of `ROBOT_TASKS`.
        drawn_tasks: Number of random references among the arm's tasks.
        envs_per_task: Environments of each task (steps of four widths, and two times each the
            swing and the L-shape; random paths at four paces).
        randomization: Robots and disturbances, sampled for every episode.
        fine_scale: [m] of the reward's precision term, see `TrackingReward`.
        steps: Environment steps in all.
        critic_steps: Before them, with a network to start from: it acts and its critic learns.
        hidden: Neurons of the hidden layers of actor and critic.
        rate: Learning rate at the start; falls linearly to zero.
        discount: Per step.
        deviation: Standard deviation [1] of the outputs that explore: at the start (PPO), the one
            whose entropy is aimed at (SAC), or throughout (TD3).
        batch: Samples per gradient step; PPO takes the largest number up to it that divides what
            is collected between updates.
        rollout, epochs, target_kl: PPO: steps per environment between updates, passes over them,
            and the divergence at which an update ends early.
        buffer, updates, warm_up: SAC and TD3: steps remembered, gradient steps after every step of
            all environments, and steps before the first of them.
        trial_every: Environment steps between closed-loop checks of the mean action; the best
            network is kept.
        trials: Robots and disturbances of the checks, as in the option `vary` of `reset`.
        trial_duration: [s] of the checks' episodes, the tasks' own for None.
        threads: Of torch and the simulation.
        backend, device: Of the simulation, as of `VectorTrackingEnv`.
    """

    algorithm: str = "ppo"
    tasks: tuple[str, ...] = TRAINING_TASKS
    drawn_tasks: Whole = 24
    envs_per_task: Count = 8
    randomization: Randomization = NARROW
    fine_scale: _Usual = 0.005
    steps: Count = 3_000_000
    critic_steps: Whole = 0
    hidden: tuple[Count, ...] = (128, 128)
    rate: _Usual = 5e-4
    discount: Annotated[float, Range("from 0 to below 1", lambda x: 0 <= x < 1)] = 0.98
    deviation: _Usual = 0.3
    batch: Count = 512
    rollout: Count = 32
    epochs: Count = 10
    target_kl: _Usual = 0.03
    buffer: Count = 500_000
    updates: Count = 4
    warm_up: Whole = 10_000
    trial_every: Count = 250_000
    trials: tuple[dict[str, float], ...] = MODULI
    trial_duration: Positive | None = None
    threads: Count = 1
    backend: str = "mujoco"
    device: str | None = None

    def __post_init__(self) -> None:
        check_fields(self, "training")
        if self.algorithm not in SCRATCH_SETTINGS:
            raise ValueError(
                f"unknown algorithm {self.algorithm!r}; choose from {', '.join(SCRATCH_SETTINGS)}"
            )
        if not any(self.tasks and set(self.tasks) <= {*known} for known in TASKS_OF):
            allowed = "; of other robots than the arm ".join(", ".join(known) for known in TASKS_OF)
            raise ValueError(f"tasks must be one or more of {allowed}, got {self.tasks!r}")
        if self.tasks == ("drawn",) and self.drawn_tasks < 1:
            raise ValueError("drawn_tasks must be 1 or more if there are no other tasks")


def numbers_of(config: type) -> dict[str, type]:
    """Settings that are numbers, which can be set by name -> int or float."""
    return {n: kind for n, kind in get_type_hints(config).items() if kind in (int, float)}


NUMBERS = numbers_of(RLConfig)


def wanted_in(
    settings: Mapping[str, Any], numbers: Mapping[str, type], tasks: tuple[str, ...], robot: str
) -> dict[str, Any]:
    """Tasks, steps and numbers that are given to a training (`commands.train`).

    Args:
        settings: What is given.
        numbers: What can be set, as `numbers_of`.
        tasks: Names of those of the robot.
        robot: Its name.

    Raises:
        ValueError: A setting that does not exist or is no number, or a task of another robot.
    """
    wanted: dict[str, Any] = {}
    if "task" in settings and "all" not in settings["task"]:
        wanted["tasks"] = tuple(dict.fromkeys(settings["task"]))
        if not set(wanted["tasks"]) <= set(tasks):
            raise ValueError(f"robot {robot!r} is trained on {', '.join(tasks)}")
    if "steps" in settings:
        wanted["steps"] = settings["steps"]
    for name, value in settings.get("set", ()):
        if name not in numbers:
            raise ValueError(f"cannot set {name!r}; choose from {', '.join(numbers)}")
        if numbers[name] is int and not value.is_integer():
            raise ValueError(f"{name} must be a whole number, got {value:g}")
        wanted[name] = numbers[name](value)
    return wanted


_OFF_POLICY = {"envs_per_task": 2, "batch": 256, "rate": 1e-3, "deviation": 0.1, "steps": 700_000}

#: What the algorithms need from scratch, beyond the defaults.
SCRATCH_SETTINGS = {"ppo": {}, "sac": _OFF_POLICY, "td3": _OFF_POLICY}

#: And from a network that is good already: closer about its actions, and slower.
_CLOSE = {"fine_scale": 0.001, "deviation": 0.02}
_OFF_POLICY_TUNING = _CLOSE | {"critic_steps": 60_000, "rate": 1e-4, "steps": 300_000}
_TUNING_SETTINGS = {
    "ppo": _CLOSE | {"critic_steps": 200_000, "rate": 5e-5, "steps": 1_000_000},
    "sac": _OFF_POLICY_TUNING,
    "td3": _OFF_POLICY_TUNING,
}

#: Disturbances that the network to start from never met need larger changes of it.
_DISTURBED_TUNING = {
    "ppo": {"fine_scale": 0.005, "rate": 3e-4, "deviation": 0.15, "steps": 2_000_000}
}


def preset(algorithm: str, warm: bool, disturbed: bool) -> RLConfig:
    """Settings that work.

    Args:
        algorithm: "ppo", "sac" or "td3".
        warm: Whether there is a network to start from.
        disturbed: Whether robots and disturbances are sampled from `BROAD`.

    Raises:
        ValueError: Unknown algorithm; the message lists the known ones.
    """
    RLConfig(algorithm)
    settings = dict(SCRATCH_SETTINGS[algorithm])
    if warm:
        settings |= _TUNING_SETTINGS[algorithm]
    if warm and disturbed:
        settings |= _DISTURBED_TUNING.get(algorithm, {})
    if disturbed:
        settings |= {"randomization": BROAD, "trials": DISTURBED}
    return RLConfig(algorithm, **settings)


#: Robots of the closed-loop checks of other robots than the arm.
_ROBOT_MODULI = ({"youngs_modulus": 0.75}, {}, {"youngs_modulus": 1.25})

#: What is smaller for them, so that minutes do: they have fewer tasks.
_ROBOT_SIZES = {
    "ppo": {"steps": 1_000_000, "envs_per_task": 16},
    "sac": {"steps": 150_000},
    "td3": {"steps": 150_000},
}

#: A training that shows that everything runs.
QUICK = {"steps": 4000, "critic_steps": 0, "envs_per_task": 2, "trials": ({},)}


def of_any_robot(config: RLConfig, robot: RobotParams) -> RLConfig:
    """Settings for another robot than the arm: its tasks, and what can vary of it."""
    ranges, trials = config.randomization, config.trials
    trials = tuple(
        trial for trial in trials if not any(incompatibility(name, robot) for name in trial)
    )
    if ranges == NARROW:
        trials = _ROBOT_MODULI
    return replace(
        config,
        tasks=ROBOT_TASKS,
        randomization=ranges.fitting(robot),
        trials=trials,
        **_ROBOT_SIZES[config.algorithm],
    )


def checkpoint_of(settings: Mapping[str, Any], path: Path) -> Path | None:
    """Folder of what a training that writes to a file needs to go on; None where it shall not."""
    return settings.get("checkpoint", Path("out") / "train" / path.stem)
