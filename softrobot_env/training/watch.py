"""Closed-loop checks of the policy during a training, and its learning curve."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback

from softrobot_env.control.learned.neural import View
from softrobot_env.core.interfaces import ProgressCallback
from softrobot_env.envs.rewards import TrackingReward
from softrobot_env.learned.network import Network
from softrobot_env.robots import RobotParams

from .artifacts import check
from .learners import actor_of
from .rl_config import RLConfig

#: Environment steps, mean `SCORE` of the checks, largest error [mm] on swing and L-shape among
#: them, and number of failures.
Point = dict[str, float]

#: What networks are judged by, whatever they learn from: those of other robots by as much of their
#: reach as those of the arm.
SCORE = TrackingReward()

#: Reach [m] of a robot that the reward's scales are of.
REACH = 0.5

#: Taken from the reward for each failed episode.
_PENALTY = 1.0


def score_of(robot: RobotParams) -> TrackingReward:
    """What networks of a robot are judged by."""
    share = robot.reach / REACH
    return replace(
        SCORE, coarse_scale=share * SCORE.coarse_scale, fine_scale=share * SCORE.fine_scale
    )


class Watch(BaseCallback):
    """Tries the mean action now and then, keeps the best network and the learning curve.

    Attributes:
        best: Network of the best check so far; of an earlier training to go on with, its own.
        curve: Results of the checks, likewise.
    """

    def __init__(
        self,
        config: RLConfig,
        show: ProgressCallback,
        save: Callable[[BaseAlgorithm, Network, list[Point]], None],
        robot: RobotParams,
        view: View,
        seed: int | None = None,
    ) -> None:
        """Watch a training.

        Args:
            config: Of the training.
            show: Shows the progress.
            save: Called after every check, with the learner, the best network and the curve.
            robot: To train for.
            view: Of its networks.
            seed: With which all episodes and draws begin anew after every check, as a checkpoint
                holds neither; None where they go on.
        """
        super().__init__()
        self._robot, self._view, self._seed = robot, view, seed
        self._config, self._show, self._save = config, show, save
        self.best: Network | None = None
        self.curve: list[Point] = []

    @property
    def _steps(self) -> int:
        """Environment steps at the last check."""
        return int(self.curve[-1]["steps"])

    @property
    def _reward(self) -> float:
        """Of the best check."""
        return max((point["reward"] for point in self.curve), default=-np.inf)

    def _on_step(self) -> bool:
        return True

    def _on_training_start(self) -> None:
        if self.curve:
            self._begin_anew()

    def _on_rollout_start(self) -> None:
        every = self._config.trial_every
        if not self.curve or self.num_timesteps // every > self._steps // every:
            self.judge()
            self._begin_anew()
        self._show(f"mean reward {self._reward:.4f}", self.num_timesteps, self._config.steps)

    def _begin_anew(self) -> None:
        """New episodes and draws by seed and steps alone."""
        if self._seed is not None:
            sequence = np.random.SeedSequence([self._seed, self._steps])
            self.model.set_random_seed(int(sequence.generate_state(1)[0] >> 1))
            self.model._last_obs = self.training_env.reset()
            self.model._last_episode_starts = np.ones(self.model.n_envs, bool)

    def judge(self) -> None:
        """Try the present network."""
        config = self._config
        network = actor_of(self.model, config)
        robot, view, score = self._robot, self._view, score_of(self._robot)
        rows = check(network, config.trials, config.trial_duration, score, robot, view)
        failures = sum(row.failure is not None for row in rows.values())
        mean = float(np.mean([row.reward for row in rows.values()]))
        mean -= _PENALTY * failures / len(rows)
        largest = 1e3 * max(row.e_max for row in rows.values() if row.step is None)
        point = {"reward": mean, "max_mm": largest, "failures": failures}
        if mean > self._reward:
            self.best = network
        self.curve.append({"steps": self.num_timesteps, **point})
        for name, value in point.items():
            self.logger.record(f"trial/{name}", value)
        self.logger.dump(self.num_timesteps)
        self._save(self.model, self.best, self.curve)
