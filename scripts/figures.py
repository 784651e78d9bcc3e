"""Fill the figures of README.md and docs/ from reports, from the code and from what is quoted.

    python scripts/figures.py           # writes
    python scripts/figures.py --check   # says what is stale or typed, and changes nothing
    python scripts/figures.py --stale   # prints what makes reports anew whose code has changed

A text between `<!-- figures TEMPLATE -->` and `<!-- end -->` is the template with its figures:

    <!-- figures {laws policy=lqi robot=arm: median share_mean % .2g} -->0.12<!-- end -->

A figure names a report (`docs/results/NAME/report.json`), fields that its rows must have, and what
is shown. `variation.delay=0.02` is a field within a field, `x=` an empty or absent one, `x=a|b` one
of several, `_` a space or colon, `*` any text. What is shown is a field, behind it a unit of
`softrobot_env.rendering.tables.FACTORS` and a format (`.2g`, `,.0f`; a plain number is significant
digits), before it one of `FUNCTIONS`; without a function all rows must agree. A line of a template
such as `each policy = lqi, mpc` repeats the lines with `{policy}`, also within a figure, and
`each policy | law = lqi | gains; mpc | a plan` fills in two names at once; the line behind
`rows NAME` is repeated with the fields of every row of a report, also within a figure.

Three words in place of a report name other sources:

    {code robots.ARM: length mm}               what `softrobot_env.robots.ARM` says, or a default
    {code studies.identify: GOALS.modulus}     the same of a study in `scripts/studies`
    {code robots.find_robot(rig): length mm}   what a function says of a name
    {code thesis.figures.FIGURES task=swing controller=MPC: e_max mm}    one of many records
    {code thesis.figures.TRIANGLE 0=hybrid 1=5.0: value.0 mm}    a mapping, by parts of its keys
    {model rig_nn: about_play mm}              a number of models/rig_nn.npz
    {quoted publisher: error mm}               docs/quoted.toml, which names the source

A number in running text that is in none of these is typed, see `typed`.
"""

import gzip
import inspect
import json
import math
import pkgutil
import re
import sys
import tomllib
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from statistics import mean, median
from typing import Any

import numpy as np

from softrobot_env.core import sources
from softrobot_env.core.files import write_text
from softrobot_env.rendering.tables import FACTORS, NONE, number

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"(<!-- figures\s(.*?)-->)(.*?)(<!-- end -->)", re.S)
FIGURE = re.compile(r"\{([^{}]*?):([^{}]*)\}")
#: What is no running text: what is filled, comments, code, and targets of links.
NOT_RUNNING = re.compile(
    r"<!-- figures\s.*?<!-- end -->|<!--.*?-->|^```.*?^```|\]\([^)]*\)"
    r"|`(?![-+\d., ]+[a-zµ%]{0,3}`)(?:[^`\n]|\n(?!\n))*`",  # but for a lone figure
    re.S | re.M,
)
#: Numbers that are names: parts of a text, specimens, versions, years, reciprocal units.
NAMES = re.compile(
    r"\b(?:secs?\.|Figs?\.|Tabs?\.|ch\.|[Cc]hapters?|Python|MuJoCo|Node\.js|seeds?|twins?)\s"
    r"\d[\d.]*(?:(?:,|,?\sand|,?\sto|,?\sor)\s\d[\d.]*)*"
    r"|\(\d+\.\d+\)|\b(?:19|20)\d\d\b|^\s*\d+\.\s|\b1/(?=[A-Za-z])|\b[23]-D\b",
    re.M,
)
#: A number that is no part of a word.
NUMBER = re.compile(r"(?<![\w.])(?<!\w-)\d(?:[\d,.]*\d)?(?: \d{3})*(?:e[-+]?\d+)?")
#: Unit shown -> factor from SI.
UNITS = {**FACTORS, "degrees": 180 / math.pi}
FUNCTIONS: dict[str, Callable[[list[Any]], Any]] = {"mean": mean, "median": median}
FUNCTIONS |= {"least": min, "largest": max, "total": sum, "count": len}


