"""How long policies take to decide: from the first decision in a fresh process on, and for many."""

import json
import subprocess
import sys
from collections.abc import Callable
from time import perf_counter, thread_time

import gymnasium
import numpy as np

from softrobot_env.benchmarks.speed.rows import Row
from softrobot_env.control.registry import (
    REDUCED_POLICIES,
    RIG_POLICIES,
    home_robot,
    installed_policies,
    make_policy,
    policy_environment,
)
from softrobot_env.core.interfaces import Policy
from softrobot_env.core.jobs import Progress
from softrobot_env.robots import ARM

WHAT = "decision"

#: Policies of a quick run.
QUICK = ("imitation", "ppo")

#: Decisions one by one, stacked observations, and calls with these.
COUNT, STACKED, _CALLS = 5000, 256, 20

_SCRIPT = """
import json, sys
from softrobot_env.benchmarks.speed.decisions import measure
print(json.dumps(measure(sys.argv[1])))
"""


def run(quick: bool, progress: Progress) -> list[Row]:
    """A row a policy, each from a process of its own."""
    policies = [*installed_policies(), *RIG_POLICIES, *REDUCED_POLICIES]
    names = [name for name in policies if name in QUICK or not quick]
    rows = []
    for name in names:
        progress("decisions", len(rows), len(names))
        rows.append(Row(WHAT, name, **measure_afresh(name)))
    return rows


def measure_afresh(name: str) -> dict[str, float]:
    """`measure` in a fresh interpreter.

    Raises:
        RuntimeError: It failed there.
    """
    command = [sys.executable, "-c", _SCRIPT, name]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"decisions of {name}: {done.stderr.strip().splitlines()[-1]}")
    return json.loads(done.stdout)


def measure(name: str) -> dict[str, float]:
    """How long the decisions of a policy take on its arm or rig, all but the first in motion.

    Returns:
        `period` [s] of the environment; `seconds`, the median over the decisions; `longest` [s], of
        all calls of `predict`, in computing time of this thread: other load does not count, the
        collection of garbage does; and `stacked` [s], the least of a call with as many stacked
        observations as `STACKED`.
    """
    robot = home_robot(name)
    env_id = "SoftRobot/ArmSwing-v0" if robot == ARM else "SoftRobot/RigTriangle-v0"
    env = gymnasium.make(env_id, observe="all", **policy_environment(name, robot)).unwrapped
    policy = make_policy(name, env)
    times, longest, observation = _decide(env, policy)
    many = {key: np.stack([value] * STACKED) for key, value in observation.items()}
    return {
        "period": env.control_period,
        "seconds": float(np.median(times)),
        "longest": longest,
        "stacked": _stacked(lambda state: policy.predict(many, state)[1]),
    }


def _decide(env: gymnasium.Env, policy: Policy) -> tuple[list[float], float, dict[str, np.ndarray]]:
    """Times [s] of decisions in `COUNT` calls, longest computing of one, and the last observation.

    A policy that decides every few calls holds its action in the others.
    """
    (observation, _), state, called = env.reset(seed=0), None, 0
    times, longest = [], 0.0
    for _ in range(COUNT):
        computed, begin = thread_time(), perf_counter()
        action, state = policy.predict(observation, state)
        if called % policy.hold == 0:
            times.append(perf_counter() - begin)
        longest = max(longest, thread_time() - computed)
        observation, _, terminated, truncated, _ = env.step(action)
        called += 1
        if terminated or truncated:
            (observation, _), state, called = env.reset(seed=0), None, 0
    return times, longest, observation


def _stacked(call: Callable[[list | None], list]) -> float:
    """Least time [s] of a call, which takes and returns states, after the first."""
    state, best = call(None), np.inf
    for _ in range(_CALLS):
        begin = perf_counter()
        state = call(state)
        best = min(best, perf_counter() - begin)
    return float(best)
