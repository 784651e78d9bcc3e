"""Vectorised tracking environments as an environment of stable-baselines3."""

from collections.abc import Sequence
from time import perf_counter
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvStepReturn

from softrobot_env.control.arm import neural
from softrobot_env.envs.vector import VectorTrackingEnv
from softrobot_env.interfaces import Observation


class TrackingVecEnv(VecEnv):
    """One or several `VectorTrackingEnv`, one behind the other, with other observations.

    Agents see `neural.features` (k,) float32 and choose the network's output in [-1, 1], by which
    `neural.increment` changes the action in force: an agent trained here is the network of a
    `NeuralPolicy`.

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
        sample = {k: v.sample() for k, v in first.single_observation_space.spaces.items()}
        count, outputs = len(neural.features(sample)), first.single_action_space.shape[0]
        super().__init__(
            int(ends[-1]),
            gymnasium.spaces.Box(-10.0, 10.0, (count,), np.float32),
            gymnasium.spaces.Box(-1.0, 1.0, (outputs,), np.float32),
        )
        self._return, self._length = np.zeros(self.num_envs), np.zeros(self.num_envs, int)
        self._began = perf_counter()

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Seeds of the next reset, unlike those of any other seed; drawn anew for None."""
        spawned = np.random.SeedSequence(seed).spawn(self.num_envs)
        self._seeds = [int(one.generate_state(1)[0]) for one in spawned]
        return self._seeds

    def reset(self) -> np.ndarray:
        """Features (n, k) of new episodes everywhere."""
        self._seen = [self._reset(p, s) for p, s in zip(self.parts, self._slices, strict=True)]
        self._reset_seeds()
        self._reset_options()
        self._return[:], self._length[:] = 0, 0
        self.reset_infos = [{} for _ in range(self.num_envs)]
        return np.concatenate([neural.features(one) for one in self._seen])

    def _reset(self, part: VectorTrackingEnv, where: slice) -> Observation:
        seen, _ = part.reset(seed=self._seeds[where])
        for i in range(1, part.num_envs) if self._stagger else ():
            mask = np.arange(part.num_envs) == i
            duration = part.task.duration * i / part.num_envs
            seen, _ = part.reset(
                options={"reset_mask": mask, "duration": max(duration, part.control_period)}
            )
        return seen

    def step_async(self, actions: np.ndarray) -> None:
        """Remember outputs (n, n_inputs) of the networks."""
        self._outputs = np.asarray(actions, dtype=np.float64)

    def step_wait(self) -> VecEnvStepReturn:
        """Step all parts by the remembered outputs."""
        observations, rewards, dones = [], np.empty(self.num_envs), np.empty(self.num_envs, bool)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for k, (part, where) in enumerate(zip(self.parts, self._slices, strict=True)):
            change = neural.increment(self._outputs[where])
            action = np.clip(self._seen[k]["previous_action"] + change, -1.0, 1.0)
            seen, reward, terminated, truncated, info = part.step(action)
            self._seen[k] = seen
            observations.append(neural.features(seen))
            rewards[where], dones[where] = reward, terminated | truncated
            for i in np.flatnonzero(terminated | truncated):
                infos[where.start + i] = self._end(info, i, bool(truncated[i]))
        self._return += rewards
        self._length += 1
        for i in np.flatnonzero(dones):
            infos[i]["episode"] = self._episode(i)
        return np.concatenate(observations), self._scale * rewards, dones, infos

    def _end(self, info: dict[str, Any], i: int, truncated: bool) -> dict[str, Any]:
        last = {name: value[i] for name, value in info["final_obs"].items()}
        out = {"terminal_observation": neural.features(last), "TimeLimit.truncated": truncated}
        if not truncated:
            out["failure"] = info["final_info"].get("failure", [None] * (i + 1))[i]
        return out

    def _episode(self, i: int) -> dict[str, float]:
        found = {"r": float(self._return[i]), "l": int(self._length[i])}
        self._return[i], self._length[i] = 0, 0
        return found | {"t": perf_counter() - self._began}

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