def pages() -> list[Path]:
    """README.md, the pages of docs/ that are written by hand, and what they include.

    Not firmware/README.md, whose numbers are pins, voltages and baud rates of its boards, and not
    docs/reference, which `scripts/reference.py` writes; nor docs/howto/motors.md, whose numbers are
    voltages, addresses and baud rates of makers' parts.
    """
    docs = sorted((ROOT / "docs").rglob("*.md"))
    foreign = {ROOT / "docs" / "demo", ROOT / "docs" / "reference"}  # npm installs into the first
    docs.remove(ROOT / "docs" / "howto" / "motors.md")
    own = [p for p in docs if p.name != "report.md" and not foreign & set(p.parents)]
    included = [ROOT / "CONTRIBUTING.md", *sorted((ROOT / "models").glob("*.md"))]
    return [ROOT / "README.md", *own, *included]


def rows(report: str) -> list[dict[str, Any]]:
    """Rows of a report by the name of its folder; errors as `content`."""
    return content(report)["rows"]


@cache
def content(report: str) -> dict[str, Any]:
    """A report by the name of its folder.

    Raises:
        ValueError: There is no such report.
    """
    folder = ROOT / "docs" / "results" / report
    for name, opener in (("report.json", open), ("report.json.gz", gzip.open)):
        if (folder / name).is_file():
            with opener(folder / name, "rt", encoding="utf-8") as file:
                return json.load(file)
    raise ValueError(f"no report {report!r} in docs/results")


def field(row: dict[str, Any], name: str) -> Any:
    """A field of a row, or `outer.inner` of a field with fields; None where there is none."""
    value: Any = row
    for part in name.split("."):
        if isinstance(value, list | tuple) and part.isdigit():
            value = value[int(part)]
        else:
            value = value.get(part) if isinstance(value, dict) else None
    return value


def resolved(path: str) -> Any:
    """An object of the package, or of a study where the path begins with `studies.`."""
    return pkgutil.resolve_name(path if path.startswith("studies.") else f"softrobot_env.{path}")


def declared(path: str, name: str) -> Any:
    """What an object of the package says: an attribute, an entry, or the default of a parameter.

    Raises:
        ValueError: There is no such object, or it has no such value.
    """
    where, _, argument = path.rstrip(")").partition("(")
    try:
        value = resolved(where)
        value = value(argument) if argument else value
        for part in name.split("."):
            if hasattr(value, "__getitem__") and not hasattr(value, part):
                value = value[int(part) if part.isdigit() else part]
            elif hasattr(value, part):
                value = getattr(value, part)
            else:
                value = inspect.signature(value).parameters[part].default
    except (ImportError, AttributeError, LookupError, TypeError) as error:
        raise ValueError(f"{path} has no {name!r}: {error!r}") from None
    return value


def records(path: str) -> list[dict[str, Any]]:
    """A sequence of dataclasses, or a mapping from tuples, of the package as rows."""
    found = resolved(path)
    if isinstance(found, Mapping):
        return [{**dict(zip("0123", key, strict=False)), "value": v} for key, v in found.items()]
    return [asdict(record) for record in found]


@cache
def quoted() -> dict[str, dict[str, Any]]:
    """Figures of others by what they are called, each with its `source`."""
    return tomllib.loads((ROOT / "docs" / "quoted.toml").read_text(encoding="utf-8"))


def given(kind: str, where: str, name: str) -> Any:
    """A value that is in no report: of the code, of a model, or quoted.

    Raises:
        ValueError: There is no such value.
    """
    if kind == "code":
        return declared(where, name)
    if kind == "model":
        with np.load(ROOT / "models" / f"{where}.npz", allow_pickle=False) as model:
            return model[name].item()
    value = field(quoted().get(where, {}), name)
    if value is None:
        raise ValueError(f"{kind} {where!r} has no {name!r}")
    return value


def matches(row: dict[str, Any], name: str, allowed: str) -> bool:
    """Whether a field is like one of the patterns divided by "|"; "" is empty or absent."""
    value = field(row, name)
    return any(fnmatchcase(plain(value), pattern) for pattern in allowed.split("|"))


def plain(value: Any) -> str:
    """A field as patterns are compared with: nothing for what is empty, no spaces or colons."""
    return re.sub("[ :]", "_", "" if value is None or value == {} else str(value))


