"""Finding and completing rows of the controller benchmark."""

from collections.abc import Iterable
from typing import Any

from softrobot_env.benchmarks.controllers.cases import Row

#: Parameter that sec. 6.6.3 varies.
E = "youngs_modulus"

#: Errors whose ratio to the nominal ones is of interest.
_ERRORS = ("e_max", "e_rms")


def select(rows: Iterable[Row], **fields: Any) -> list[Row]:
    """Rows of episodes with given values of some fields; modulus is the factor on E."""
    if "modulus" in fields:
        fields["variation"] = modulus_variation(fields.pop("modulus"))
    return [r for r in rows if "task" in r and all(r[k] == v for k, v in fields.items())]


def one(rows: Iterable[Row], **fields: Any) -> Row | None:
    """The row that `select` finds; None if there is none."""
    found = select(rows, **fields)
    return found[0] if found else None


def modulus_variation(factor: float) -> dict[str, float]:
    """Variation of a row for a factor on Young's modulus."""
    return {} if factor == 1 else {E: factor}


def moduli(rows: Iterable[Row]) -> list[float]:
    """Factors on Young's modulus that occur, 1 among them, in ascending order."""
    return sorted({1.0} | {r["variation"][E] for r in select(rows) if E in r["variation"]})


def names(rows: Iterable[Row]) -> list[str]:
    """Policies in the order of their first rows."""
    return list(dict.fromkeys(row["policy"] for row in select(rows)))


def with_ratios(rows: list[Row]) -> list[Row]:
    """The rows, those of varied robots with e_max_ratio and e_rms_ratio to the nominal one."""
    return [row | _ratios(rows, row) if row["variation"] else row for row in rows]


def _ratios(rows: list[Row], row: Row) -> Row:
    same = {k: row[k] for k in ("plant", "policy", "task", "step_width", "feedback")}
    nominal = one(rows, **same, variation={})
    return {f"{name}_ratio": _ratio(row, nominal, name) for name in _ERRORS}


def _ratio(row: Row, nominal: Row | None, name: str) -> float | None:
    if nominal is None or row[name] is None or not nominal[name]:
        return None
    return row[name] / nominal[name]
