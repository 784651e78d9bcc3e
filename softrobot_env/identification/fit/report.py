"""Results of an identification as rows, tables and files."""

from dataclasses import asdict, dataclass
from math import exp
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray
from rich.console import Group
from rich.text import Text

from softrobot_env.core.files import write_text
from softrobot_env.recordings.header import write_header
from softrobot_env.rendering.tables import Column, make_table, named_values
from softrobot_env.robots import write_robot

from ..errors import centred, distances, mean_known, size
from ..visits import visiting
from .least_squares import NORMAL_95
from .path import Identification
from .prediction import PREDICTION_FILE
from .residual import RESIDUAL_FILE

#: Rows of blocks that were left out of the fit.
LEFT_OUT = "left out"

#: Names of the files, by which a replay finds them.
ROBOT_FILE, HEADER_FILE, COMMANDS_FILE = "robot.toml", "recording.toml", "next_experiment.csv"

#: What the option `--identified` takes.
NETWORK_FILE = "rig_nn.npz"

_UNITS = {"log": ("%", 100.0), "share": ("%", 100.0), "rad": ("deg", 180 / np.pi), "m": ("mm", 1e3)}


@dataclass(frozen=True)
class ParameterRow:
    """An identified parameter.

    Attributes:
        parameter: Kind and label.
        stage: The stage that identifies it.
        value: Change from the file, in its unit; factors as logarithms.
        deviation: Standard deviation.
        low, high: 95 % interval.
        prior: Standard deviation of the prior.
        unit: "log", "share", "rad", "m", "N", "1/m" or "s".
        found: Whether it was free.
    """

    parameter: str
    stage: str
    value: float
    deviation: float
    low: float
    high: float
    prior: float
    unit: str
    found: bool


@dataclass(frozen=True)
class ErrorRow:
    """Distances of simulated and recorded markers.

    Attributes:
        rows: Which rows: "fitted", or "left out" of the fit in contiguous blocks.
        model: "physics", "with residual", or "chain" for the MuJoCo chain of the robot file.
        pattern: Label, or "all".
        count: Number of rows.
        rms, rms_centred, mean, max: [m]; centred has the mean offset over all rows removed.
    """

    rows: str
    model: str
    pattern: str
    count: int
    rms: float
    rms_centred: float
    mean: float
    max: float


@dataclass(frozen=True)
class PredictionRow:
    """The interval that should contain 95 % of an unseen recording's rows.

    Attributes:
        marker: Number, from 1.
        near: [m], largest distance of the marker at identified commands.
        far: [m], at the commands of a left-out block that are farthest from the others.
        start: [m], at the beginning of a recording.
        blocks: Number of blocks left out, one after the other.
        factor: Factor by which the interval is widened because the blocks are few.
    """

    marker: int
    near: float
    far: float
    start: float
    blocks: int
    factor: float


def prediction_rows(found: Identification) -> list[PredictionRow]:
    """One row a marker; none without a cross-validation."""
    prediction = found.prediction
    if prediction is None:
        return []
    blocks = int(found.validation.blocks.max()) + 1
    rows = []
    for k, (near, growth, start) in enumerate(prediction.parts):
        ends = near, np.hypot(near, growth * prediction.tested), np.hypot(near, start)
        rows.append(PredictionRow(k + 1, *map(float, ends), blocks, float(prediction.factor[k])))
    return rows


def parameter_rows(found: Identification) -> list[ParameterRow]:
    """All parameters."""
    unknowns, dynamics, fit = found.unknowns, found.dynamics, found.fit
    kinds = [(group.stage, group.unit) for group in unknowns.groups for _ in group.labels]
    values, deviations = fit.x.copy(), fit.deviation.copy()
    place = unknowns.place("tendon_friction")
    if dynamics is not None and place is not None:
        values[place] += dynamics.friction[0]
        deviations[place] = np.hypot(deviations[place], dynamics.friction[1])
    known = zip(unknowns.labels, kinds, values, deviations, unknowns.spread, fit.free, strict=True)
    rows = [_parameter(name, *kind, *rest) for name, kind, *rest in known]
    if dynamics is not None:
        kinds = (("damping_time: all", "log"), ("marker_delay: all", "s"))
        numbers = zip(dynamics.values, dynamics.deviation, dynamics.prior, strict=True)
        for (name, unit), row in zip(kinds, numbers, strict=True):
            rows.append(_parameter(name, "dynamics", unit, *row, True))
    return rows


def _parameter(
    name: str, stage: str, unit: str, value: float, deviation: float, prior: float, free: bool
) -> ParameterRow:
    value, deviation, half = float(value), float(deviation), float(NORMAL_95 * deviation)
    ends = value - half, value + half
    return ParameterRow(name, stage, value, deviation, *ends, float(prior), unit, bool(free))


