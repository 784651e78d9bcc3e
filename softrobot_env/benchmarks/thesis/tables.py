"""The rows of the thesis benchmark as tables that fit a terminal of 100 columns."""

from rich.console import Group
from rich.table import Table

from softrobot_env.benchmarks.records import groups
from softrobot_env.benchmarks.thesis.rows import MODELS, Row
from softrobot_env.rendering.tables import Column, make_table, new_table, number

#: y_name -> (what it is, unit, format).
_QUANTITIES = {
    "tip_deflection_m": ("tip deflection", "mm", ".2f"),
    "spread_m": ("spread over xi_1 to xi_5", "mm", ".2f"),
    "change_from_3_to_5_pieces_m": ("change from n = 3 to 5", "mm", ".2f"),
    "pieces_for_5_percent": ("pieces for an error of 5 %", "", ".0f"),
    "relative_to_euler_bernoulli": ("off Euler-Bernoulli", "%", ".2f"),
    "spread_of_models": ("spread of the models", "%", ".2f"),
    "twist_rad": ("twist", "mrad", ".2f"),
    "frequency_Hz": ("frequency", "Hz", ".3f"),
    "largest_norm_violation": ("largest violation", "1e-6", ".3f"),
    "first_order_below_1e-3": ("first order below 1e-3", "", ".0f"),
    "evaluation_time_s": ("time with order 8", "µs", ".1f"),
    "most_pieces_in_real_time": ("most pieces in real time", "", ".0f"),
    "fewest_pieces_with_more_than_ancf": ("pieces to exceed ANCF", "", ".0f"),
    "mean_distance_m": ("mean distance", "mm", ".2f"),
    "largest_distance_m": ("largest distance", "mm", ".2f"),
    "largest_radius_m": ("largest radius", "mm", ".2f"),
    "last_tip_x_m": ("last tip, x", "mm", ".1f"),
    "last_tip_y_m": ("last tip, y", "mm", ".1f"),
    "last_tip_z_m": ("last tip, z", "mm", ".1f"),
    "mean_error_m": ("mean error at steps", "mm", ".3f"),
    "mean_error_between_m": ("mean error throughout", "mm", ".3f"),
    "largest_error_m": ("largest error at steps", "mm", ".3f"),
}

#: Of these the thesis prints upper bounds.
_BOUNDS = ("spread_of_models", "relative_to_euler_bernoulli", "mean_distance_m")
_BOUNDS += ("largest_distance_m",)

_NAMES = {"pcc": "PCC", "cosserat": "Cosserat", "ancf": "ANCF"}
_SOLVERS = ("tab2.2", "tab2.3")


def tables(rows: list[Row]) -> Group:
    """Printed numbers, deviations from the audit, and Tab. 2.2 and 2.3."""
    return Group(_printed(rows), _deviations(rows), _solvers(rows))


def _place(row: Row) -> tuple[bool, int]:
    """Sorts figures, then tables, by number."""
    chapter, number = row.figure.split(".")
    return chapter.startswith("tab"), int(number)


def _is_printed_step(row: Row) -> bool:
    return row.figure == "tab2.2" and row.case.endswith(" s")


def _printed(rows: list[Row]) -> Table:
    """All numbers that the thesis prints, except the tables of solvers."""

    def stated(row: Row) -> bool:
        return row.thesis is not None and row.figure not in _SOLVERS

    return make_table(
        "Numbers of chapter 2: as printed, as the audit expects them, and ours",
        (
            Column("figure"),
            Column("case"),
            Column("model", lambda row: _model(row.model, row.n)),
            Column("what", lambda row: " ".join(_QUANTITIES[row.y_name][:2]).strip()),
            Column("thesis", _bound, ">"),
            Column("audit", lambda row: _shown(row, row.audit), ">"),
            Column("ours", lambda row: _shown(row, row.y), ">"),
        ),
        [row for row in sorted(rows, key=_place) if stated(row) or _is_printed_step(row)],
    )


def _model(model: str, n: int | None) -> str:
    name = _NAMES.get(model, model.replace("_", " "))
    return name if n is None else f"{name} {n}"


def _shown(row: Row, value: float | None) -> str:
    _, unit, form = _QUANTITIES[row.y_name]
    return number(value, form, unit)


def _bound(row: Row) -> str:
    below = row.y_name in _BOUNDS and row.thesis > 0
    return "< " * below + _shown(row, row.thesis)


def _deviations(rows: list[Row]) -> Table:
    """Largest relative deviations from the audit where the thesis prints nothing."""
    out = new_table(
        "Further numbers of the audit, and how far we are off at most",
        ("figure", "what"),
        ("numbers", "largest deviation %"),
    )
    out.add_column("where")
    compared = (
        row
        for row in sorted(rows, key=_place)
        if row.audit and row.y is not None and row.thesis is None and not _is_printed_step(row)
    )
    for (figure, name), mine in groups(compared, "figure", "y_name").items():
        worst, where = max(
            (abs(row.y / row.audit - 1), f"{_model(row.model, row.n)}, {row.case}") for row in mine
        )
        out.add_row(figure, _QUANTITIES[name][0], len(mine), number(worst, ".2f", "%"), where)
    return out


def _solvers(rows: list[Row]) -> Table:
    """Tab. 2.2 and 2.3, ours with the thesis' numbers in brackets."""
    out = new_table(
        "Tab. 2.2 and 2.3, spiral of 3 s: ours (thesis)",
        ("model", "solver, accuracy"),
        ("time ms", "error mm", "steps ms"),
    )
    rows = [row for row in rows if row.figure in _SOLVERS and not _is_printed_step(row)]
    rows.sort(key=lambda row: MODELS.index(row.model))
    for (model, case, n), mine in groups(rows, "model", "case", "n").items():
        line = {row.y_name: row for row in mine}
        adapted = ("smallest_step_s", "largest_step_s")
        steps = ("step_s",) if "step_s" in line else adapted
        names = ("computation_time_s",), ("mean_error_m",), steps
        cells = (_both([line[k] for k in own if k in line]) for own in names)
        out.add_row(_model(model, n), case, *cells)
    return out


def _both(rows: list[Row]) -> str:
    """Our numbers, and the thesis' in brackets, times 1000; a range for two rows."""
    if not rows:
        return ""
    ours, thesis = (" - ".join(_short(getattr(r, key)) for r in rows) for key in ("y", "thesis"))
    return f"{ours} ({thesis})"


def _short(value: float | None) -> str:
    if value is None:
        return "failed"
    scaled = 1e3 * value
    return f"{scaled:.0f}" if scaled >= 100 else f"{scaled:.2g}"
