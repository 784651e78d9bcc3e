"""Grippers that enclose a clamped bar, or grasp a free one and hold it: one, or many at once."""

from collections.abc import Callable
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy import float64

from softrobot_env.core.interfaces import Seen
from softrobot_env.core.records import check_argument
from softrobot_env.envs.config import GRIPPER, MANY, PICTURES, ControlPeriod, EnvConfig
from softrobot_env.envs.observations.fingers import FingerSensors, GripperView, observes
from softrobot_env.envs.observations.table import speed_limit
from softrobot_env.envs.options import MASK, checked_actions, parse_seeds, seed_generators
from softrobot_env.envs.parts import EpisodeSpec
from softrobot_env.envs.rendering.renderer import GripperRenderer
from softrobot_env.envs.rewards import GripReward
from softrobot_env.envs.simulation.grippers import GripperBatch
from softrobot_env.envs.vector import BatchEnv
from softrobot_env.robots import Gripper, RobotParams, as_number, find_gripper
from softrobot_env.scene.gripper import FINENESS, Resolution
from softrobot_env.tasks.gripper import DRAWN, GRIP_TASKS, POSITIVE, GripTask

#: Of the fingers' own quantities each has one; pulls and shaking are vectors.
_OF_FINGERS, _VECTORS = ("modulus", "arm"), ("pull", "shake")

_USUAL = {"task": "hold", "control_period": 0.02, "observe": ("curvature", "tendon_tension")}
_TERMS = ("reward_grip", "reward_effort", "reward_smoothness", "reward_failure")


