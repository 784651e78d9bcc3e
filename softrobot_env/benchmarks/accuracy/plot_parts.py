"""What the figures of the accuracy benchmark share: styles, fronts of runs and legends."""

from typing import TYPE_CHECKING, Any

from softrobot_env.benchmarks.accuracy.rows import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Okabe and Ito's colours, and a brown, and a marker for each model.
STYLE = {
    "mujoco_chain": ("#0072B2", "o", "MuJoCo chain"),
    "pcc/lumped": ("#E69F00", "s", "PCC, lumped mass"),
    "pcc/distributed": ("#D55E00", "D", "PCC, distributed mass"),
    "rig_piece": ("#8C510A", "X", "one piece, closed form"),
    "pcc/subpieces": ("#F0E442", "s", "PCC, three bodies"),
    "cosserat": ("#009E73", "^", "Cosserat rod"),
    "ancf": ("#CC79A7", "v", "ANCF"),
    "pyelastica": ("#000000", "P", "PyElastica"),
}

#: A run joins a model's best ones if its error is smaller by at least this factor.
_GAIN = 0.85


def family(row: Row) -> str:
    """Model of a row; all hinge rules are one."""
    return "mujoco_chain" if row["model"].startswith("mujoco") else row["model"]


def front(rows: list[Row], error: str = "e_mean") -> list[Row]:
    """Rows that no faster one beats in an error, by a margin, fastest first."""
    out: list[Row] = []
    for row in sorted(rows, key=lambda row: (row["wall_time"], row[error])):
        if not out or row[error] < _GAIN * out[-1][error]:
            out.append(row)
    return out


def draw_front(axes: "Axes", model: str, rows: list[Row], error: str) -> None:
    """All runs of a model as faint points, those that none beats joined."""
    color, marker, _ = STYLE[model]
    for chosen, style in (
        (rows, {"linestyle": "", "markersize": 3, "alpha": 0.35, "markeredgewidth": 0}),
        (front(rows, error), {"linewidth": 1.4, "markersize": 5}),
    ):
        axes.plot(
            [1e3 * r["wall_time"] for r in chosen],
            [1e3 * r[error] for r in chosen],
            color=color,
            marker=marker,
            **style,
        )


def plain_ticks(axes: "Axes") -> None:
    """Numbers without powers of ten."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def draw_legend(figure: Any, models: set[str]) -> None:
    """Legend below a figure for some models."""
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=color, marker=marker, markersize=5, linewidth=1.4, label=label)
        for model, (color, marker, label) in STYLE.items()
        if model in models
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9)
