"""Policies that drive episodes of any environment, and the results of episodes."""

import numpy as np


def hold(env, _observation, _rng):
    return env._parts.inputs.to_actions(np.array(env.task.start_input)).astype(np.float32)


def uniform(env, _observation, rng):
    return rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)


def switching(env, _observation, rng):
    return rng.choice([-1.0, 1.0], env.action_space.shape).astype(np.float32)


def pumping(env, observation, _rng):
    """Full tension in the direction of bending: as much energy as the tendons can give."""
    side = 1.0 if np.sum(observation["curvature_rate"]) >= 0 else -1.0
    return np.full(env.action_space.shape, side, dtype=np.float32)


POLICIES = {f.__name__: f for f in (hold, uniform, switching, pumping)}


def steps(env, policy, limit=None, seed=0):
    """Results of stepping the running episode until it ends, or for `limit` steps."""
    rng = np.random.default_rng(seed)
    observation = {"curvature_rate": np.zeros(6)}
    taken = 0
    while limit is None or taken < limit:
        result = env.step(policy(env, observation, rng))
        observation = result[0]
        taken += 1
        yield result
        if result[2] or result[3]:
            return
