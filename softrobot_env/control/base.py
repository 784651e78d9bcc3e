"""Base class of controllers: the law of one robot behind stable-baselines3's `predict`."""

import gc
from abc import ABC, abstractmethod
from math import isfinite
from time import process_time
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import Observation
from softrobot_env.core.records import Positive, check_argument
from softrobot_env.robots import RobotParams
from softrobot_env.robots.actuation import TendonMap

FINE, SATURATED, UNREACHABLE, OUTSIDE, NOT_FINITE, NOT_COMPUTED = range(6)

#: Messages of the codes.
REASONS = {
    FINE: None,
    SATURATED: "tension limit reached",
    UNREACHABLE: "reference out of reach",
    OUTSIDE: "outside the gain table",
    NOT_FINITE: "observation not finite",
    NOT_COMPUTED: "computation not finite",
}


class Memory(NamedTuple):
    """State of a policy that is computed in a kernel.

    Attributes:
        values: (k,), the kernel's memory.
        code: Key of `REASONS`.
    """

    values: ndarray
    code: int

    @property
    def status(self) -> str | None:
        """Why the action is not the intended one, or None."""
        return REASONS[self.code]


class Said(NamedTuple):
    """State of a policy without memory: only the status of its last action.

    Attributes:
        status: Why the action is not the intended one, or None.
    """

    status: str | None


#: What a policy may measure of the state of a robot.
MEASURED = frozenset({"tip_position", "tip_velocity", "curvature", "curvature_rate"})

#: [s], a warm-up call that takes longer has compiled something, or loaded it from the cache.
_COMPILED = 0.02


class Held(NamedTuple):
    """State of a policy that decides less often than it is called.

    Attributes:
        inner: State of its `act`.
        action: (n_inputs,) [1], the current action.
        left: Calls until the next decision.
    """

    inner: Any
    action: ndarray
    left: int

    @property
    def status(self) -> str | None:
        """Why the action, or the resulting motion, is not the intended one, or None."""
        return getattr(self.inner, "status", None)


class Uncomputed(NamedTuple):
    """State of a policy whose decision was not finite: the current action is kept.

    Attributes:
        before: State before that decision, from which the policy continues.
        status: The reason, see `Controller`.
    """

    before: Any
    status: str