def chosen_values(
    report: str, among: list[dict[str, Any]], conditions: list[str], name: str
) -> list[Any]:
    """A field of all rows that fulfil conditions.

    Raises:
        ValueError: There is no such row.
    """
    pairs = [condition.split("=", 1) for condition in conditions]
    chosen = [row for row in among if all(matches(row, *pair) for pair in pairs)]
    chosen = [row for row in chosen if name in row or "." in name or name == "rows"]
    if not chosen:
        raise ValueError(f"no row of {report!r} has {' '.join(conditions)} and {name!r}")
    return [field(row, name) for row in chosen]


def figure(source: str, shown: str) -> str:
    """One figure, as text.

    Raises:
        ValueError: No row or several where one is meant, an unknown field, function or report.
    """
    report, *conditions = source.split()
    words = shown.split()
    if not words:
        raise ValueError(f"{source!r}: no field")
    function = FUNCTIONS[words.pop(0)] if words[1:] and words[0] in FUNCTIONS else None
    name, *how = words
    if report == "code" and len(conditions) > 1:
        values = chosen_values(conditions[0], records(conditions[0]), conditions[1:], name)
    elif report in ("code", "model", "quoted"):
        found = given(report, conditions[0], name)
        values = list(found) if function else [found]
    else:
        values = chosen_values(report, rows(report), conditions, name)
    if function is None and len(set(map(str, values))) > 1:
        raise ValueError(f"{len(values)} rows of {report!r} have {' '.join(conditions)}")
    if function not in (None, len):
        values = [value for value in values if value is not None]
    value = function(values) if function else values[0]
    if value is None or isinstance(value, str):
        return value or NONE
    factor = math.prod(UNITS[word] for word in how if word in UNITS)
    form = next((word for word in how if word not in UNITS), "g")
    if form.isdigit():
        return significant(value * factor, int(form))
    return number(value * factor, form)


def significant(value: float, digits: int) -> str:
    """A number with so many significant digits, without an exponent."""
    if value == 0:
        return "0"
    places = digits - 1 - math.floor(math.log10(abs(value)))
    return f"{round(value, places):,.{max(places, 0)}f}".replace(",", " ")


def repeated(template: str) -> str:
    """A template whose lines are repeated as its lines `each` say."""
    lines, names, each = [], [], []
    for line in template.strip().splitlines():
        if line.startswith("each "):
            said, _, values = line.removeprefix("each ").partition(" = ")
            names = said.split(" | ")
            each = [value.strip() for value in values.split("; " if names[1:] else ",")]
        elif names and f"{{{names[0]}}}" in line:
            for values in each:
                made = line
                for name, value in zip(names, values.split(" | "), strict=True):
                    made = made.replace(f"{{{name}}}", value)
                lines.append(made)
        else:
            lines.append(line)
    return "\n".join(lines)


def filled(template: str) -> str:
    """A template with its figures; errors as `figure`."""
    lines, of = [], ""
    for line in repeated(template).splitlines():
        if line.startswith("rows "):
            of = line.removeprefix("rows ").strip()
        elif of:
            lines += [with_figures(of_row(line, row)) for row in rows(of)]
            of = ""
        else:
            lines.append(with_figures(line))
    return "\n".join(lines)


def of_row(line: str, row: dict[str, Any]) -> str:
    """A line with fields of a row; where a figure is chosen by one, as `matches` reads it."""
    line = re.sub(r"=\{(\w+)\}", lambda found: "=" + plain(row[found[1]]), line)
    return re.sub(r"\{(\w+)\}", lambda found: str(row[found[1]]), line)


def with_figures(line: str) -> str:
    """A line with its figures; errors as `figure`."""
    return FIGURE.sub(lambda found: figure(found[1], found[2]), line)


def fill(text: str) -> str:
    """A page with its figures; errors as `figure`."""

    def block(found: re.Match) -> str:
        lone = "\n" in found[2].strip()
        made = filled(found[2])
        return found[1] + (f"\n\n{made}\n\n" if lone else made) + found[4]

    return BLOCK.sub(block, text)


