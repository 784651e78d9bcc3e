"""Grippers that enclose a clamped bar, or grasp and hold a free one: single or vectorised."""

from collections.abc import Callable
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy import float64, ndarray
from numpy.linalg import norm

from softrobot_env.core.interfaces import Seen
from softrobot_env.core.records import check_argument
from softrobot_env.robots import Gripper, as_number, find_gripper
from softrobot_env.scene.assembly import FINENESS, Resolution
from softrobot_env.tasks.gripper import GRIP_TASKS, POSITIVE, SAMPLED, GripTask

from .config import GRIPPER, MANY, PICTURES, ControlPeriod, EnvConfig
from .observations.table import each_of
from .options import MASK, checked_actions
from .parts import EpisodeSpec
from .rendering import GripperRenderer, Pictured
from .rewards import GripReward
from .simulation.grippers import SENSORS, FingerSensors, GripperBatch, GripperView, seen_by
from .vector import BatchEnv

#: Quantities of which each finger has one, and vectors: pulls and shaking.
_OF_FINGERS, _VECTORS = ("modulus", "arm"), ("pull", "shake")

_USUAL = {"task": "hold", "control_period": 0.02, "observe": ("curvature", "tendon_tension")}


class VectorGripperEnv(BatchEnv, gymnasium.vector.VectorEnv[Seen, ndarray, ndarray]):
    """Grippers on a thread pool; `GripperEnv` is one of them.

    An action in [-1, 1] is the tension of a tendon between zero and its limit. Observations are
    float64 in SI units: `curvature` and `curvature_rate` (means over each piece of each finger, as
    measured by ideal sensors), `tendon_tension`, `sensors` (readings of each finger's sensors,
    whose errors are sampled for every episode), `contact` (size of each finger's force on the bar)
    and `previous_action`; or, with observe_as="vector", one float32 vector of order 1. `info` is
    flat: time, the terms of the reward by name, error (relative to the limit for success), success
    (only at the end), the sampled values, and the position of the bar.

    An episode starts with straight fingers, a new bar and new fingers. Options of `reset` replace
    sampled values, by their names in `tasks.gripper.SAMPLED`, each a number or an array of n;
    `modulus` and `arm` may also be given per finger, `pull` and `shake` are magnitudes, in a
    sampled direction, or vectors (3,).

    Attributes:
        gripper, task: The gripper and its task.
        simulation: Simulation of all grippers.
    """

    takes: ClassVar = (*GRIPPER, *MANY)
    usual: ClassVar = _USUAL

    def __init__(self, num_envs: int = 1, task: str | GripTask = "hold", **options: Any) -> None:
        """Build the environments.

        Args:
            num_envs: Their number n.
            task: A name from `GRIP_TASKS`, or a task.
            **options: Those named in `VectorGripperEnv.takes`, see `config.EnvConfig`.

        Raises:
            ValueError: An option out of range; the message names what is allowed.
            TypeError: An unknown option.

        Warns:
            TimestepWarning: The given timestep is longer than the rule allows.
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
        self.simulation = GripperBatch(self.gripper, self.task, config, fineness)
        self.sensors = None
        if SENSORS in seen_by(config):
            self.sensors = FingerSensors(self.simulation, self.control_period)
        self._view = GripperView(self.simulation, config, lambda: self._action.copy(), self.sensors)
        self.observe_as, self.vector_layout = config.observe_as, self._view.layout
        action_space = gymnasium.spaces.Box(-1.0, 1.0, self._limits.shape, np.float32)
        self._prepare(config, self._view.space, action_space)
        shapes = dict.fromkeys(_OF_FINGERS, (n, len(fingers))) | dict.fromkeys(_VECTORS, (n, 3))
        self._sampled = {name: np.zeros(shapes.get(name, n)) for name in SAMPLED}
        self._worst, self._home = np.zeros(n), np.zeros((n, 3))
        self._last[:] = self.max_episode_steps
        starts = [finger.robot.backbone.cut(finger.robot.pieces)[:-1] for finger in fingers]
        self._enclosable = np.array([(k, s) for k, own in enumerate(starts) for s in own])

    # ------------------------------------------------------------------ episodes

    def _parsed(self, given: dict[str, Any]) -> Callable[[ndarray], None]:
        fixed = {name: self._value(name, value) for name, value in given.items()}
        return lambda which: self._begin(which, fixed)

    def _value(self, name: str, value: Any) -> ndarray:
        """An option as an array that broadcasts to the sampled values."""
        if name not in SAMPLED:
            raise ValueError(f"unknown option {name!r}; allowed are {', '.join(SAMPLED)}, {MASK}")
        shape = self._sampled[name].shape
        try:
            values = np.asarray(value, float)
            is_vector = name in _VECTORS and values.shape == (3,)
            if name in _VECTORS and not is_vector:  # a size
                shape = (self.num_envs,)
            values = np.broadcast_to(values, shape)
        except (TypeError, ValueError):
            values, is_vector = np.array([np.nan]), False
        positive = name in POSITIVE
        known = np.isfinite(values) & (is_vector | (values > 0 if positive else values >= 0))
        if not known.all():
            raise ValueError(
                f"option {name!r} must be finite and {'positive' if positive else 'zero or more'}, "
                f"one number or one for each of {self.num_envs}, got {value!r}"
            )
        return values

    def _begin(self, which: ndarray, fixed: dict[str, ndarray] | None = None) -> None:
        """Start episodes of the environments `which` (k,)."""
        for i in which:
            for name, value in self._sample(self._generators[i]).items():
                self._sampled[name][i] = value
        for name, value in (fixed or {}).items():
            own = self._sampled[name]
            if name in _VECTORS and value.ndim == 1:
                sizes = norm(own[which], axis=1, keepdims=True)
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
        for name in SAMPLED:
            ends = getattr(self.task, name)
            size = len(self.gripper.fingers) if name in _OF_FINGERS else None
            out[name] = rng.uniform(*ends, size)
            if name in _VECTORS:
                direction = rng.standard_normal(3)
                # The magnitude is not exactly zero, so that a given direction is kept.
                out[name] = max(out[name], 1e-12) * direction / norm(direction)
        return out

    def _set_threshold(self) -> None:
        """Pieces (n, pieces) bool of straight fingers that lie beyond the contact with the bar."""
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

    def _act(self, actions: ndarray, ended: ndarray | None) -> None:
        self._action = actions
        self.simulation.ctrl[:] = (actions + 1) / 2 * self._limits
        self.simulation.push(*self._disturbances())

    def _disturbances(self) -> tuple[ndarray, ndarray]:
        """Pulls (n, 3) [N] and accelerations of the palm (n, 3) [m/s2] in this period."""
        if not self.task.free:
            return np.zeros((self.num_envs, 3)), np.zeros((self.num_envs, 3))
        since = self._index * self.control_period - self.task.closing
        rise = (self.task.duration - self.task.closing) / 2
        share = np.clip(since / rise, 0.0, 1.0)[:, None]
        wave = np.where(since > 0, np.sin(2 * np.pi * self._sampled["rate"] * since), 0.0)[:, None]
        return self._sampled["pull"] * share, self._sampled["shake"] * wave

    def _advance(self, ended: ndarray | None) -> ndarray:
        diverged = super()._advance(ended)
        if self.sensors is not None and (ended is None or not ended.all()):
            self.sensors.look(None if ended is None else np.flatnonzero(~ended))
        return diverged

    def _observe(self, started: ndarray | None = None) -> Seen:
        self._error = self._off()
        self._worst = np.maximum(self._worst, self._error) if self.task.free else self._error
        return self._view()

    def _off(self) -> ndarray:
        """The error (n,) [1], relative to the limit for success."""
        if self.task.free:
            return norm(self.simulation.place - self._home, axis=1) / self.task.within
        radius = self._sampled["diameter"] / 2
        width = [f.robot.backbone.widest for f in self.gripper.fingers]
        rho = radius[:, None] + np.array(width)[self._enclosable[:, 0].astype(int)]
        off = np.abs(self.simulation.curvature * rho - 1)
        return np.sum(off * self._beyond, axis=1) / self.task.within

    def _outside(self) -> ndarray:
        lost = ~np.isfinite(self.simulation.qvel).all(axis=1)
        return (
            lost | ~(self._error * self.task.within <= self.task.lost) if self.task.free else lost
        )

    def _terms(self, previous: ndarray) -> dict[str, ndarray]:
        return self._reward.batch_terms(self._error, self._action, previous)

    def _what_failed(self, i: int, diverged: bool, time: float) -> str:
        what = "the simulation diverged" if diverged else "the bar was lost"
        return f"{what} by t = {time:.3f} s"

    def _info_of(self, terms: dict[str, Any], over: ndarray | None = None) -> dict[str, Any]:
        info = {
            "time": self._index * self.control_period,
            "error": self._error,
            "success": ~self._everyone if over is None else over & (self._worst <= 1),
            "bar_position": self.simulation.place,
            **terms,
            **{name: value.copy() for name, value in self._sampled.items()},
        }
        return self._masked(info)


def _found(given: Any, find: Callable[[str], Any], name: str, kind: type) -> Any:
    """An option, looked up if it is a name; raises ValueError for anything else."""
    found = find(given) if isinstance(given, str) else given
    check_argument(name, found, kind)
    return found


#: Attributes that a single gripper shares with the vectorised one.
_SHARED = ("gripper", "task", "simulation", "control_period", "max_episode_steps")
_SHARED += ("observe_as", "vector_layout")


class GripperEnv(Pictured, gymnasium.Env[Seen, ndarray]):
    """One gripper, with the arguments of `VectorGripperEnv`.

    Attributes:
        gripper, task, simulation: As there.
        shown: (pieces,) [1/m], curvatures whose shapes `render` draws over the true ones, such as
            those of calibrated sensors; by default the true means.
        takes, config: As there.
    """

    spec = EpisodeSpec()
    metadata: ClassVar = {"render_modes": ["rgb_array"], "render_fps": 50}
    takes: ClassVar = (*GRIPPER, *PICTURES)
    usual: ClassVar = _USUAL

    def __init__(self, task: str | GripTask = "hold", **options: Any) -> None:
        """Build the environment; options are those named in `GripperEnv.takes`."""
        self.config = config = EnvConfig.of(type(self), {"task": task, **options})
        self._all = VectorGripperEnv(
            1,
            threads=1,
            autoreset_mode=AutoresetMode.DISABLED,
            **{name: getattr(config, name) for name in GRIPPER},
        )
        for name in _SHARED:
            setattr(self, name, getattr(self._all, name))
        self.observation_space = self._all.single_observation_space
        self.action_space = self._all.single_action_space
        self._take_pictures(config)
        self.shown: ndarray | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """See `VectorGripperEnv`, for one gripper."""
        super().reset(seed=seed)
        self._all._generators[:] = [self.np_random]
        observation, info = self._all.reset(options=options)
        return each_of(observation, _first), _alone(info)

    def step(self, action: ndarray) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """See `VectorGripperEnv`, for one gripper."""
        given = checked_actions(action, self.action_space.shape)
        observation, reward, failed, over, info = self._all.step(given[None])
        return (
            each_of(observation, _first),
            float(reward[0]),
            bool(failed[0]),
            bool(over[0]),
            _alone(info),
        )

    def render(self) -> ndarray | None:
        """Picture (height, width, 3) uint8 in mode "rgb_array"; None otherwise.

        The shapes of `shown` are drawn over the fingers.

        Raises:
            RenderError: No OpenGL; the message says what to install.
            gymnasium.error.ResetNeeded: No episode has been started.
        """
        diameter = float(self._all._sampled["diameter"][0])
        if diameter == 0:
            raise gymnasium.error.ResetNeeded("call reset() before render()")
        if self.render_mode is None:
            return None
        if self._renderer is None or self._renderer.diameter != diameter:
            self.close()
            self._renderer = GripperRenderer(self.simulation, diameter, *self._frame_size)
        shown = self.simulation.curvature[0] if self.shown is None else self.shown
        return self._renderer.draw(self.simulation.qpos[0], self.simulation.ctrl[0], shown)


def _first(values: ndarray) -> ndarray:
    return values[0]


def _alone(info: dict[str, Any]) -> dict[str, Any]:
    """`info` of one environment: its own values, without masks."""
    out = {name: value[0] for name, value in info.items() if not name.startswith("_")}
    return {n: float64(v) if as_number(v) is not None else v for n, v in out.items()}
