"""TorchRL: one environment, Gymnasium's vectors of several, and the batch."""

from functools import partial

import gymnasium
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from torchrl.envs import GymEnv, GymWrapper
from torchrl.envs.utils import check_env_specs
from uses import SIMULATED, tried

STEPS = 12
#: TorchRL takes these two of Gymnasium's modes.
MODES = (AutoresetMode.DISABLED, AutoresetMode.SAME_STEP)


def roll(env) -> None:
    check_env_specs(env, break_when_any_done=False) if env.batch_size else check_env_specs(env)
    assert env.rollout(STEPS, break_when_any_done=False).shape[-1] == STEPS
    env.close()


def alone(env_id: str) -> None:
    roll(GymEnv(env_id))


def with_info(env_id: str) -> None:
    env = GymEnv(env_id)
    env.auto_register_info_dict()
    assert env.rollout(STEPS)["next", "reward_tracking"].shape[0] == STEPS


def several(env_id: str, mode: AutoresetMode) -> None:
    makers = [partial(gymnasium.make, env_id, control_period=0.1)] * 2
    roll(GymWrapper(SyncVectorEnv(makers, autoreset_mode=mode)))


def many(env_id: str, mode: AutoresetMode) -> None:
    roll(GymWrapper(gymnasium.make_vec(env_id, num_envs=3, autoreset_mode=mode)))


def through_the_end(env_id: str, mode: AutoresetMode) -> None:
    """Episodes of four steps, so that the rollout passes ends and restarts."""
    env = GymWrapper(
        gymnasium.make_vec(env_id, num_envs=3, autoreset_mode=mode, max_episode_steps=4)
    )
    data = env.rollout(STEPS, break_when_any_done=False)
    ends = data["next", "truncated"][..., 0].sum(dim=-1)
    assert ends.tolist() == [STEPS // 4] * 3, ends


tried("GymEnv, one", SIMULATED, alone)
tried("GymEnv, one, with info", SIMULATED, with_info)
for mode in MODES:
    tried(f"SyncVectorEnv, {mode.value}", SIMULATED, partial(several, mode=mode))
for mode in MODES:
    tried(f"batch, {mode.value}", SIMULATED, partial(many, mode=mode))
for mode in MODES:
    tried(f"batch, {mode.value}, several episodes", SIMULATED, partial(through_the_end, mode=mode))
