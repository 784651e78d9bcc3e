"""Fill the figures of README.md and docs/ from the committed reports of the benchmarks.

    python scripts/figures.py           # writes
    python scripts/figures.py --check   # says what is stale, and changes nothing

A text between `<!-- figures TEMPLATE -->` and `<!-- end -->` is the template with its figures:

    <!-- figures {laws policy=lqi robot=arm: median share_mean % .2g} -->0.12<!-- end -->

A figure names a report (`docs/results/NAME/report.json`), fields that its rows must have, and what
is shown. `variation.delay=0.02` is a field within a field, `x=` an empty or absent one, `x=a|b` one
of several, `_` a space or colon, `*` any text. What is shown is a field, behind it a unit of
`softrobot_env.rendering.tables.FACTORS` and a format (`.2g`, `,.0f`; a plain number is significant
digits), before it one of `FUNCTIONS`; without a function all rows must agree. A line of a template
such as `each policy = lqi, mpc` repeats the lines with `{policy}`, also within a figure.
"""

import gzip
import json
import math
import re
import sys
from collections.abc import Callable
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from statistics import mean, median
from typing import Any

from softrobot_env.rendering.tables import FACTORS, NONE, number
from softrobot_env.writing import write_text

ROOT = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"(<!-- figures\s(.*?)-->)(.*?)(<!-- end -->)", re.S)
FIGURE = re.compile(r"\{([^{}]*?):([^{}]*)\}")
FUNCTIONS: dict[str, Callable[[list[Any]], Any]] = {
    "mean": mean,
    "median": median,
    "least": min,
    "largest": max,
    "total": sum,
    "count": len,
}


def pages() -> list[Path]:
    """README.md and the pages of docs/ that are written by hand."""
    docs = sorted((ROOT / "docs").rglob("*.md"))
    foreign = ROOT / "docs" / "demo"  # what npm installs there
    own = [p for p in docs if p.name != "report.md" and foreign not in p.parents]
    return [ROOT / "README.md", *own]


@cache
def rows(report: str) -> list[dict[str, Any]]:
    """Rows of a report by the name of its folder.

    Raises:
        ValueError: There is no such report.
    """
    folder = ROOT / "docs" / "results" / report
    for name, opener in (("report.json", open), ("report.json.gz", gzip.open)):
        if (folder / name).is_file():
            with opener(folder / name, "rt", encoding="utf-8") as file:
                return json.load(file)["rows"]
    raise ValueError(f"no report {report!r} in docs/results")


def field(row: dict[str, Any], name: str) -> Any:
    """A field of a row, or `outer.inner` of a field with fields; None where there is none."""
    value: Any = row
    for part in name.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return value


def matches(row: dict[str, Any], name: str, allowed: str) -> bool:
    """Whether a field is like one of the patterns divided by "|"; "" is empty or absent."""
    value = field(row, name)
    text = "" if value is None or value == {} else str(value)
    text = re.sub("[ :]", "_", text)
    return any(fnmatchcase(text, pattern) for pattern in allowed.split("|"))


def figure(source: str, shown: str) -> str:
    """One figure, as text.

    Raises:
        ValueError: No row or several where one is meant, an unknown field, function or report.
    """
    report, *conditions = source.split()
    pairs = [condition.split("=", 1) for condition in conditions]
    chosen = [row for row in rows(report) if all(matches(row, *pair) for pair in pairs)]
    words = shown.split()
    function = FUNCTIONS[words.pop(0)] if words[0] in FUNCTIONS else None
    name, *how = words
    chosen = [row for row in chosen if name in row or "." in name or name == "rows"]
    if not chosen:
        raise ValueError(f"no row of {report!r} has {' '.join(conditions)} and {name!r}")
    values = [field(row, name) for row in chosen]
    if function is None and len(set(map(str, values))) > 1:
        raise ValueError(f"{len(values)} rows of {report!r} have {' '.join(conditions)}")
    if function not in (None, len):
        values = [value for value in values if value is not None]
    value = function(values) if function else values[0]
    if value is None or isinstance(value, str):
        return value or NONE
    unit = next((word for word in how if word in FACTORS), "")
    form = next((word for word in how if word not in FACTORS), "g")
    if form.isdigit():
        return significant(value * FACTORS.get(unit, 1), int(form))
    return number(value, form, unit)


def significant(value: float, digits: int) -> str:
    """A number with so many significant digits, without an exponent."""
    if value == 0:
        return "0"
    places = digits - 1 - math.floor(math.log10(abs(value)))
    return f"{round(value, places):,.{max(places, 0)}f}".replace(",", " ")


def filled(template: str) -> str:
    """A template with its figures; errors as `figure`."""
    lines, each = [], None
    for line in template.strip().splitlines():
        if line.startswith("each "):
            name, _, values = line.removeprefix("each ").partition("=")
            each = name.strip(), [value.strip() for value in values.split(",")]
        elif each and f"{{{each[0]}}}" in line:
            lines += [line.replace(f"{{{each[0]}}}", value) for value in each[1]]
        else:
            lines.append(line)
    return "\n".join(FIGURE.sub(lambda found: figure(found[1], found[2]), line) for line in lines)


def fill(text: str) -> str:
    """A page with its figures; errors as `figure`."""

    def block(found: re.Match) -> str:
        lone = "\n" in found[2].strip()
        made = filled(found[2])
        return found[1] + (f"\n\n{made}\n\n" if lone else made) + found[4]

    return BLOCK.sub(block, text)


def main() -> int:
    """Write or check the pages; 1 where one is stale under `--check`."""
    stale = 0
    for path in pages():
        text = path.read_text(encoding="utf-8")
        new = fill(text)
        if new != text:
            stale += 1
            print(f"{path.relative_to(ROOT)}: figures are stale")
            if "--check" not in sys.argv:
                write_text(path, new)
    return int(bool(stale) and "--check" in sys.argv)


if __name__ == "__main__":
    sys.exit(main())
