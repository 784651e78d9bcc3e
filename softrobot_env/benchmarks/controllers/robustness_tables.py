"""Tables of the controllers on robots with other parameters than they know."""

from collections.abc import Iterator

from rich.table import Table

from softrobot_env.benchmarks.controllers.cases import TASKS, Row
from softrobot_env.benchmarks.controllers.cells import both, new_table, number, several, task_name
from softrobot_env.benchmarks.controllers.rows import E, moduli, names, one, select
from softrobot_env.evaluation.labels import variation_label
from softrobot_env.evaluation.thesis import CONTROLLERS, ROBUSTNESS

_PLANTS = {"pcc": "PCC", "mujoco": "MuJoCo"}

#: Metrics in a cell of a table over Young's modulus.
_STEP = ("e_rms", "settling_time", "overshoot")
_TRACKING = ("e_max", "e_rms")


def robustness_tables(rows: list[Row]) -> Iterator[Table]:
    """Errors over Young's modulus, largest ratios to the nominal ones, other parameters."""
    rows = select(rows, feedback="state")
    yield _modulus(rows, "pcc", "swing", None)
    for task, width in (*TASKS[3:], *TASKS[:3]):
        yield _modulus(rows, "mujoco", task, width)
    yield _ratios(rows)
    yield _others(rows)


def _modulus(rows: list[Row], plant: str, task: str, width: float | None) -> Table:
    """A line per policy, a column per factor on Young's modulus."""
    metrics, stroke = (_TRACKING, " / ") if width is None else (_STEP, "/")
    what = "max / rms mm" if width is None else "rms mm/settling s/over %"
    title = f"{task_name(task, width)} on {_PLANTS[plant]} with another Young's modulus: {what}"
    mine = select(rows, plant=plant, task=task, step_width=width)
    factors = moduli(mine)
    out = new_table(title, ("policy",), [f"E x {factor:g}" for factor in factors])
    for policy in names(mine) if len(factors) > 1 else ():
        found = [one(mine, policy=policy, modulus=factor) for factor in factors]
        out.add_row(policy, *(several(row, metrics, stroke) for row in found))
        if plant == "pcc" and policy in CONTROLLERS:
            out.add_row("  thesis", *_thesis(policy, factors))
    return out


def _thesis(policy: str, factors: list[float]) -> list[str]:
    said = ROBUSTNESS[CONTROLLERS[policy]]
    return [said.get(factor, "-") for factor in factors]


def _ratios(rows: list[Row]) -> Table:
    """Largest ratio to the nominal error over Young's modulus, by policy and task."""
    title = "MuJoCo: largest error with another Young's modulus over the nominal one (max / rms)"
    out = new_table(title, ("policy",), [task_name(*task) for task in TASKS])
    varied = [r for r in select(rows, plant="mujoco") if list(r["variation"]) == [E]]
    for policy in names(varied):
        cells = (_largest(select(varied, policy=policy, task=t, step_width=w)) for t, w in TASKS)
        out.add_row(policy, *cells)
    return out


def _largest(rows: list[Row]) -> str:
    if not rows:
        return "-"
    if any(row["failure"] is not None for row in rows):
        return "failed"
    metrics = ("e_max_ratio", "e_rms_ratio")
    known = ([r[m] for r in rows if r[m] is not None] for m in metrics)
    parts = [number(max(v, default=None), m) for v, m in zip(known, metrics, strict=True)]
    return " / ".join(parts if rows[0]["task"] != "step" else parts[1:])


def _others(rows: list[Row]) -> Table:
    """Density and damping, beyond the thesis."""
    title = "Swing on MuJoCo with another density or damping time (beyond the thesis)"
    heads = ("max mm", "rms mm", "max over nominal", "rms over nominal")
    out = new_table(title, ("policy", "variation"), heads)
    for row in select(rows, setting="robustness"):
        if E not in row["variation"]:
            ratios = (number(row[name], name) for name in ("e_max_ratio", "e_rms_ratio"))
            errors = (both([row], name) for name in _TRACKING)
            out.add_row(row["policy"], variation_label(row), *errors, *ratios)
    return out
