"""Where the time of a training goes: physics, Python about it, networks and their updates."""

from collections.abc import Callable
from dataclasses import replace
from time import process_time
from typing import Any

from softrobot_env.benchmarks.scale.rows import Row, cost_of
from softrobot_env.training.rl_config import preset

WHAT, ALGORITHMS = "training", ("ppo", "sac")

#: Environment steps of all environments together that are timed, and those before.
_STEPS, _QUICK_STEPS, _FIRST = {"ppo": 16_384, "sac": 4_096}, {"ppo": 2_048, "sac": 512}, 64


class _Timer:
    """Computing time spent in a function."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def around(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, timed."""

        def timed(*args: Any, **kwargs: Any) -> Any:
            begin = process_time()
            try:
                return function(*args, **kwargs)
            finally:
                self.seconds += process_time() - begin

        return timed


def run(quick: bool) -> list[Row]:
    """A row for each algorithm, from scratch with its usual settings, on one core."""
    return [_row(name, (_QUICK_STEPS if quick else _STEPS)[name]) for name in ALGORITHMS]


def _row(algorithm: str, steps: int) -> Row:
    import torch

    from softrobot_env.training.learners import make_model
    from softrobot_env.training.rl import make_training_env

    torch.set_num_threads(1)
    config = replace(preset(algorithm, False, False), warm_up=_FIRST)
    env = make_training_env(config, 0)
    model = make_model(config, env, 0)
    model.learn(_FIRST)  # what is compiled at its first use
    physics, stepped = _Timer(), _Timer()
    env.step_wait = stepped.around(env.step_wait)
    for part in env.parts:
        part.simulation.advance = physics.around(part.simulation.advance)
    begin = process_time()
    model.learn(steps)
    taken = process_time() - begin
    done, period = model.num_timesteps, env.parts[0].control_period
    env.close()
    return Row(
        WHAT,
        algorithm,
        cores=1,
        physics=physics.seconds / taken,
        python=(stepped.seconds - physics.seconds) / taken,
        learner=1 - stepped.seconds / taken,
        **cost_of(done * period / taken),
    )
