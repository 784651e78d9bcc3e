"""The rows of the thesis benchmark as tables that fit a terminal of 100 columns."""

from rich import box
from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.thesis.rows import MODELS, Row

#: y_name -> (what it is, factor from SI, unit, digits).
_QUANTITIES = {
    "tip_deflection_m": ("tip deflection", 1e3, "mm", 2),
    "spread_m": ("spread over xi_1 to xi_5", 1e3, "mm", 2),
    "change_from_3_to_5_pieces_m": ("change from n = 3 to 5", 1e3, "mm", 2),
    "pieces_for_5_percent": ("pieces for an error of 5 %", 1, "", 0),
    "relative_to_euler_bernoulli": ("off Euler-Bernoulli", 100, "%", 2),
    "spread_of_models": ("spread of the models", 100, "%", 2),
    "twist_rad": ("twist", 1e3, "mrad", 2),
    "frequency_Hz": ("frequency", 1, "Hz", 3),
    "largest_norm_violation": ("largest violation", 1e6, "1e-6", 3),
    "first_order_below_1e-3": ("first order below 1e-3", 1, "", 0),
    "evaluation_time_s": ("time with order 8", 1e6, "us", 1),
    "most_pieces_in_real_time": ("most pieces in real time", 1, "", 0),
    "fewest_pieces_with_more_than_ancf": ("pieces to exceed ANCF", 1, "", 0),
    "mean_distance_m": ("mean distance", 1e3, "mm", 2),
    "largest_distance_m": ("largest distance", 1e3, "mm", 2),
    "largest_radius_m": ("largest radius", 1e3, "mm", 2),
    "last_tip_x_m": ("last tip, x", 1e3, "mm", 1),
    "last_tip_y_m": ("last tip, y", 1e3, "mm", 1),
    "last_tip_z_m": ("last tip, z", 1e3, "mm", 1),
    "mean_error_m": ("mean error at steps", 1e3, "mm", 3),
    "mean_error_between_m": ("mean error throughout", 1e3, "mm", 3),
    "largest_error_m": ("largest error at steps", 1e3, "mm", 3),
}

#: Of these the thesis prints upper bounds.
_BOUNDS = ("spread_of_models", "relative_to_euler_bernoulli", "mean_distance_m")
_BOUNDS += ("largest_distance_m",)

_NAMES = {"pcc": "PCC", "cosserat": "Cosserat", "ancf": "ANCF"}
_SOLVERS = ("tab2.2", "tab2.3")


def tables(rows: list[Row]) -> Group:
    """Printed numbers, deviations from the audit, and Tab. 2.2 and 2.3."""
    return Group(_printed(rows), _deviations(rows), _solvers(rows))


def _new_table(title: str) -> Table:
    return Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))


def _place(row: Row) -> tuple[bool, int]:
    """Sorts figures, then tables, by number."""
    chapter, number = row["figure"].split(".")
    return chapter.startswith("tab"), int(number)


def _is_printed_step(row: Row) -> bool:
    return row["figure"] == "tab2.2" and row["case"].endswith(" s")


def _printed(rows: list[Row]) -> Table:
    """All numbers that the thesis prints, except the tables of solvers."""
    out = _new_table("Numbers of chapter 2: as printed, as the audit expects them, and ours")
    for head in ("figure", "case", "model", "what"):
        out.add_column(head, overflow="fold")
    for head in ("thesis", "audit", "ours"):
        out.add_column(head, justify="right", overflow="fold")
    for row in sorted(rows, key=_place):
        stated = row["thesis"] is not None and row["figure"] not in _SOLVERS
        if stated or _is_printed_step(row):
            what, factor, unit, digits = _QUANTITIES[row["y_name"]]
            numbers = [_number(row[key], factor, digits) for key in ("thesis", "audit", "y")]
            if row["y_name"] in _BOUNDS and row["thesis"] > 0:
                numbers[0] = f"< {numbers[0]}"
            label = f"{what} {unit}".strip()
            out.add_row(row["figure"], row["case"], _model(row), label, *numbers)
    return out


def _model(row: Row) -> str:
    name = _NAMES.get(row["model"], row["model"].replace("_", " "))
    return name if row["n"] is None else f"{name} {row['n']}"


def _number(value: float | None, factor: float, digits: int) -> str:
    return "-" if value is None else f"{factor * value:.{digits}f}"


def _deviations(rows: list[Row]) -> Table:
    """Largest relative deviations from the audit where the thesis prints nothing."""
    out = _new_table("Further numbers of the audit, and how far we are off at most")
    for head in ("figure", "what"):
        out.add_column(head)
    for head in ("numbers", "largest deviation %"):
        out.add_column(head, justify="right")
    out.add_column("where")
    found: dict[tuple[str, str], list[tuple[float, str]]] = {}
    for row in sorted(rows, key=_place):
        if row["audit"] and row["y"] is not None and row["thesis"] is None:
            if _is_printed_step(row):
                continue
            entry = abs(row["y"] / row["audit"] - 1), f"{_model(row)}, {row['case']}"
            found.setdefault((row["figure"], row["y_name"]), []).append(entry)
    for (figure, name), entries in found.items():
        worst, where = max(entries)
        count = str(len(entries))
        out.add_row(figure, _QUANTITIES[name][0], count, f"{100 * worst:.2f}", where)
    return out


def _solvers(rows: list[Row]) -> Table:
    """Tab. 2.2 and 2.3, ours with the thesis' numbers in brackets."""
    out = _new_table("Tab. 2.2 and 2.3, spiral of 3 s: ours (thesis)")
    for head in ("model", "solver, accuracy"):
        out.add_column(head, overflow="fold")
    for head in ("time ms", "error mm", "steps ms"):
        out.add_column(head, justify="right", overflow="fold")
    lines: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        if row["figure"] in _SOLVERS and not _is_printed_step(row):
            lines.setdefault((row["model"], row["case"]), {})[row["y_name"]] = row
    for (model, case), line in sorted(lines.items(), key=lambda item: MODELS.index(item[0][0])):
        label = _model({"model": model, "n": next(iter(line.values()))["n"]})
        names = ("computation_time_s",), ("mean_error_m",), _step_names(line)
        out.add_row(label, case, *(_both([line[k] for k in n if k in line]) for n in names))
    return out


def _step_names(line: dict[str, Row]) -> tuple[str, ...]:
    return ("step_s",) if "step_s" in line else ("smallest_step_s", "largest_step_s")


def _both(rows: list[Row]) -> str:
    """Our numbers, and the thesis' in brackets, times 1000; a range for two rows."""
    if not rows:
        return ""
    ours, thesis = (" - ".join(_short(r[key]) for r in rows) for key in ("y", "thesis"))
    return f"{ours} ({thesis})"


def _short(value: float | None) -> str:
    if value is None:
        return "failed"
    scaled = 1e3 * value
    return f"{scaled:.0f}" if scaled >= 100 else f"{scaled:.2g}"