def error_rows(found: Identification) -> list[ErrorRow]:
    """Errors of all rows, by model; and of the physics for each pattern."""
    patterns = found.recording.patterns
    error = found.fit.simulated.error
    rows = [_error("fitted", "physics", "all", error)]
    validation = found.validation
    if validation is not None:
        rows.append(_error(LEFT_OUT, "physics", "all", validation.error))
        if validation.corrected is not None:
            rows.append(_error(LEFT_OUT, "with residual", "all", validation.corrected))
    mean = mean_known(error)
    for name in dict.fromkeys(patterns.tolist()):
        rows.append(_error("fitted", "physics", name or "none", error[patterns == name], mean))
    return rows


def _error(
    rows: str, model: str, pattern: str, error: ndarray, mean: ndarray | None = None
) -> ErrorRow:
    distance = distances(error)
    distance = distance[~np.isnan(distance)]
    off = size(centred(error) if mean is None else error - mean)
    mean_distance = float(distance.mean()) if distance.size else 0.0
    sizes = size(error), off, mean_distance, float(distance.max(initial=0.0))
    return ErrorRow(rows, model, pattern, len(error), *sizes)


def chain_row(error: ndarray) -> ErrorRow:
    """Of the MuJoCo chain, errors (t, k, 3) [m]; rows that failed do not count."""
    return _error("fitted", "chain", "all", error[~np.isnan(error).all(axis=(1, 2))])


def report_rows(found: Identification, chain: ErrorRow | None) -> list[dict[str, Any]]:
    """Rows of report.json, each with its kind."""
    errors = error_rows(found) + ([] if chain is None else [chain])
    rows = [{"kind": "error"} | asdict(row) for row in errors]
    rows += [{"kind": "prediction"} | asdict(row) for row in prediction_rows(found)]
    rows += [{"kind": "parameter"} | asdict(row) for row in parameter_rows(found)]
    rows += [
        {"kind": "undetermined", "combination": str(one), "information": one.information}
        for one in found.combinations
    ]
    columns = {"experiment": "name"} | {n: n for n in ("gain", "parameter", "before", "after")}
    rows += [
        {"kind": "experiment"} | {key: getattr(one, name) for key, name in columns.items()}
        for one in found.experiments
    ]
    return rows + [{"kind": "doubt", "doubt": text} for text in found.doubts]


_MM = {"form": ".2f", "unit": "mm"}
_ERRORS = (
    Column("rows", "rows"),
    Column("model", "model"),
    Column("pattern", "pattern"),
    Column("count", "count", "d"),
    Column("RMS mm", "rms", **_MM),
    Column("centred", "rms_centred", **_MM),
    Column("mean", "mean", **_MM),
    Column("max", "max", **_MM),
)


def _facts(found: Identification) -> dict[str, Any]:
    """Rows about the whole identification."""
    fit = found.fit
    facts = {
        "rows": len(found.recording.times),
        "stages": ", ".join(found.stages),
        "a residual lasts": f"{fit.weights.correlation:.1f} rows",
        "independent rows": f"{len(found.recording.times) / fit.weights.correlation:.0f}",
        "time": ", ".join(f"{name} {value:.0f} s" for name, value in found.times.items()),
    }
    if found.assignment is not None:
        columns = found.recording.header.commands.columns
        pairs = zip(columns, found.assignment.tendons, strict=True)
        facts["columns"] = ", ".join(f"{column} = {tendon}" for column, tendon in pairs)
        rms, second = 1e3 * found.assignment.rms, 1e3 * found.assignment.second
        facts["columns: error"] = f"{rms:.1f} mm as the file says, next best {second:.1f} mm"
    if found.dynamics is not None:
        d = found.dynamics
        facts["in motion"] = (
            f"{1e3 * d.before:.2f} mm before, {1e3 * d.after:.2f} mm after, means left out, in "
            f"{d.duration:.1f} s"
        )
    if found.residual is None and "residual" in found.stages:
        facts["residual"] = "none: no correction helps on blocks that it has not seen"
    if found.networks is not None:
        errors = (f"{name} {1e3 * error:.2f} mm" for name, error in found.networks.errors.items())
        facts["networks, rms of points to test"] = ", ".join(errors)
    return facts


def tables(found: Identification, chain: ErrorRow | None, whole: bool) -> Group:
    """Tables to print; of all patterns and parameters if `whole`."""
    errors = error_rows(found)
    general = [row for row in errors if row.pattern == "all"] + ([] if chain is None else [chain])
    facts = _facts(found)
    parts: list[Any] = [
        named_values(found.believed.name, facts),
        *(Text(f"Look at: {doubt}", style="bold") for doubt in found.doubts),
        make_table("Errors", _ERRORS, general, caption="centred: mean offset removed"),
        *_predictions(found),
        make_table("Parameters, as changes of the file's", _PARAMETERS, _shown(found, whole)),
    ]
    if found.combinations:
        cut = found.combinations[: None if whole else 4]
        parts.append(make_table("What the data cannot tell", (Column("combination", str),), cut))
    if found.experiments:
        parts.append(make_table("What would tell more", _EXPERIMENTS, found.experiments))
    if whole:
        by_pattern = [row for row in errors if row.pattern != "all"]
        parts.append(make_table("Errors by pattern", _ERRORS, by_pattern))
    return Group(*parts)


