"""What all studies share: rows that know their units, cases, running, tables and plots.

A study is data and one function that measures:

    @dataclass(frozen=True, kw_only=True)
    class Reach(Record):
        robot: str
        share: float | None = quantity("%", ".2g", "error / length")

    STUDY = Study(
        kinds=(Reach,),
        cases=grid(robot=ROBOTS),
        quick={"robot": ROBOTS[:1]},
        measure=lambda case: Reach(...),
        tables=[table("Reach", "robot", "share")],
        plots={"{}": lines("robot", "share", title="Reach")},
    )

What does not fit is a function: of `stages` where cases follow from earlier rows, of tables, and of
plots. Everything that studies need of the package's core is named here too.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from itertools import product
from math import ceil, inf
from pathlib import Path
from statistics import median
from typing import Any, TypeVar

import numpy as np
from rich.console import Group
from rich.table import Table
from rich.text import Text

from softrobot_env.core import runs
from softrobot_env.core.interfaces import ProgressCallback, quiet
from softrobot_env.core.runs import Kept, Record
from softrobot_env.core.runs import for_pictures as for_pictures
from softrobot_env.rendering import figures
from softrobot_env.rendering.figures import Axes, Figure, Style, style_of
from softrobot_env.rendering.tables import FACTORS, Column, make_table, new_table, number, spread
from softrobot_env.rendering.tables import verdict as verdict

#: A row of a study.
AnyRecord = TypeVar("AnyRecord")


def select(records: Iterable[AnyRecord], **values: Any) -> list[AnyRecord]:
    """Records that have given values in some fields."""
    return [r for r in records if all(getattr(r, k) == v for k, v in values.items())]


def groups(records: Iterable[AnyRecord], *names: str) -> dict[tuple, list[AnyRecord]]:
    """Records by the values of some of their fields, in the order of their first appearance."""
    out: dict[tuple, list[AnyRecord]] = {}
    for record in records:
        out.setdefault(tuple(getattr(record, name) for name in names), []).append(record)
    return out


def one(records: Iterable[AnyRecord], **values: Any) -> AnyRecord | None:
    """The first record that has given values in some fields; None if there is none."""
    return next(iter(select(records, **values)), None)


def of_kind(records: Iterable[Any], kind: type[AnyRecord]) -> list[AnyRecord]:
    """Records of a kind."""
    return [record for record in records if isinstance(record, kind)]


def ranked(
    records: Iterable[AnyRecord],
    name: str,
    value: Callable[[AnyRecord], float | None],
    join: Callable[[list[float]], float] = max,
) -> dict[Any, float]:
    """Values of a field, best first, with what is joined of their records; infinite if nothing.

    Those come later that lack a record which others have, or a value of one.
    """
    found = groups(records, name)
    most = max(map(len, found.values()), default=0)
    known = {k: [v for v in map(value, mine) if v is not None] for (k,), mine in found.items()}
    joined = {k: join(values or [inf]) for k, values in known.items()}
    return {k: joined[k] for k in sorted(known, key=lambda k: (most - len(known[k]), joined[k]))}


Rows = Sequence[Any]

#: Makes a table of rows, several, or none where there is nothing to show.
TableMaker = Callable[[Rows], "Table | Text | Iterable[Table | Text] | None"]

#: Draws rows; None where there is nothing to draw, or figures by the stems of their files.
PlotMaker = Callable[[Rows], "Figure | Mapping[str, Figure] | None"]

#: Fields and values that rows must have, or a function that says whether a row counts.
Where = Mapping[str, Any] | Callable[[Any], bool]


# ---------------------------------------------------------------- rows


def quantity(unit: str = "", form: str = ".3g", label: str = "", **default: Any) -> Any:
    """A field of a row that knows how it is shown.

    Args:
        unit: Unit shown, see `rendering.tables.FACTORS`; values are in SI units.
        form: Format of the number.
        label: Name for people; that of the field unless given.
        **default: `default`, as of `dataclasses.field`.
    """
    return field(metadata={"unit": unit, "form": form, "label": label}, **default)


#: Field of an episode's row -> label, unit and format.
EPISODE = {
    "e_max": ("max", "mm", ".3g"),
    "e_rms": ("rms", "mm", ".3g"),
    "e_final": ("final", "mm", ".2f"),
    "e_motion": ("motion", "mm", ".2f"),
    "e_motion_least": ("least", "mm", ".2f"),
    "rise_time": ("rise", "ms", ".0f"),
    "settling_time": ("settling", "s", ".2f"),
    "overshoot": ("over", "%", ".1f"),
    "steady_state_error": ("steady", "%", ".2f"),
    "tension_max": ("tension", "N", ".0f"),
    "policy_time_median": ("policy", "µs", ".1f"),
    "policy_time_p99": ("p99", "µs", ".1f"),
    "decision_period": ("every", "ms", "g"),
}

#: Of these None says that it was never so.
_NEVER = ("settling_time", "rise_time")


def shown(rows: Rows, name: str) -> tuple[str, str, str]:
    """Label, unit and format of a field of rows, or of what `Column` would show of it."""
    for row in rows[:1]:
        for own in fields(row):
            if own.name == name and "unit" in own.metadata:
                meta = own.metadata
                return meta["label"] or name.replace("_", " "), meta["unit"], meta["form"]
    if name in EPISODE:
        return EPISODE[name]
    return name.replace("_", " "), "", "" if rows and _is_text(rows, name) else "g"


def _is_text(rows: Rows, name: str) -> bool:
    values = (getattr(row, name) for row in rows)
    return all(value is None or isinstance(value, str | bool) for value in values)


def cell(row: Any | None, name: str) -> str:
    """A value of a row: a dash if it was not run, "failed" or "never" where there is none."""
    if row is None or getattr(row, "failure", None) is not None:
        return "-" if row is None else "failed"
    _, unit, form = shown([row], name)
    return number(getattr(row, name), form, unit, "never" if name in _NEVER else "-")


def _chosen(rows: Rows, of: type | None, where: Where | None) -> list[Any]:
    rows = list(rows) if of is None else of_kind(rows, of)
    if where is None:
        return rows
    if callable(where):
        return [row for row in rows if where(row)]
    return select(rows, **where)


# ---------------------------------------------------------------- cases and running

#: Names and values of what differs between two measurements.
Case = dict[str, Any]

#: A name for the progress bar, and what makes rows.
Job = tuple[str, Callable[[], list[Any]]]


@dataclass(frozen=True)
class Grid:
    """Cases by the values of their axes, the last one changing fastest."""

    axes: Mapping[str, Sequence[Any]]

    def cases(self, **other: Any) -> list[Case]:
        """All of them, with other values of some axes."""
        axes = {**self.axes, **other}
        return [dict(zip(axes, values, strict=True)) for values in product(*axes.values())]


def grid(**axes: Any) -> Grid:
    """A `Grid` of these axes."""
    return Grid(axes)


@dataclass
class Lab:
    """A run of a study.

    Attributes:
        quick: Whether fewer cases are wanted.
        progress: Called with (description, done, total).
        processes: Cases at a time; 0 for one after the other here, None for one per core.
        options: Options of the study that were given.
        kinds: Dataclasses of the rows.
        kept: Rows that an earlier run left when it was stopped, and where those of this one go.
    """

    quick: bool = False
    progress: ProgressCallback = quiet
    processes: int | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    kinds: tuple[type[Record], ...] = ()
    kept: Kept | None = None

    def measure(
        self, cases: Iterable[Any], measure: Callable, label: Callable[[Any], str] | None = None
    ) -> list[Any]:
        """Rows of cases in their order; `measure` gives a row, or a list of rows, of each."""
        found = runs.run_cases(
            cases,
            measure,
            kinds=self.kinds,
            kept=self.kept,
            label=label or case_label,
            progress=self.progress,
            processes=self.processes,
        )
        return [row for rows in found for row in (rows if isinstance(rows, list) else [rows])]

    def tasks(self, tasks: Sequence[tuple[str, Callable[[], Any]]]) -> list[Any]:
        """What named functions return, which may be anything."""
        work = {"progress": self.progress, "processes": self.processes}
        return runs.run_cases(tasks, lambda task: task[1](), label=lambda task: task[0], **work)


def case_label(case: Any) -> str:
    """A case for a progress bar."""
    if isinstance(case, Mapping | tuple):
        parts = case.values() if isinstance(case, Mapping) else case
        named = [part for part in parts if not isinstance(part, bool)]
        return ", ".join(str(part) for part in named if part or part == 0)
    return getattr(case, "label", None) or str(case)


@dataclass(frozen=True)
class Study:
    """Cases, what is measured, and how it is shown.

    Attributes:
        kinds: Dataclasses of the rows; those derived from them need no mention.
        cases: A `Grid`, cases, or a function of `quick` and of options that gives them.
        quick: Values of axes of the grid in a quick run; otherwise cases of one.
        measure: From a case to a row, or a list of rows.
        label: Of a case, for the progress bar.
        jobs: In place of cases and measure: from `quick` to names and functions that give rows.
        stages: In place of all of these: from a `Lab` to all rows, where some cases follow
            from earlier rows.
        derive: From all rows to all rows, with ratios and what else follows from them.
        tables: Makers of tables, `table` and `pivot` or functions of the rows.
        note: Below the tables.
        plots: Stem of a file, with `{}` for that of the study, -> maker of a figure.
        options: Options of `softrobot benchmark` that cases or stages take.
        alone: Whether cases are measured one after the other.
        processes: Cases at a time; one per core unless given.
    """

    kinds: tuple[type[Record], ...]
    cases: Grid | Sequence[Any] | Callable[..., Iterable[Any]] = ()
    quick: Mapping[str, Any] | Sequence[Any] = field(default_factory=dict)
    measure: Callable[[Any], Any] | None = None
    label: Callable[[Any], str] | None = None
    jobs: Callable[[bool], Iterable[Job]] | None = None
    stages: Callable[[Lab], list[Any]] | None = None
    derive: Callable[[list[Any]], list[Any]] | None = None
    tables: Sequence[TableMaker] = ()
    note: str = ""
    plots: Mapping[str, PlotMaker] = field(default_factory=dict)
    options: tuple[str, ...] = ()
    alone: bool = False
    processes: int | None = None

    #: What the rows depend on besides the package.
    sources = tuple(Path(__file__).parent.rglob("*.py"))

    def run(
        self,
        quick: bool = False,
        progress: ProgressCallback = quiet,
        kept: Kept | None = None,
        **options: Any,
    ) -> list:
        """Measure; `options` are those of the command line."""
        workers = 0 if self.alone else self.processes
        lab = Lab(quick, progress, workers, options, self.kinds, kept)
        if self.stages is not None:
            rows = self.stages(lab)
        elif self.jobs is not None:
            rows = [row for made in lab.tasks([*self.jobs(quick)]) for row in made]
        else:
            rows = lab.measure(self.wanted(quick, **options), self.measure, self.label)
        return rows if self.derive is None else self.derive(rows)

    def wanted(self, quick: bool = False, **options: Any) -> list[Any]:
        """Cases of a run."""
        if isinstance(self.cases, Grid):
            return self.cases.cases(**(self.quick if quick else {}))
        if callable(self.cases):
            return list(self.cases(quick, **options))
        return list(self.quick if quick else self.cases)

    def show(self, rows: Rows) -> Group:
        """All tables that have lines, then texts, then the note."""
        parts, texts = [], []
        for make in self.tables:
            made = make(rows)
            for part in [made] if isinstance(made, Table | Text) else made or ():
                (parts if isinstance(part, Table) else texts).append(part)
        note = [Text(self.note)] if self.note else []
        return Group(*(part for part in parts if part.row_count), *texts, *note)

    @property
    def draw(self) -> Callable[[Rows, Path], None] | None:
        """Draws everything there are rows for to PNGs beside a path; None without pictures."""
        return self._draw if self.plots else None

    def _draw(self, rows: Rows, path: Path) -> None:
        path = Path(path)
        for stem, make in self.plots.items():
            made = make(rows)
            made = made if isinstance(made, Mapping) else {stem: made}
            for name, figure in made.items():
                if figure is not None:
                    figures.save(figure, path.with_stem(name.format(path.stem)))


# ---------------------------------------------------------------- tables


def table(
    title: str,
    *columns: str | Column,
    of: type | None = None,
    where: Where | None = None,
    per: Sequence[str] = (),
    caption: str = "",
) -> TableMaker:
    """A line for each row.

    Args:
        title: With `{field}` for what is the same in all rows of a table.
        *columns: Fields, headed as their quantities say, or columns; all that are declared as
            quantities unless given.
        of: Kind of the rows; all unless given.
        where: Which rows.
        per: Fields: a table for each of their values.
        caption: Below.
    """

    def make(rows: Rows) -> list[Table]:
        mine = _chosen(rows, of, where)
        found = groups(mine, *per) if per else {(): mine} if mine else {}
        return [
            make_table(
                title.format(**dict(zip(per, key, strict=True))),
                [_column(group, c) for c in columns or _quantities(group[0])],
                group,
                caption=caption,
            )
            for key, group in found.items()
        ]

    return make


def _column(rows: Rows, column: str | Column) -> Column:
    if isinstance(column, Column):
        return column
    _, unit, form = shown(rows, column)
    return Column(_heading(rows, column), column, form, unit)


def _quantities(row: Any) -> list[str]:
    return [field.name for field in fields(row) if "unit" in field.metadata]


def _heading(rows: Rows, name: str) -> str:
    return " ".join(filter(None, shown(rows, name)[:2]))


def pivot(
    title: str,
    lines: Sequence[str],
    columns: str | Sequence[str] | Mapping[str, Callable[[list[Any]], Any]],
    cell: str | Callable[[list[Any]], Any] = "",
    *,
    of: type | None = None,
    where: Where | None = None,
    per: Sequence[str] = (),
    heading: Callable[[Any], str] = str,
    headings: Sequence[str] | None = None,
    more: Mapping[str, Callable[[list[Any]], Any]] | None = None,
    show: Callable[[Any], Any] | None = None,
    sections: bool = False,
) -> TableMaker:
    """A line for all rows that agree in some fields.

    Args:
        title: With `{field}` for what is the same in all rows of a table.
        lines: Fields that name a line.
        columns: A field, a column for each of its values; or fields, of which the median, the
            least and the largest of a line are shown; or headings and what is shown of a line.
        cell: With a field as columns, what is shown: a field of the first row, or a function of
            the rows, of which there is at least one.
        of, where, per: As of `table`.
        heading: From a value of the columns' field to a heading.
        headings: Of the lines' fields; their names unless given.
        more: Further columns behind those of a field.
        show: From a value that names a line to its text.
        sections: Whether a rule parts lines whose first field differs.
    """

    def make(rows: Rows) -> Iterator[Table]:
        mine = _chosen(rows, of, where)
        for key, group in (groups(mine, *per) if per else {(): mine}).items():
            own = dict(columns) if isinstance(columns, Mapping) else _expanded(group)
            own |= more or {}
            out = new_table(title.format(**dict(zip(per, key, strict=True))), _heads(), tuple(own))
            found = groups(group, *lines)
            before = None
            for line in found:
                if sections and before not in (None, line[0]):
                    out.add_section()
                before = line[0]
                out.add_row(*map(show or _name, line), *(f(found[line]) for f in own.values()))
            yield out

    def _heads() -> tuple[str, ...]:
        return tuple(lines if headings is None else headings)

    def _expanded(group: list[Any]) -> dict[str, Callable[[list[Any]], Any]]:
        if not isinstance(columns, str):
            return {_heading(group, name): partial(_spread, name) for name in columns}
        return {heading(value): partial(_of_value, value) for (value,) in groups(group, columns)}

    def _of_value(value: Any, group: list[Any]) -> Any:
        mine = select(group, **{columns: value})
        if not mine:
            return None
        if callable(cell):
            return cell(mine)
        _, unit, form = shown(mine, cell)
        return number(getattr(mine[0], cell), form, unit)

    return make


def _spread(name: str, rows: list[Any]) -> str:
    _, unit, form = shown(rows, name)
    return spread([getattr(row, name) for row in rows], form, unit)


def _name(value: Any) -> str | None:
    return f"{value:g}" if isinstance(value, float) else value


def failures(*columns: str | Column, of: type | None = None) -> TableMaker:
    """A table of the rows whose field `failure` says why, with further columns before it."""
    return table("Failed", *columns, "failure", of=of, where=lambda row: row.failure is not None)


# ---------------------------------------------------------------- plots


def _scaled(rows: Rows, name: str, value: float | None) -> float:
    return np.nan if value is None else FACTORS.get(shown(rows, name)[1], 1.0) * value


def axis_label(rows: Rows, name: str) -> str:
    """A field with its unit, for an axis."""
    label, unit, _ = shown(rows, name)
    return f"{label} [{unit}]" if unit else label


def lines(
    x: str,
    y: str | Sequence[str],
    by: str,
    *,
    title: str | Callable[[Rows], str],
    subject: str = "",
    panel: str | None = None,
    of: type | None = None,
    where: Where | None = None,
    join: Callable[[list[float]], float] = median,
    band: bool = False,
    log: str = "",
    style: Callable[[Any], Style] = style_of,
    line: Mapping[str, Any] | Callable[[list[Any]], Mapping[str, Any]] | None = None,
    columns: int = 3,
    size: tuple[float, float] = (4.2, 2.7),
    legend: bool = False,
    decorate: Callable[[Axes, list[Any], str], None] | None = None,
) -> PlotMaker:
    """Lines of y over x; a cross at the top where a value is missing.

    Args:
        x, y: Fields; several of y have rows of panels of their own, or stand side by side.
        by: Field whose values are lines of their own.
        title, subject: What is to be seen, and what is shown; see `add_title`.
        panel: Field whose values have panels of their own.
        of, where: As of `table`.
        join: What is shown of several rows at an x.
        band: Whether all that lies between the rows at an x is shaded.
        log: Axes with logarithmic scales, out of "xy".
        style: From a value of `by` to how it is drawn.
        line: Matplotlib's keywords for all lines, or a function of the rows of one.
        columns, size: Of the panels, size in inches.
        legend: Whether names stand in a legend and not at the ends of the lines.
        decorate: Called with the axis of a panel, its rows and its y at the end.
    """

    def draw(rows: Rows) -> Figure | None:
        mine = _chosen(rows, of, where)
        if not mine:
            return None
        ys, found = ([y] if isinstance(y, str) else y), {(None,): mine}
        found = found if panel is None else groups(mine, panel)
        across = min(columns, len(ys if panel is None else found))
        down = ceil(len(ys) * len(found) / across)
        figure, axes = figures.new_figure(down, across, (size[0] * across, 1.3 + size[1] * down))
        panels = [(name, value, own) for name in ys for (value,), own in found.items()]
        for axis, (name, value, own) in zip(axes.flat, panels, strict=False):
            _panel(axis, name, value, own)
        figures.add_title(figure, title(mine) if callable(title) else title, subject)
        if legend:
            figures.add_legend(figure, axes[0, 0])
        return figure

    def _panel(axis: Axes, name: str, value: Any, own: list[Any]) -> None:
        ends = [_line(axis, name, key, group) for (key,), group in groups(own, by).items()]
        axis.set(xlabel=axis_label(own, x), ylabel=axis_label(own, name))
        axis.set(**{f"{direction}scale": "log" for direction in log})
        if value is not None:
            axis.set_title(str(value))
        if log:
            figures.plain_ticks(axis)
        if decorate is not None:
            decorate(axis, own, name)
        if not legend:
            figures.label_lines(axis, [end for end in ends if end is not None])

    def _line(axis: Axes, y: str, name: Any, rows: list[Any]) -> tuple[str, float, str] | None:
        look, own = style(name), line(rows) if callable(line) else line or {}
        known: dict[float, list[float]] = {}
        for (place,), group in sorted(groups(rows, x).items()):
            values = [_scaled(group, y, getattr(row, y)) for row in group]
            at = _scaled(group, x, place)
            if np.isnan(values).any():
                top = axis.get_xaxis_transform()
                axis.plot(at, 0.98, "x", color=look.colour, transform=top)
            else:
                known[at] = values
        if not known:
            return None
        middle = [join(values) for values in known.values()]
        keys = {"markersize": 4, "linewidth": 1.2} | (look.curve | look.points) | dict(own)
        axis.plot([*known], middle, label=str(name), **keys)
        if band:
            ends = ([f(v) for v in known.values()] for f in (min, max))
            axis.fill_between([*known], *ends, color=look.colour, alpha=0.2, lw=0)
        return str(name), middle[-1], look.colour

    return draw


def maps(
    panel: str,
    line: str,
    column: str,
    value: Callable[[Any], float | None],
    *,
    title: str | Callable[[Rows], str],
    subject: str = "",
    of: type | None = None,
    where: Where | None = None,
    headings: Callable[[list[Any]], str],
    colours: Callable[[list[Any]], tuple[float, float]],
) -> PlotMaker:
    """Maps of numbers: light is good, dark is bad, on a logarithmic scale; a dash for no row.

    Args:
        panel: Field whose values have maps of their own.
        line, column: Fields whose values are lines and columns.
        value: From a row to its number; None where it failed, or has none.
        title, subject, of, where: As of `lines`.
        headings: From the rows of a map to its title.
        colours: From the same to the smallest and largest number of the scale.
    """

    def draw(rows: Rows) -> Figure | None:
        mine = _chosen(rows, of, where)
        if not mine:
            return None
        parts, names_ = groups(mine, panel), [name for (name,) in groups(mine, column)]
        sizes = [0.9 + len(groups(own, line)) for own in parts.values()]
        figure, _ = figures.new_figure(
            0, 0, (max(8.0, 1.6 + 0.62 * len(names_)), 1.3 + 0.31 * sum(sizes))
        )
        axes = figure.subplots(len(parts), 1, squeeze=False, height_ratios=sizes)
        for axis, own in zip(axes.flat, parts.values(), strict=True):
            _map(axis, own, names_)
            axis.set_title(headings(own), fontsize=10, loc="left")
        figures.add_title(figure, title(mine) if callable(title) else title, subject)
        return figure

    def _map(axis: Axes, own: list[Any], names_: list[Any]) -> None:
        from matplotlib.colors import LogNorm

        labels, ends = [name for (name,) in groups(own, line)], colours(own)
        found = [[one(own, **{line: a, column: b}) for b in names_] for a in labels]
        values = np.array([[_number(row) for row in some] for some in found])
        norm = LogNorm(*ends)
        scaled = np.clip(values, *ends)
        figures.style_axes(axis)
        axis.grid(False)
        axis.set_facecolor("0.85")  # of cells without a number
        axis.pcolormesh(
            np.ma.masked_invalid(scaled), cmap="viridis_r", norm=norm, edgecolors="white", lw=1
        )
        for i, j in np.ndindex(values.shape):
            row, number_ = found[i][j], float(values[i, j])
            colour = "white" if norm(scaled[i, j]) > 0.55 else "black"
            text = f"{number_:.{(number_ < 1) + (number_ < 10)}f}"
            if np.isnan(number_):
                failed = row is not None and row.failure is not None
                text, colour = ("failed", "#A50026") if failed else ("-", "black")
            axis.text(j + 0.5, i + 0.5, text, ha="center", va="center", size=8.5, color=colour)
        axis.set_yticks(np.arange(len(labels)) + 0.5, labels)
        axis.set_xticks(np.arange(len(names_)) + 0.5, names_, fontsize=8.5)
        axis.tick_params(length=0)
        axis.invert_yaxis()

    def _number(row: Any | None) -> float:
        found = None if row is None else value(row)
        return np.nan if found is None else found

    return draw
