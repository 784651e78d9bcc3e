"""Learning curves of `benchmarks.ppo_defaults`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from softrobot_env.benchmarks.ppo_defaults.run import Row
from softrobot_env.benchmarks.records import groups
from softrobot_env.rendering.figures import (
    COLOURS,
    REFERENCE,
    add_legend,
    add_title,
    new_figure,
    plain_ticks,
    save,
)


def plot(rows: Sequence[Row], path: Path) -> None:
    """Draw the mean error over environment steps, each seed a line, and the goal."""
    cases = groups(rows, "case")
    figure, (axes,) = new_figure(1, len(cases), (2.5 * len(cases), 3.3))
    for axis, ((name,), mine) in zip(np.atleast_1d(axes), cases.items(), strict=True):
        for row, colour in zip(mine, COLOURS, strict=False):
            steps, errors = zip(*row.curve, strict=True)
            values = [np.nan if error is None else 1e3 * error for error in errors]
            axis.plot(np.array(steps) / 1e3, values, ".-", color=colour, label=f"seed {row.seed}")
        axis.axhline(1e3 * mine[0].goal, **{**REFERENCE, "label": "goal"})
        axis.set(title=name, yscale="log", xlabel="thousand steps")
        plain_ticks(axis, "y")
    axes[0].set_ylabel("mean error [mm]")
    good = sum(row.good for row in rows)
    title = f"PPO with its default settings reaches the goal in {good} of {len(rows)} trainings"
    add_title(figure, title)
    add_legend(figure, axes[0])
    save(figure, path)
