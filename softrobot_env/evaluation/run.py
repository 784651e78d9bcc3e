"""One episode of a policy in an environment, instant by instant or recorded."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import gymnasium
import numpy as np
from numpy import ndarray

from softrobot_env.core.interfaces import Observation, Policy
from softrobot_env.core.registry import REFUSALS, OutsideError
from softrobot_env.envs.recording import check_observed
from softrobot_env.recordings.recording import at_their_time

from .rollout import Rollout

#: Coordinates x and z, used for positions if an environment does not name its `axes`.
_PLANE = slice(0, 3, 2)

_NOTHING = np.empty(0)
_BLOCK = 4096  # rows, of columns

#: Seconds between progress reports, rare enough not to affect measured times.
_REPORT_EVERY = 0.5

#: Observables that a recorded environment must provide.
RECORDED = ("tip_position", "reference", "previous_action")


@dataclass(frozen=True)
class Moment:
    """The state of an episode at a control instant.

    Attributes:
        observation, info: As returned by `reset` or `step`.
        reward: [1] of the step that led here, zero at the start.
        policy_time: [s] spent in `predict` for that step; None at the start, and while a policy
            that decides less often holds its action (an observer may continue).
        status: Why the policy's action was not the intended one, or None.
        failed: Whether that step failed.
    """

    observation: Observation
    info: dict[str, Any]
    reward: float = 0.0
    policy_time: float | None = None
    status: str | None = None
    failed: bool = False


def play(
    env: gymnasium.Env,
    policy: Policy,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
) -> Iterator[Moment]:
    """Reset, then step to the end of the episode, yielding every instant.

    A policy that declares what it `requires` is shown nothing else.

    Raises:
        OutsideError: The policy requires something that is not observed, fails, or exits the
            program.
    """
    observation, info = env.reset(seed=seed, options=options)
    yield Moment(observation, info)
    names, hold = getattr(policy, "requires", None), getattr(policy, "hold", 1)
    called = getattr(policy, "name", type(policy).__name__)
    unknown = [name for name in names or () if name not in observation]
    if unknown or isinstance(names, str):
        raise OutsideError(
            f"policy {called}: `requires` must be a tuple of what is observed, "
            f"{', '.join(observation)}; got {names!r}"
        )
    state, start, over, count = None, np.array([True]), False, 0
    while not over:
        try:
            seen = observation if names is None else {name: observation[name] for name in names}
            before = perf_counter()
            action, state = policy.predict(seen, state, start, True)
        except REFUSALS:
            raise
        except (Exception, SystemExit) as error:
            raise OutsideError.of(f"policy {called}", error) from error
        policy_time = perf_counter() - before
        start = np.array([False])
        observation, reward, terminated, truncated, info = env.step(action)
        over = terminated or truncated
        decided = policy_time if count % hold == 0 else None
        status = getattr(state, "status", None)
        yield Moment(observation, info, float(reward), decided, status, terminated)
        count += 1


def run_episode(
    env: gymnasium.Env,
    policy: Policy,
    seed: int | None = None,
    options: dict[str, Any] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Rollout:
    """Run one episode to its end.

    Args:
        env: Environment that observes at least `RECORDED` and what the policy needs.
        policy: A policy; it sees only the observables it `requires`, if declared.
        seed, options: Passed to `reset`.
        progress: Shows the time [s] in the episode occasionally.

    Returns:
        The record. After a failure it ends at the last instant before it. If `info` has a
        `tip_age`, the tip's measurements are interpolated from their own times to the control
        instants. The record has no curvature if it is not observed.

    Raises:
        ValueError: The environment does not provide the recorded observables.
    """
    check_observed(env, RECORDED)
    axes = getattr(env.unwrapped, "axes", _PLANE)
    begin = due = perf_counter()
    samples, policy_time, status = Columns(), Columns(), []
    for moment in play(env, policy, seed, options):
        if progress is not None and perf_counter() > due:
            progress(float(moment.info["time"]))
            due = perf_counter() + _REPORT_EVERY
        if moment.policy_time is not None:
            policy_time.add({"policy_time": moment.policy_time})
            status.append(moment.status or "")
        if "failure" not in moment.info:
            samples.add(_sample(moment, axes))
    columns = samples.columns()
    columns["tip"] = at_their_time(columns["time"], columns.pop("tip_age"), columns["tip"])
    return Rollout(
        **columns,
        **policy_time.columns(),
        policy_status=np.array(status),
        wall_time=perf_counter() - begin,
        source=getattr(env.unwrapped, "source", "sim"),
        failure=moment.info.get("failure"),
    )


class Columns:
    """Columns of numbers that grow row by row, with little memory.

    Storing moments would take some thirty times as much, and their page faults would affect policy
    times. They grow by blocks, as doubling a long one would stall what adds to it.
    """

    def __init__(self) -> None:
        self._blocks: list[dict[str, ndarray]] = []
        self._count = 0

    def add(self, row: dict[str, Any]) -> None:
        """Add a row of arrays or numbers, with the same names every time."""
        place = self._count % _BLOCK
        if place == 0:
            first = {name: np.asarray(value) for name, value in row.items()}
            self._blocks.append(
                {
                    name: np.empty((_BLOCK, *value.shape), value.dtype)
                    for name, value in first.items()
                }
            )
        block = self._blocks[-1]
        for name, value in row.items():
            block[name][place] = value
        self._count += 1

    def columns(self) -> dict[str, ndarray]:
        """The columns (rows, ...) by name."""
        if not self._blocks:
            return {}
        *full, last = self._blocks
        left = self._count - _BLOCK * len(full)
        return {
            name: np.concatenate([*(block[name] for block in full), rows[:left]])
            for name, rows in last.items()
        }


def warm_up(env: gymnasium.Env, policy: Policy, options: dict[str, Any] | None = None) -> None:
    """Run one step, so that policy times do not include the work of a first call."""
    one_step = {"duration": env.unwrapped.control_period}
    for _ in play(env, policy, options=(options or {}) | one_step):
        pass


def _sample(moment: Moment, axes: slice) -> dict[str, Any]:
    observation, info = moment.observation, moment.info  # with noise, `info` has the truth
    return {
        "time": info["time"],
        "reference": _in_space(observation["reference"], axes),
        "tip": _in_space(info.get("tip_position", observation["tip_position"]), axes),
        "action": observation["previous_action"],
        "tendon_tension": info["tendon_tension"],
        "tendon_length": info["tendon_length"],
        "curvature": info.get("curvature", observation.get("curvature", _NOTHING)),
        "tip_age": info.get("tip_age", 0.0),
        "reward": moment.reward,
    }


def _in_space(point: ndarray, axes: slice) -> ndarray:
    """(3,) from the two coordinates of an environment, with zero for the other; or unchanged."""
    if len(point) == 3:
        return point
    placed = np.zeros(3)
    placed[axes] = point
    return placed
