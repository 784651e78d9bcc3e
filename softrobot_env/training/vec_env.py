"""Vectorised tracking environments as an environment of stable-baselines3."""

from collections.abc import Sequence
from time import perf_counter
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy import ndarray
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from softrobot_env.control.learned import neural
from softrobot_env.core.arrays import on_host
from softrobot_env.core.interfaces import Observation, Seen
from softrobot_env.envs.vector import VectorTrackingEnv


def make_vec_env(
    env_id: str, n_envs: int = 1, *, seed: int | None = None, **options: Any
) -> "TrackingVecEnv":
    """An environment of stable-baselines3 with many robots, on a thread pool or on MuJoCo Warp.

    Args:
        env_id: Of the environment.
        n_envs: Number of robots.
        seed: Of the first reset.
        **options: Of the environment, as of `gymnasium.make`.

    Raises:
        ValueError: An argument out of range, or the real rig, of which there is one.
    """
    if gymnasium.spec(env_id).vector_entry_point is None:
        raise ValueError(
            f"there is one robot behind {env_id}: give stable-baselines3 gymnasium.make({env_id!r})"
        )
    options |= {
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "vectorization_mode": "vector_entry_point",
    }
    env = TrackingVecEnv([gymnasium.make_vec(env_id, n_envs, **options).unwrapped])
    env.seed(seed)
    return env