class Controller(ABC):
    """A policy written for one robot; `predict` serves one or several environments.

    Subclasses implement `start` and `act`. The object keeps nothing about an episode: that is in
    the state returned by `predict` (a list with one entry per environment for stacked
    observations). A state may have a `status`: why the action, or the resulting motion, is not the
    intended one (tension limit, reference out of reach, bad observation), or None.

    An action of `act` that is not finite is never returned: the current action is kept, `act`
    continues from the previous state, and the status names the observables that are not finite, or
    else the policy's own computation.

    Attributes:
        requires: Observables that the policy reads.
        hold: Number of control periods for which an action is kept.
        sizes: Required sizes of observables, for those where the policy depends on them.
        preview: [s], times ahead at which the environment must show the reference, if that matters.
    """

    requires: tuple[str, ...]
    hold: int = 1
    sizes: ClassVar[dict[str, int]] = {}
    preview: tuple[float, ...] | None = None

    @abstractmethod
    def start(self, observation: Observation) -> Any:
        """State at the beginning of an episode."""

    @abstractmethod
    def act(self, observation: Observation, state: Any) -> tuple[ndarray, Any]:
        """Action (n_inputs,) in [-1, 1], in an array that is not reused, and next state."""

    def predict(
        self,
        observation: Observation,
        state: Any = None,
        episode_start: ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[ndarray, Any]:
        """See `softrobot_env.core.interfaces.Policy`.

        Raises:
            ValueError: The observation lacks an observable in `requires`, one has a size the
                policy cannot use (checked when an episode starts), or state or episode_start
                belong to another number of environments.
        """
        first = observation.get(self.requires[0])
        if first is None or first.ndim > 1:
            self._check(observation)
            return self._predict_stacked(observation, state, episode_start)
        if isinstance(state, list):
            raise ValueError(f"one observation, but the state of {len(state)} environments")
        if state is None or (episode_start is not None and _single(episode_start)):
            self._check(observation)
            return self._decide(observation, self.start(observation))
        if self.hold == 1:
            return self._choose(observation, state)
        return self._go_on(observation, state)

    def _check(self, observation: Observation) -> None:
        missing = [name for name in self.requires if name not in observation]
        if missing:
            raise ValueError(
                f"{type(self).__name__} needs the observables {', '.join(self.requires)}; add "
                f"{', '.join(missing)} to the environment's observe="
            )
        for name, size in self.sizes.items():
            found = observation[name].shape[-1]
            if found != size:
                cure = "it is made for another robot or number of pieces than the environment"
                if name == "reference_preview":
                    cure = f"give the environment preview={self.preview}"
                raise ValueError(
                    f"{type(self).__name__} needs {size} entries of {name}, not {found}: {cure}"
                )

    def warm_up(self, robot: RobotParams) -> None:
        """Decide for a robot at rest, so that no later decision waits for compilation.

        Called by `make_policy`. It takes three decisions, because some laws compute more once they
        have a history. A policy that does not declare the `sizes` of everything it `requires` is
        not warmed up.
        """
        if not set(self.requires) <= self.sizes.keys():
            return
        begin = process_time()
        observation = _at_rest(robot, self.sizes)
        state = self.start(observation)
        for _ in range(3):
            _, state = self.act(observation, state)
        if process_time() - begin > _COMPILED:  # collect the garbage of compilation now
            gc.collect()

    def _go_on(self, observation: Observation, state: Any) -> tuple[ndarray, Any]:
        if state.left:
            action = state.action.copy()  # the caller may modify it
            return action, Held(state.inner, state.action, state.left - 1)
        return self._decide(observation, state.inner)

    def _decide(self, observation: Observation, inner: Any) -> tuple[ndarray, Any]:
        action, inner = self._choose(observation, inner)
        return action, inner if self.hold == 1 else Held(inner, action.copy(), self.hold - 1)

    def _choose(self, observation: Observation, state: Any) -> tuple[ndarray, Any]:
        """Finite action (n_inputs,) as float32, and next state."""
        before = state.before if type(state) is Uncomputed else state
        action, state = self.act(observation, before)
        if not isfinite(sum(action.tolist())):  # far faster than NumPy's
            action, state = self._failed(observation, action, before)
        return action.astype(np.float32, copy=False), state

    def _failed(
        self, observation: Observation, action: ndarray, before: Any
    ) -> tuple[ndarray, Uncomputed]:
        """The current action, if known, in place of one that is not finite, and the reason."""
        kept = in_force({"previous_action": np.zeros_like(action), **observation})
        bad = [name for name in self.requires if not np.isfinite(observation[name]).all()]
        why = f"{REASONS[NOT_FINITE]}: {', '.join(bad)}" if bad else REASONS[NOT_COMPUTED]
        return kept, Uncomputed(before, why)

    def _predict_stacked(
        self, observation: Observation, state: Any, episode_start: ndarray | None
    ) -> tuple[ndarray, list[Any]]:
        count = len(observation[self.requires[0]])
        if state is not None and (not isinstance(state, list) or len(state) != count):
            found = len(state) if isinstance(state, list) else 1
            raise ValueError(f"observations of {count} environments, but the state of {found}")
        states = [None] * count if state is None else state
        starts = np.ravel(False if episode_start is None else episode_start)
        if starts.size not in (1, count):
            raise ValueError(f"episode_start has {starts.size} entries for {count} environments")
        starts = np.broadcast_to(starts, count).tolist()
        return self._decide_stacked(
            observation, [None if s else state for s, state in zip(starts, states, strict=True)]
        )

    def _decide_stacked(
        self, observation: Observation, states: list[Any]
    ) -> tuple[ndarray, list[Any]]:
        """Actions (k, n_inputs) and next states for as many observations and states.

        A state of None begins an episode. Here the decisions are made one after the other;
        `control.memoryless` makes them all in one call.
        """
        each = [{name: observation[name][i] for name in self.requires} for i in range(len(states))]
        decided = [self.predict(one, state) for one, state in zip(each, states, strict=True)]
        return np.stack([action for action, _ in decided]), [state for _, state in decided]


class Hold(Controller):
    """Repeat the action of the start; the baseline that every controller has to beat."""

    requires = ("previous_action",)

    def __init__(self, robot: RobotParams, control_period: float) -> None:
        """Works for any robot and any control period [s]."""

    def start(self, observation: Observation) -> ndarray:
        """The action to keep."""
        return usable(observation["previous_action"])

    def act(self, observation: Observation, state: ndarray) -> tuple[ndarray, ndarray]:
        """The kept action."""
        return state.copy(), state


def _single(episode_start: ndarray) -> bool:
    """Whether the episode of a single environment starts."""
    try:
        return bool(episode_start)
    except ValueError:
        raise ValueError(
            f"episode_start has {np.size(episode_start)} entries for one environment"
        ) from None


def _at_rest(robot: RobotParams, sizes: dict[str, int]) -> dict[str, ndarray]:
    """Observables of these sizes for a straight robot on its reference, without tension."""
    coordinates = sizes.get("reference", sizes.get("tip_position", 2))
    tip = np.zeros(coordinates)
    if robot.is_planar or coordinates == 3:
        tip[-1] = robot.length
    places = {"tip_position", "reference", "reference_preview"}
    return {
        name: np.resize(tip, size) if name in places else np.zeros(size)
        for name, size in sizes.items()
    }


def state_sizes(robot: RobotParams) -> dict[str, int]:
    """Sizes of the observables for the state of a planar robot and its inputs."""
    return {
        "curvature": robot.pieces,
        "curvature_rate": robot.pieces,
        "tip_position": 2,
        "reference": 2,
        "previous_action": TendonMap(robot).n_inputs,
    }


def usable(values: ndarray) -> ndarray:
    """Values (k,) with those that are not finite replaced by zero."""
    return np.where(np.isfinite(values), values, 0.0)


def in_force(observation: Observation) -> ndarray:
    """The previous action (n_inputs,), with zeros where it is not finite."""
    return np.clip(usable(observation["previous_action"]), -1.0, 1.0)


def hold_for(period: float, control_period: float, policy: str) -> int:
    """Number of control periods in a policy's period [s].

    Raises:
        ValueError: It is not a whole number of them.
    """
    check_argument("control_period", control_period, Positive)
    count = round(period / control_period)
    if count < 1 or abs(count * control_period - period) > 1e-9:
        raise ValueError(
            f"{policy} decides every {period:g} s: give the environment a control_period that "
            f"divides it, not {control_period:g} s"
        )
    return count