def _predictions(found: Identification) -> list[Any]:
    rows = prediction_rows(found)
    title = "Unseen recordings at rest: 95 % of the rows are off by at most"
    caption = (
        "near, far: commands as those identified, as the farthest left out; widened: few blocks"
    )
    return [make_table(title, _PREDICTIONS, rows, caption=caption)] if rows else []


def _shown_number(row: ParameterRow, value: float) -> float:
    """A value in the unit that is shown; a factor less one."""
    if row.unit == "log":
        return 100 * (exp(min(value, 50.0)) - 1)
    return value * _unit(row)[1]


def _unit(row: ParameterRow) -> tuple[str, float]:
    """The unit that is shown, and its factor."""
    return _UNITS.get(row.unit, (row.unit, 1.0))


def _value(row: ParameterRow) -> str:
    return f"{_shown_number(row, row.value):+.3g}"


def _interval(row: ParameterRow) -> str:
    return f"{_shown_number(row, row.low):+.3g} to {_shown_number(row, row.high):+.3g}"


_PARAMETERS = (
    Column("parameter"),
    Column("change", _value, ">"),
    Column("95 %", _interval, ">"),
    Column("unit", lambda row: _unit(row)[0]),
    Column("spread left", lambda row: row.deviation / row.prior, ".2f"),
)
_PREDICTIONS = (
    Column("marker", form="d"),
    Column("near mm", "near", **_MM),
    Column("far", "far", **_MM),
    Column("at first", "start", **_MM),
    Column("blocks", "blocks", "d"),
    Column("widened by", "factor", ".2f"),
)
_EXPERIMENTS = (
    Column("experiment", "name"),
    Column("gain", "gain", ".2f"),
    Column("tells most of", "parameter"),
    Column("deviation", "before", ".3g"),
    Column("then", "after", ".3g"),
)

_FEW = 14  # parameters on the terminal


def _shown(found: Identification, whole: bool) -> list[ParameterRow]:
    """Parameters that were free; the best known ones on the terminal."""
    rows = [row for row in parameter_rows(found) if row.found]
    if whole or len(rows) <= _FEW:
        return rows
    best = sorted(rows, key=lambda row: row.deviation / row.prior)[:_FEW]
    return [row for row in rows if row in best]


def write_files(found: Identification, out: Path) -> list[str]:
    """Write robot, header, residual, intervals and the next experiment; names of the files."""
    out.mkdir(parents=True, exist_ok=True)
    write_robot(found.robot, out / ROBOT_FILE, _notes(found))
    write_header(found.header, out / HEADER_FILE)
    written = [ROBOT_FILE, HEADER_FILE]
    saved = {RESIDUAL_FILE: found.residual, PREDICTION_FILE: found.prediction}
    for name, part in (saved | {NETWORK_FILE: found.networks}).items():
        if part is None:  # one of an earlier run would not fit the robot
            (out / name).unlink(missing_ok=True)
    for name, part in saved.items():
        if part is not None:
            part.save(out / name)
            written.append(name)
    if found.networks is not None:
        visiting(found.believed).parameters_of(found).save(out / NETWORK_FILE, found.believed, {})
        written.append(NETWORK_FILE)
    if found.experiments:
        commands = found.recording.header.commands
        raw = (found.experiments[0].commands - commands.offset) / commands.scale
        lines = [",".join(commands.columns)] + [",".join(f"{x:.6g}" for x in r) for r in raw]
        write_text(out / COMMANDS_FILE, "\n".join(lines) + "\n")
        written.append(COMMANDS_FILE)
    return written


def _notes(found: Identification) -> list[str]:
    """Comments of the robot file: what was found, and how well."""
    rows = [row for row in parameter_rows(found) if row.found]
    error = found.fit.simulated.error
    notes = [
        f"Identified from {len(error)} rows of {found.recording.header.robot or 'a recording'}: "
        f"{1e3 * size(error):.2f} mm RMS.",
        "Changes of the file it began with, standard deviations, and the share of the spread",
        "believed before that is left (1: the data tell nothing).",
    ]
    for row in rows:
        unit, scale = _unit(row)
        notes.append(
            f"  {row.parameter}: {_value(row)} {unit} +- {scale * row.deviation:.2g} "
            f"({row.deviation / row.prior:.2f})"
        )
    return [*notes, ""]