class TrackingVecEnv(VecEnv):
    """One or several `VectorTrackingEnv`, one behind the other, as they are.

    Those of MuJoCo Warp are read back from their device once a step.

    Observations are dicts (for "MultiInputPolicy"), or with `observe_as="vector"` vectors (for
    "MlpPolicy").

    `infos` hold `terminal_observation`, `TimeLimit.truncated`, `episode` (return r, length l and
    time t, as stable-baselines3's Monitor) and `failure` in the step that ends an episode; they
    are empty otherwise.

    Attributes:
        parts: The environments.
    """

    def __init__(
        self, parts: Sequence[VectorTrackingEnv], *, stagger: bool = False, reward_scale: float = 1
    ) -> None:
        """Join environments.

        Args:
            parts: In autoreset mode "same step", with equal spaces.
            stagger: Whether the first episodes end early, at times spread over their duration,
                so that the environments do not all restart at once.
            reward_scale: Factor [1] on rewards, but for the returns in `infos`.

        Raises:
            ValueError: No parts, another autoreset mode, or unequal spaces.
        """
        if not parts or any(
            part.metadata["autoreset_mode"] != AutoresetMode.SAME_STEP for part in parts
        ):
            raise ValueError('parts must be one or more, with autoreset_mode="SameStep"')
        first = parts[0]
        if any(
            part.single_observation_space != first.single_observation_space
            or part.single_action_space != first.single_action_space
            for part in parts
        ):
            raise ValueError("parts must have the same observation and action space each")
        self.parts, self._stagger, self._scale = tuple(parts), stagger, reward_scale
        ends = np.cumsum([part.num_envs for part in parts])
        self._slices = [slice(end - p.num_envs, end) for p, end in zip(parts, ends, strict=True)]
        super().__init__(int(ends[-1]), self._agent_space(first), first.single_action_space)
        self._return, self._length = np.zeros(self.num_envs), np.zeros(self.num_envs, int)
        self._began = perf_counter()

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Seeds of the next reset, unlike those of any other seed; new ones for None."""
        spawned = np.random.SeedSequence(seed).spawn(self.num_envs)
        self._seeds = [int(one.generate_state(1)[0]) for one in spawned]
        return self._seeds

    def reset(self) -> Seen:
        """Observations (n, ...) of new episodes everywhere."""
        self._seen = [self._reset(p, s) for p, s in zip(self.parts, self._slices, strict=True)]
        self._reset_seeds()
        self._reset_options()
        self._return[:], self._length[:] = 0, 0
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return self._joined(self._seen)

    def _joined(self, seen: list[Seen]) -> Seen:
        """What agents are shown of the parts' observations, one behind the other."""
        shown = [self._shown(one) for one in seen]
        if isinstance(shown[0], dict):
            return {name: np.concatenate([one[name] for one in shown]) for name in shown[0]}
        return np.concatenate(shown)

    # ------------------------------------------------------------------ hooks

    def _agent_space(self, part: VectorTrackingEnv) -> gymnasium.Space:
        """Of what agents are shown of a part's observations."""
        return part.single_observation_space

    def _shown(self, seen: Seen) -> Seen:
        """What agents are shown of observations (..., size)."""
        return seen

    def _action(self, chosen: ndarray, seen: Seen) -> ndarray:
        """Actions (n, n_inputs) of a part for what agents chose (n, n_inputs) on what was seen."""
        return chosen

    # ------------------------------------------------------------------ steps

    def _reset(self, part: VectorTrackingEnv, where: slice) -> Seen:
        seen, _ = part.reset(seed=self._seeds[where])
        for i in range(1, part.num_envs) if self._stagger else ():
            mask = np.arange(part.num_envs) == i
            duration = part.task.duration * i / part.num_envs
            seen, _ = part.reset(
                options={"reset_mask": mask, "duration": max(duration, part.control_period)}
            )
        return on_host(seen)

    def step_async(self, actions: ndarray) -> None:
        """Remember what agents chose, (n, n_inputs)."""
        self._chosen = np.asarray(actions, np.float64)

    def step_wait(self) -> VecEnvStepReturn:
        """Step all parts by what is remembered."""
        rewards, dones = np.empty(self.num_envs), np.empty(self.num_envs, bool)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for k, (part, where) in enumerate(zip(self.parts, self._slices, strict=True)):
            action = self._action(self._chosen[where], self._seen[k])
            self._seen[k], reward, terminated, truncated, info = on_host(part.step(action))
            rewards[where], dones[where] = reward, terminated | truncated
            for i in np.flatnonzero(terminated | truncated):
                infos[where.start + i] = self._end(info, i, bool(truncated[i]))
        self._return += rewards
        self._length += 1
        for i in np.flatnonzero(dones):
            found = {"r": float(self._return[i]), "l": int(self._length[i])}
            infos[i]["episode"] = found | {"t": perf_counter() - self._began}
        self._return[dones], self._length[dones] = 0, 0
        return self._joined(self._seen), self._scale * rewards, dones, infos

    def _end(self, info: dict[str, Any], i: int, truncated: bool) -> dict[str, Any]:
        last = info["final_obs"]
        last = {n: v[i] for n, v in last.items()} if isinstance(last, dict) else last[i]
        out = {"terminal_observation": self._shown(last), "TimeLimit.truncated": truncated}
        if not truncated:
            out["failure"] = info["final_info"].get("failure", [None] * (i + 1))[i]
        return out

    def close(self) -> None:
        """Close all parts."""
        for part in self.parts:
            part.close()

    # What stable-baselines3 asks of single environments; these have nothing of their own.

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Attribute of the part that each environment belongs to."""
        owners = [part for part in self.parts for _ in range(part.num_envs)]
        return [getattr(owners[i], attr_name) for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not possible: the environments share their part's attributes."""
        raise NotImplementedError("environments of a VectorTrackingEnv have no attributes to set")

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Not possible: the environments share their part's methods."""
        raise NotImplementedError("environments of a VectorTrackingEnv have no methods to call")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Monitor's tasks are done here; nothing else is wrapped."""
        from stable_baselines3.common.monitor import Monitor

        wrapped = isinstance(wrapper_class, type) and issubclass(wrapper_class, Monitor)
        return [wrapped for _ in self._get_indices(indices)]


class NetworkVecEnv(TrackingVecEnv):
    """The environment in which networks of `NeuralPolicy` are trained.

    Agents see `neural.features` (k,) float32 and choose the network's output in [-1, 1], by which
    `View.increment` changes the action in force.
    """

    def __init__(
        self, parts: Sequence[VectorTrackingEnv], view: neural.View | None = None, **options: Any
    ) -> None:
        """Join environments, seen in a view (the usual one unless given); `options` of the base."""
        self.view = neural.arm_view(parts[0].task.robot) if view is None else view
        super().__init__(parts, **options)

    def _agent_space(self, part: VectorTrackingEnv) -> gymnasium.Space:
        return gymnasium.spaces.Box(-10.0, 10.0, (self.view.count,), np.float32)

    def _shown(self, seen: Observation) -> ndarray:
        return neural.features(seen, self.view)

    def _action(self, chosen: ndarray, seen: Observation) -> ndarray:
        return np.clip(seen["previous_action"] + self.view.increment(chosen), -1.0, 1.0)
