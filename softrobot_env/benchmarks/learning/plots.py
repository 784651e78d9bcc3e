"""Learning curves of `benchmarks.learning`."""

from pathlib import Path

from softrobot_env.benchmarks.learning.run import Row
from softrobot_env.benchmarks.records import groups
from softrobot_env.rendering.figures import style_of
from softrobot_env.rendering.learning import plot_checks

_TITLE = (
    "Checks of the mean action during training, swing and L-shape also with E x 0.5 and x 1.5: "
    "median and range of the seeds"
)


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw the checks over environment steps: median of the seeds, and all that lies between."""
    learned = groups((row for row in rows if row.curve), "policy")
    trainings = {
        name: (style_of(name), [row.curve for row in mine]) for (name,), mine in learned.items()
    }
    plot_checks(trainings, _TITLE, path)
