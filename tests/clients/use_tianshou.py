"""Tianshou: its vectors, and a collector with random actions."""

from functools import partial

import gymnasium
from tianshou.algorithm.algorithm_base import RandomActionPolicy
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv, SubprocVectorEnv
from uses import SIMULATED, tried

STEPS = 24


def collect(env_id: str, kind: type) -> None:
    envs = kind([partial(gymnasium.make, env_id, control_period=0.2)] * 2)
    policy = RandomActionPolicy(envs.action_space[0])
    collector = Collector(policy, envs, VectorReplayBuffer(STEPS, 2))
    assert collector.collect(n_step=STEPS, reset_before_collect=True).n_collected_steps == STEPS
    envs.close()


for kind in (DummyVectorEnv, SubprocVectorEnv):
    tried(f"Collector, {kind.__name__}", SIMULATED, partial(collect, kind=kind))