def running(text: str) -> str:
    """What of a page is running text, without numbers that are names.

    In a table that begins with the columns `place` and `printed`, these quote the source that the
    page is about.
    """
    lines, quoting = [], False
    for line in NOT_RUNNING.sub(" ", text).splitlines():
        quoting = line.startswith("|") and (quoting or line.startswith("| place | printed |"))
        lines.append("|".join(line.split("|")[3:]) if quoting else line)
    return NAMES.sub(" ", "\n".join(lines))


def typed(text: str) -> list[str]:
    """Figures of a page that were typed: numbers in running text, also in words of a template.

    A template may repeat numbers that its conditions have, in any unit of `UNITS`, as headings do.
    """
    found = [match[0].strip() for match in NUMBER.finditer(running(text))]
    for _, template, _, _ in BLOCK.findall(text):
        lines = repeated(template)
        conditions = " ".join(source for source, _ in FIGURE.findall(lines))
        named = [float(number) for number in re.findall(r"\d+(?:\.\d+)?", conditions)]
        for match in NUMBER.finditer(running(FIGURE.sub("", lines))):
            value = float(re.sub("[ ,]", "", match[0]).rstrip("."))
            if not any(math.isclose(value, n * u) for n in named for u in (1, *UNITS.values())):
                found.append(match[0].strip())
    return found


@dataclass(frozen=True)
class Stale:
    """A report that is older than its code, or perhaps.

    Attributes:
        name: Of its folder.
        why: What it is older than.
        command: What makes it anew.
        seconds: CPU time that it took; None where that is unknown.
    """

    name: str
    why: str
    command: str
    seconds: float | None

    def __str__(self) -> str:
        cost = "" if self.seconds is None else f" ({self.seconds:,.0f} CPU s)"
        return f"docs/results/{self.name}: {self.why}: {self.command}{cost}"


def stale_reports() -> list[Stale]:
    """Reports that are older than their code, the cheapest first."""
    found = []
    for name in sorted({path.parent.name for path in ROOT.glob("docs/results/*/report.json*")}):
        meta = content(name)["meta"]
        changed = sources.changed(meta.get("sources", {}))
        if "sources" in meta and not changed:
            continue
        why, command = "of unknown age", meta["command"]
        if changed:
            more = ", ..." if changed[3:] else ""
            why = f"older than {len(changed)} of its sources ({', '.join(changed[:3])}{more})"
        if command.startswith(("softrobot", "python")) and "--overwrite" not in command:
            command += " --overwrite"
        if (ROOT / "docs" / "results" / name / "report.json.gz").is_file():
            command += f" && gzip -nf docs/results/{name}/report.json"
        found.append(Stale(name, why, command, meta.get("seconds")))
    return sorted(found, key=lambda one: math.inf if one.seconds is None else one.seconds)


def print_commands(names: list[str]) -> int:
    """Print what makes stale reports anew, of those named or of all; 1 where a name is none."""
    for name in names:
        try:
            content(name)
        except ValueError as error:
            print(error, file=sys.stderr)
            return 1
    for report in stale_reports():
        if not names or report.name in names:
            print(report.command)
    return 0


def main() -> int:
    """Write or check the pages; 1 where one is stale under `--check`, or a figure is typed."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="change nothing, list stale reports")
    parser.add_argument("--fresh", action="store_true", help="and fail if there is one")
    parser.add_argument("--stale", nargs="*", metavar="REPORT", help="print their commands alone")
    args = parser.parse_args()
    if args.stale is not None:
        return print_commands(args.stale)
    old = stale_reports() if args.check or args.fresh else []
    for report in old:
        print(report)
    stale = len(old) if args.fresh else 0
    for path in pages():
        text = path.read_text(encoding="utf-8")
        for figure_typed in typed(text):
            stale += 1
            print(f"{path.relative_to(ROOT)}: typed figure {figure_typed!r}")
        try:
            new = fill(text)
        except ValueError as error:
            print(f"{path.relative_to(ROOT)}: {error}")
            return 1
        if new != text:
            stale += 1
            print(f"{path.relative_to(ROOT)}: figures are stale")
            if not args.check:
                write_text(path, new)
    return int(bool(stale) and args.check)


if __name__ == "__main__":
    sys.exit(main())
