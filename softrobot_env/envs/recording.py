"""Wrappers that record the inputs and measured tips of environments."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv, VectorWrapper
from numpy import ndarray

from softrobot_env.core.interfaces import Seen
from softrobot_env.recordings import Recording, write_recording
from softrobot_env.recordings.columns import check_writable
from softrobot_env.recordings.recording import at_their_time, episode_recording

from .reference import AXES

_NEEDED = ("tip_position", "previous_action")


def check_observed(env: gymnasium.Env | VectorEnv, names: tuple[str, ...]) -> None:
    """Raise ValueError unless an environment observes what a record needs, in a dict."""
    observed = getattr(env.observation_space, "spaces", ())  # a vector has none
    missing = [name for name in names if name not in observed]
    if missing:
        raise ValueError(
            f"recording needs a dict with the observables {', '.join(missing)}: pass "
            'observe="all", and observe_as="dict" (grippers observe no tips)'
        )


class _Episodes:
    """The rows of episodes, each a run of one recording."""

    def __init__(self, env: gymnasium.Env | VectorEnv, path: Path | str | None) -> None:
        if path is not None:
            check_writable(path)
        check_observed(env, _NEEDED)
        self._env, self._path = env.unwrapped, path
        self._runs: list[list[tuple]] = []

    def begin(self) -> list[tuple]:
        """Begin a new run: lists of time, age of the tip, action, tip and label of each row."""
        self._runs.append([])
        return self._runs[-1]

    def recording(self) -> Recording:
        """All runs; raises ValueError without any row."""
        runs = [[np.array(x) for x in zip(*run, strict=True)] for run in self._runs if run]
        if not runs:
            raise ValueError("nothing was recorded: reset the environment first")
        tips = [at_their_time(times, ages, tips) for times, ages, _, tips, _ in runs]
        times, _, actions, _, labels = (np.concatenate(x) for x in zip(*runs, strict=True))
        task = self._env.task
        return episode_recording(
            task.robot,
            AXES[task.axes],
            times,
            actions,
            np.concatenate(tips),
            labels=labels,
            runs=np.repeat(np.arange(len(runs)), [len(run[0]) for run in runs]),
            source=f"{type(self._env).__name__}, task {task.name}",
        )

    def write(self) -> None:
        """Write the recording, once, if there is a path."""
        if self._path is not None and any(self._runs):
            write_recording(self.recording(), self._path)
            self._runs = []


class _Recorder:
    """A wrapper that records rows by its method `_add`."""

    _episodes: _Episodes

    def reset(self, **arguments: Any) -> tuple[Seen, dict[str, Any]]:
        """Begin a new run of the environments that are reset."""
        outcome = super().reset(**arguments)
        self._add(*outcome)
        return outcome

    def step(self, action: ndarray) -> tuple[Seen, Any, Any, Any, dict[str, Any]]:
        """Make a step, and record a row for each environment."""
        outcome = super().step(action)
        self._add(outcome[0], outcome[-1])
        return outcome

    @property
    def recording(self) -> Recording:
        """All rows so far.

        Raises:
            ValueError: There are none.
        """
        return self._episodes.recording()

    def close(self, **arguments: Any) -> None:
        """Write the recording, and close the wrapped environment."""
        self._episodes.write()
        super().close(**arguments)


class RecordEpisodes(_Recorder, gymnasium.Wrapper):
    """Records every episode of an environment, simulated or real, as a run of one recording.

    A row is a control instant: the command applied until then, and the tip as the camera sees it
    (including noise and delay); pictures with a known age are assigned to their own time. The step
    in which an episode fails is left out.

        env = RecordEpisodes(gymnasium.make("SoftRobot/RigReach-v0"), "out/rig.csv")
        ...
        env.close()  # writes out/rig.csv and out/rig.toml

    Attributes:
        label: Label of the next rows.
    """

    def __init__(self, env: gymnasium.Env, path: Path | str | None = None) -> None:
        """Record to memory, and to a file on `close`.

        Args:
            env: The environment; it observes `tip_position` and `previous_action` in a dict.
            path: Table to write, .csv or .parquet; `recording` alone unless given.

        Raises:
            ValueError: The environment does not observe them, or the file has another ending.
            ImportError: The package that writes Parquet files is missing.
        """
        super().__init__(env)
        self.label, self._episodes = "", _Episodes(env, path)
        self._run: list[tuple] = []

    def _add(self, observation: dict[str, ndarray], info: dict[str, Any]) -> None:
        """Add a row; at time zero a run begins, and a failed step is left out."""
        if "failure" in info:
            return
        if info["time"] == 0:
            self._run = self._episodes.begin()
        action = info.get("applied_action", observation["previous_action"])
        tip, age = observation["tip_position"].copy(), float(info.get("tip_age", 0.0))
        self._run.append((float(info["time"]), age, np.array(action), tip, self.label))


class RecordVectorEpisodes(_Recorder, VectorWrapper):
    """`RecordEpisodes` for vectorised environments: a run for each episode of each of them.

    Attributes:
        label: Label of the next rows.
    """

    def __init__(self, env: VectorEnv, path: Path | str | None = None) -> None:
        """Arguments as in `RecordEpisodes`.

        Raises:
            ValueError: The environments do not observe the required quantities, or reset in the
                step that ends an episode, which hides its last row.
        """
        super().__init__(env)
        if env.metadata.get("autoreset_mode") == AutoresetMode.SAME_STEP:
            raise ValueError("recording needs the autoreset mode NEXT_STEP or DISABLED")
        self.label, self._episodes = "", _Episodes(env, path)
        self._runs: list[list[tuple]] = [[] for _ in range(env.num_envs)]

    def _add(self, observation: dict[str, ndarray], info: dict[str, Any]) -> None:
        """Add rows; at time zero a run begins, and failed steps are left out."""
        present, failed = info["_time"], info.get("_failure", np.zeros(self.num_envs, bool))
        for k in np.flatnonzero(present & ~failed):
            time = float(info["time"][k])
            if time == 0:
                self._runs[k] = self._episodes.begin()
            action, tip = (np.array(observation[name][k]) for name in reversed(_NEEDED))
            self._runs[k].append((time, 0.0, action, tip, self.label))
