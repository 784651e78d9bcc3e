"""Cells of the tables of the controller benchmark."""

from collections.abc import Sequence

from rich import box
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.controllers.cases import Row

#: Key of a row -> (what it is, unit shown, factor from SI, digits).
METRICS = {
    "e_max": ("max", "mm", 1e3, 2),
    "e_rms": ("rms", "mm", 1e3, 3),
    "e_final": ("final", "mm", 1e3, 2),
    "e_motion": ("motion", "mm", 1e3, 2),
    "rise_time": ("rise", "ms", 1e3, 0),
    "settling_time": ("settling", "s", 1.0, 2),
    "overshoot": ("over", "%", 100.0, 1),
    "steady_state_error": ("steady", "%", 100.0, 2),
    "tension_max": ("tension", "N", 1.0, 0),
    "policy_time_median": ("policy", "us", 1e6, 1),
    "policy_time_p99": ("p99", "us", 1e6, 1),
    "e_max_ratio": ("max", "", 1.0, 2),
    "e_rms_ratio": ("rms", "", 1.0, 2),
    "failures": ("failures", "", 1.0, 0),
}

_LEAST_STEADY_ERROR = 1e-4


def new_table(title: str, left: Sequence[str], right: Sequence[str]) -> Table:
    """An empty table with columns of text, which fold on a narrow terminal, and of numbers."""
    out = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for head in left:
        out.add_column(head, overflow="fold")
    for head in right:
        out.add_column(head, justify="right", no_wrap=True)
    return out


def number(value: float | None, metric: str) -> str:
    """A value in the unit of its metric; a dash for none.

    Large numbers have fewer decimals. A steady-state error is told down to the 0.01 % that the
    thesis uses as a bound.
    """
    if value is None:
        return "-"
    if metric == "steady_state_error" and value <= _LEAST_STEADY_ERROR:
        return f"<{100 * _LEAST_STEADY_ERROR:g}"
    _, _, factor, digits = METRICS[metric]
    scaled = factor * value
    most = 3 - sum(abs(scaled) >= size for size in (1, 10, 100))
    return f"{scaled:.{min(digits, most)}f}"


def with_unit(value: float | None, metric: str) -> str:
    """Three digits of a value, and its unit."""
    if value is None:
        return "-"
    _, unit, factor, _ = METRICS[metric]
    scaled = factor * value
    return f"{scaled:.{'0f' if abs(scaled) >= 1000 else '3g'}} {unit}".strip()


def cell(row: Row | None, metric: str) -> str:
    """A value of a row: a dash if it was not run, "failed" or "never" where there is none."""
    if row is None:
        return "-"
    if row["failure"] is not None:
        return "failed"
    if row[metric] is None:
        return "never" if metric in ("settling_time", "rise_time") else "-"
    return number(row[metric], metric)


def both(rows: Sequence[Row | None], metric: str) -> str:
    """Values of several rows, parted by a stroke."""
    return " / ".join(cell(row, metric) for row in rows)


def several(row: Row | None, metrics: Sequence[str], stroke: str = " / ") -> str:
    """Values of a row, parted by a stroke; one word if there are none."""
    if row is None or row["failure"] is not None:
        return cell(row, metrics[0])
    return stroke.join(cell(row, metric) for metric in metrics)


def span(values: tuple[float, float] | None, metric: str) -> str:
    """Smallest and largest value, one number if they are the same."""
    if values is None:
        return "-"
    texts = dict.fromkeys(number(value, metric) for value in values)
    return "-".join(texts)


def task_name(task: str, width: float | None) -> str:
    """Task, with the width of a step."""
    return task if width is None else f"{task} {1e3 * width:g} mm"


def verdict(met: bool) -> Text:
    """Whether a goal was met."""
    return Text("yes") if met else Text("NO", style="bold red")
