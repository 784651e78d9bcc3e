"""Table of `benchmarks.ppo_defaults`."""

from collections.abc import Sequence

from rich.console import Group

from softrobot_env.benchmarks.ppo_defaults.cases import ENVIRONMENTS
from softrobot_env.benchmarks.ppo_defaults.run import Row
from softrobot_env.rendering.tables import Column, make_table, verdict

_COLUMNS = (
    Column("environment", "case"),
    Column("seed", "seed", "d"),
    Column("steps", "steps", "d"),
    Column("mean error mm", "error", ".3g", "mm"),
    Column("goal mm", "goal", ".3g", "mm"),
    Column("goal is", lambda row: row.goal_policy or "given"),
    Column("met", lambda row: verdict(row.good), ">"),
    Column("minutes", "minutes", ".2g"),
)


def tables(rows: Sequence[Row]) -> Group:
    """One line per training."""
    title = "PPO as stable-baselines3 comes, from nothing"
    return Group(make_table(title, _COLUMNS, rows), _NOTES)


_NOTES = (
    f'PPO("MlpPolicy", env) on {ENVIRONMENTS} environments of make_vec_env(id, {ENVIRONMENTS}, '
    'observe_as="vector"). Mean error over whole episodes, the first instants of a step included, '
    "of the mean action; a goal that is a policy is its mean error on the same episodes."
)
