"""Learning curves of `benchmarks.learning`."""

from pathlib import Path

import numpy as np

from softrobot_env.benchmarks.jobs import Row

_COLOURS = {
    "ppo": "#1f77b4",
    "ppo_randomized": "#17becf",
    "sac": "#d62728",
    "sac_randomized": "#ff7f0e",
    "ppo_tuned": "#7f7f7f",
}


def plot(rows: list[Row], path: Path | str) -> None:
    """Draw the trials over environment steps: median of the seeds, and all that lies between."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    for name in dict.fromkeys(row["policy"] for row in rows if row["curve"]):
        curves = [row["curve"] for row in rows if row["policy"] == name]
        for axis, entry in zip(axes, ("reward", "max_mm"), strict=True):
            steps, values = _common(curves, entry)
            steps = steps / 1e6
            colour = _COLOURS.get(name, "black")
            axis.plot(steps, np.median(values, axis=0), color=colour, label=name)
            axis.fill_between(
                steps, values.min(axis=0), values.max(axis=0), color=colour, alpha=0.2, lw=0
            )
    axes[0].set_ylabel("mean reward of the trials")
    axes[1].set_ylabel("largest error on swing and L-shape [mm]")
    axes[1].set_yscale("log")
    for axis in axes:
        axis.set_xlabel("environment steps [million]")
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    figure.suptitle("Trials of the mean action during training: median and range of the seeds")
    figure.savefig(path, dpi=130)
    pyplot.close(figure)


def _common(curves: list[list[dict[str, float]]], entry: str) -> tuple[np.ndarray, np.ndarray]:
    """Steps (k,) of the trials of all seeds, and values (seeds, k)."""
    count = min(len(curve) for curve in curves)
    steps = np.array([point["steps"] for point in curves[0][:count]])
    return steps, np.array([[point[entry] for point in curve[:count]] for curve in curves])