class VectorGripperEnv(BatchEnv, gymnasium.vector.VectorEnv[Seen, np.ndarray, np.ndarray]):
    """Grippers on a thread pool; `GripperEnv` is one of them.

    An action in [-1, 1] is the tension of a tendon between none and its limit. Observations are
    float64 in SI units: `curvature` and `curvature_rate` (means over each piece of each finger, as
    ideal sensors have them), `tendon_tension`, `sensors` (readings of the sensors that each finger
    carries, a specimen sampled anew), `contact` (size of each finger's force on the bar) and
    `previous_action`; or, with observe_as="vector", one float32 vector of them of order 1. `info`
    is flat: time, the terms of the reward by their names, error (over what counts as success),
    success (only at the end), what was sampled, and the place of the bar.

    Attributes:
        gripper, task: What they are.
        simulation: Of all.
    """

    takes: ClassVar = (*GRIPPER, *MANY)
    usual: ClassVar = _USUAL

    def __init__(self, num_envs: int = 1, task: str | GripTask = "hold", **options: Any) -> None:
        """Build the environments.

        Args:
            num_envs: Their number n.
            task: A name out of `GRIP_TASKS`, or a task.
            **options: Those that `VectorGripperEnv.takes` names, see `config.EnvConfig`.

        Raises:
            ValueError: An option out of range; the message names what is allowed.
            TypeError: An unknown option.

        Warns:
            TimestepWarning: A timestep was given that is longer than the rule's.
        """
        config = EnvConfig.of(type(self), {"num_envs": num_envs, "task": task, **options})
        check_argument("control_period", config.control_period, ControlPeriod)
        if config.backend != "mujoco":
            raise ValueError(
                f"grippers have the backend 'mujoco' alone, got {config.backend!r}: they touch"
            )
        check_argument("reward", config.reward, GripReward | None)
        self.task = _found(config.task, GRIP_TASKS.find, "task", GripTask)
        self.gripper = _found(config.gripper, find_gripper, "gripper", Gripper)
        fineness = _found(config.fineness, FINENESS.find, "fineness", Resolution)
        self.control_period = float(config.control_period)
        self._reward = config.reward or GripReward()
        self.max_episode_steps = max(1, round(self.task.duration / self.control_period))
        self._limits = self.gripper.tension_limits
        n, fingers = int(config.num_envs), self.gripper.fingers
        self._action = np.full((n, len(self._limits)), -1.0)
        sensed = observes(config.observe, "sensors")
        self.simulation = GripperBatch(self.gripper, self.task, config, fineness, sensed)
        self.sensors = FingerSensors(self.simulation, self.control_period) if sensed else None
        self._view = GripperView(self.simulation, config, self._action.copy, self.sensors)
        self.observe_as, self.vector_layout = config.observe_as, self._view.layout
        action_space = gymnasium.spaces.Box(-1.0, 1.0, self._limits.shape, np.float32)
        self._prepare(config, self._view.space, action_space)
        shapes = dict.fromkeys(_OF_FINGERS, (n, len(fingers))) | dict.fromkeys(_VECTORS, (n, 3))
        self._sampled = {name: np.zeros(shapes.get(name, n)) for name in DRAWN}
        self._worst, self._home = np.zeros(n), np.zeros((n, 3))
        self._speed = max(speed_limit(finger.robot) for finger in fingers)
        self._enclosable = np.array(
            [(k, s) for k, f in enumerate(fingers) for s in _starts(f.robot)]
        )

    # ------------------------------------------------------------------ episodes

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Seen, dict[str, Any]]:
        """Start episodes: fingers straight, a new bar and new fingers.

        Args:
            seed: Seed of the first environment, the others follow; or one each.
            options: Values in place of samples, by names out of `tasks.gripper.DRAWN`, each a
                number or an array of n; `modulus` and `arm` may be of the fingers, `pull` and
                `shake` are sizes, in a sampled direction, or vectors (3,). And `reset_mask` (n,)
                bool, the environments to reset, all unless given.

        Raises:
            ValueError: A bad option; the message names what is allowed.
        """
        given, which = self._given(options)
        fixed = {name: self._parsed(name, value) for name, value in given.items()}
        seed_generators(self._generators, parse_seeds(seed, self.num_envs))
        self._begin(which, fixed)
        self._started = True
        self._observation = self._view()
        return self._observation, self._info_of({name: np.zeros(self.num_envs) for name in _TERMS})

    def _parsed(self, name: str, value: Any) -> np.ndarray:
        """An option as an array that broadcasts to that of what is sampled."""
        if name not in DRAWN:
            raise ValueError(f"unknown option {name!r}; allowed are {', '.join(DRAWN)}, {MASK}")
        try:
            values = np.asarray(value, dtype=float)
            if name in _VECTORS and values.shape != (3,):
                shape = (self.num_envs,)
                values = np.broadcast_to(values, shape)
            else:
                values = np.broadcast_to(values, self._sampled[name].shape)
        except (TypeError, ValueError):
            values = np.array([np.nan])
        least = -np.inf if name in _VECTORS and values.ndim == 2 else 0.0
        positive = name in POSITIVE
        if not (np.isfinite(values).all() and (values >= least).all()) or (
            positive and not (values > 0).all()
        ):
            raise ValueError(
                f"option {name!r} must be finite and {'positive' if positive else 'zero or more'}, "
                f"one number or one for each of {self.num_envs}, got {value!r}"
            )
        return values

    def _begin(self, which: np.ndarray, fixed: dict[str, np.ndarray] | None = None) -> None:
        """Start episodes of the environments `which` (k,)."""
        for i in which:
            for name, value in self._sample(self._generators[i]).items():
                self._sampled[name][i] = value
        for name, value in (fixed or {}).items():
            own = self._sampled[name]
            if name in _VECTORS and value.ndim == 1:
                sizes = np.linalg.norm(own[which], axis=1, keepdims=True)
                sizes[sizes == 0] = 1.0
                own[which] *= value[which, None] / sizes
            else:
                own[which] = value[which]
        self.simulation.start(which, {name: v[which] for name, v in self._sampled.items()})
        if self.sensors is not None:
            errors, specimen = self._sampled["sensor_errors"], self._sampled["specimen"]
            seeds = np.array([self._generators[i].integers(2**31) for i in which])
            self.sensors.start(which, errors[which], specimen[which], seeds)
        self._index[which], self._worst[which], self._action[which] = 0, 0.0, -1.0
        self._home[which] = self.simulation.place[which]
        self._done[which] = False
        self._set_threshold()

    def _sample(self, rng: np.random.Generator) -> dict[str, Any]:
        out: dict[str, Any] = {}
        for name in DRAWN:
            ends = getattr(self.task, name)
            size = len(self.gripper.fingers) if name in _OF_FINGERS else None
            out[name] = rng.uniform(*ends, size)
            if name in _VECTORS:
                direction = rng.standard_normal(3)
                # The size is at least tiny, so that the direction is known where it is given.
                out[name] = max(out[name], 1e-12) * direction / np.linalg.norm(direction)
        return out

    def _set_threshold(self) -> None:
        """Which pieces (n, pieces) bool lie, straight, beyond where the bar is touched."""
        fingers, starts = self._enclosable[:, 0].astype(int), self._enclosable[:, 1]
        along = np.array(
            [
                (self.simulation.place - np.array(f.base.position)) @ f.base.axes[:, 2]
                for f in self.gripper.fingers
            ]
        ).T
        beyond = starts >= along[:, fingers] - 1e-9
        self._beyond = beyond / np.maximum(beyond.sum(axis=1, keepdims=True), 1)

    # ------------------------------------------------------------------ steps

    def step(
        self, actions: np.ndarray
    ) -> tuple[Seen, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Apply actions (n, inputs) in [-1, 1] for one control period.

        Raises:
            ValueError: Not so many real numbers, or one beyond [-1, 1] by more than 1e-6.
            gymnasium.error.ResetNeeded: Nothing was started, or an episode is over and autoreset
                is disabled.
        """
        self._check_running()
        actions, previous = checked_actions(actions, self._action.shape), self._action.copy()
        ended = self._ended()
        self._action[:] = actions
        self.simulation.ctrl[:] = (actions + 1) / 2 * self._limits
        self.simulation.push(*self._disturbances())
        diverged = self._advance(ended)
        self._index += 1
        if ended is not None:
            self._begin(np.flatnonzero(ended))
        return self._result(previous, diverged, ended)

    def _disturbances(self) -> tuple[np.ndarray, np.ndarray]:
        """Pulls (n, 3) [N] and accelerations of the palm (n, 3) [m/s2] in this period."""
        if not self.task.free:
            return np.zeros((self.num_envs, 3)), np.zeros((self.num_envs, 3))
        since = self._index * self.control_period - self.task.closing
        rise = (self.task.duration - self.task.closing) / 2
        share = np.clip(since / rise, 0.0, 1.0)[:, None]
        wave = np.where(since > 0, np.sin(2 * np.pi * self._sampled["rate"] * since), 0.0)[:, None]
        return self._sampled["pull"] * share, self._sampled["shake"] * wave

    def _advance(self, ended: np.ndarray | None) -> np.ndarray:
        """Integrate all but the ended (n,) bool; whether each (n,) diverged."""
        running = None
        if ended is not None:
            running = np.flatnonzero(~ended)
            if not len(running):
                return np.zeros(self.num_envs, dtype=bool)
        diverged = self.simulation.advance(running)
        if self.sensors is not None:
            self.sensors.look(running)
        return diverged.copy() if running is None else diverged & ~ended

    def _error(self) -> np.ndarray:
        """(n,) [1], over what counts as success."""
        if self.task.free:
            away = np.linalg.norm(self.simulation.place - self._home, axis=1)
            return away / self.task.within
        radius = self._sampled["diameter"] / 2
        width = [f.robot.backbone.widest for f in self.gripper.fingers]
        rho = radius[:, None] + np.array(width)[self._enclosable[:, 0].astype(int)]
        off = np.abs(self.simulation.curvature * rho - 1)
        return np.sum(off * self._beyond, axis=1) / self.task.within

    def _result(
        self, previous: np.ndarray, diverged: np.ndarray, ended: np.ndarray | None
    ) -> tuple[Seen, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        before, self._observation = self._observation, self._view()
        error = self._error()
        speed = np.abs(self.simulation.qvel).max(axis=1)
        lost = np.zeros_like(diverged)
        if self.task.free:
            lost = ~(error * self.task.within <= self.task.lost)
        failed = diverged | lost | ~np.isfinite(speed)
        self._worst = np.maximum(self._worst, error) if self.task.free else error
        terms = self._reward.terms(error, self._action, previous, failed)
        if ended is not None:
            failed &= ~ended
            terms = {name: np.where(ended, 0.0, term) for name, term in terms.items()}
        truncated = (self._index >= self.max_episode_steps) & ~failed
        self._keep_last(failed, before)
        info = self._info_of(terms, error, truncated & (self._worst <= 1))
        if failed.any():
            info |= self._failures(failed, diverged)
        self._done = failed | truncated
        if self._mode == AutoresetMode.SAME_STEP and self._done.any():
            info = self._restarted(info, _TERMS)
        return self._observation, sum(terms.values()), failed, truncated, info

    def _failures(self, failed: np.ndarray, diverged: np.ndarray) -> dict[str, np.ndarray]:
        texts = np.full(self.num_envs, None, dtype=object)
        for i in np.flatnonzero(failed):
            time = self._index[i] * self.control_period
            what = "the simulation diverged" if diverged[i] else "the bar was lost"
            texts[i] = f"{what} by t = {time:.3f} s"
        return {"failure": texts, "_failure": failed.copy()}

    def _begin_again(self, which: np.ndarray) -> None:
        self._begin(which)
        self._observation = self._view()

    def _info_of(
        self,
        terms: dict[str, Any],
        error: np.ndarray | None = None,
        success: np.ndarray | None = None,
    ) -> dict[str, Any]:
        n = self.num_envs
        info = {
            "time": self._index * self.control_period,
            "error": self._error() if error is None else error,
            "success": np.zeros(n, dtype=bool) if success is None else success,
            "bar_position": self.simulation.place,
            **terms,
            **{name: value.copy() for name, value in self._sampled.items()},
        }
        everyone = np.ones(n, dtype=bool)
        return info | {f"_{name}": everyone for name in info}


def _found(given: Any, find: Callable[[str], Any], name: str, kind: type) -> Any:
    """An option, looked up if it is a name; raises ValueError if it is something else."""
    found = find(given) if isinstance(given, str) else given
    check_argument(name, found, kind)
    return found


def _starts(robot: RobotParams) -> np.ndarray:
    """Where a finger's pieces begin, (pieces,) [m]."""
    return robot.backbone.cut(robot.pieces)[:-1]


class GripperEnv(gymnasium.Env[Seen, np.ndarray]):
    """One gripper; see `VectorGripperEnv`, whose arguments it has.

    Attributes:
        gripper, task, simulation: As there.
        shown: (pieces,) [1/m], curvatures whose shapes `render` shows over the true ones, such as
            what calibrated sensors say; true means unless set.
        takes, config: As there.
    """

    spec = EpisodeSpec()
    metadata: ClassVar = {"render_modes": ["rgb_array"], "render_fps": 50}
    takes: ClassVar = (*GRIPPER, *PICTURES)
    usual: ClassVar = _USUAL

    def __init__(self, task: str | GripTask = "hold", **options: Any) -> None:
        """Build the environment; options are those that `GripperEnv.takes` names."""
        self.config = config = EnvConfig.of(type(self), {"task": task, **options})
        self._all = VectorGripperEnv(
            1,
            threads=1,
            autoreset_mode=AutoresetMode.DISABLED,
            **{name: getattr(config, name) for name in GRIPPER},
        )
        self.gripper, self.task = self._all.gripper, self._all.task
        self.simulation = self._all.simulation
        self.control_period = self._all.control_period
        self.max_episode_steps = self._all.max_episode_steps
        self.observe_as, self.vector_layout = self._all.observe_as, self._all.vector_layout
        self.observation_space = self._all.single_observation_space
        self.action_space = self._all.single_action_space
        self.metadata = {**self.metadata, "render_fps": max(1, round(1 / self.control_period))}
        self.render_mode, self._frame = config.render_mode, (config.width, config.height)
        self._renderer: GripperRenderer | None = None
        self._diameter = 0.0
        self.shown: np.ndarray | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """As of `VectorGripperEnv`, for one."""
        super().reset(seed=seed)
        if self._all._generators:
            self._all._generators[0] = self.np_random
        else:
            self._all._generators.append(self.np_random)
        observation, info = self._all.reset(options=options)
        self._diameter = float(info["diameter"][0])
        return _only(observation), _alone(info)

    def step(self, action: np.ndarray) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """As of `VectorGripperEnv`, for one."""
        given = checked_actions(action, self.action_space.shape)
        observation, reward, failed, over, info = self._all.step(given[None])
        return _only(observation), float(reward[0]), bool(failed[0]), bool(over[0]), _alone(info)

    @property
    def metres_per_pixel(self) -> float | None:
        """[m] in the plane of pictures that `render` makes; None before the first."""
        return None if self._renderer is None else self._renderer.metres / self._frame[1]

    def render(self) -> np.ndarray | None:
        """Picture (height, width, 3) uint8 in mode "rgb_array"; None otherwise.

        The fingers' shapes as `shown` has them lie over the true ones.

        Raises:
            RenderError: No OpenGL; says what to install.
            gymnasium.error.ResetNeeded: Nothing was started yet.
        """
        if self._diameter == 0:
            raise gymnasium.error.ResetNeeded("call reset() before render()")
        if self.render_mode is None:
            return None
        if self._renderer is None or self._renderer.diameter != self._diameter:
            self.close()
            self._renderer = GripperRenderer(self.simulation, self._diameter, *self._frame)
        shown = self.simulation.curvature[0] if self.shown is None else self.shown
        return self._renderer.draw(self.simulation.qpos[0], self.simulation.ctrl[0], shown)

    def close(self) -> None:
        """Free the renderer; closing twice is harmless."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def _only(observation: Seen) -> Seen:
    if isinstance(observation, np.ndarray):
        return observation[0]
    return {name: value[0] for name, value in observation.items()}


def _alone(info: dict[str, Any]) -> dict[str, Any]:
    """`info` of one environment: its own values, without masks."""
    out = {name: value[0] for name, value in info.items() if not name.startswith("_")}
    return {n: float64(v) if as_number(v) is not None else v for n, v in out.items()}
