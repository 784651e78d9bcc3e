"""Building blocks of the tables of the accuracy benchmark."""

from collections.abc import Callable

from rich import box
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from softrobot_env.benchmarks.accuracy.rows import Row


def new_table(title: str, left: tuple[str, ...], right: tuple[str, ...]) -> Table:
    """An empty table with columns aligned left and right."""
    title = escape(title)
    out = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for head in left:
        out.add_column(escape(head))
    for head in right:
        out.add_column(escape(head), justify="right", no_wrap=True)
    return out


def pivot(
    title: str,
    rows: list[Row],
    names: dict[str, str],
    error: Callable[[Row], float],
    bad: Callable[[Row], bool] = lambda _: False,
) -> Table:
    """One line per model and resolution, one column per case with its short name in `names`."""
    cases = list(dict.fromkeys(row["case"] for row in rows))
    out = new_table(title, ("model",), ("n", *(names[case] for case in cases)))
    cells: dict[tuple, dict[str, Text]] = {}
    for row in sorted(rows, key=lambda row: row["model"]):
        text = Text(small(error(row)), style="bold red" if bad(row) else "")
        cells.setdefault((row["model"], row["n"]), {})[row["case"]] = text
    for (model, n), values in cells.items():
        out.add_row(model, str(n), *(values.get(case, "-") for case in cases))
    return out


def small(value: float) -> str:
    """Two digits; rounding errors as 0."""
    return "0" if abs(value) < 1e-9 else f"{value:.2g}"


def setting(row: Row) -> str:
    """Timestep, or the tolerance of adapted ones."""
    if row["tolerance"] is None:
        return f"{1e3 * row['timestep']:.3g} ms"
    return f"tol {row['tolerance']:.0e}".replace("e-0", "e-")


def millimetres(error: float | None) -> str:
    """Two digits of an error [m] in mm."""
    return "-" if error is None else f"{1e3 * error:.2g}"


def verdict(met: bool | None) -> Text:
    """Whether a goal was met; None: there was none."""
    if met is None:
        return Text("-")
    return Text("yes") if met else Text("NO", style="bold red")
