"""What Gymnasium knows of an environment that was made by its id."""

from copy import copy
from typing import Any

from gymnasium.envs.registration import EnvSpec


class EpisodeSpec:
    """The attribute `spec`, which is told how many steps the environment's episodes have.

    Episodes end by themselves, so the registry asks for no wrapper that ends them. How long they
    are depends on the arguments: `spec.max_episode_steps` is the environment's own
    `max_episode_steps`, that of episodes without the reset option `duration`.
    """

    def __get__(self, env: Any, _kind: type) -> EnvSpec | None:
        return None if env is None else env.__dict__.get("_spec")

    def __set__(self, env: Any, spec: EnvSpec | None) -> None:
        env._spec = spec = copy(spec)
        if spec is not None:
            spec.max_episode_steps = env.max_episode_steps
