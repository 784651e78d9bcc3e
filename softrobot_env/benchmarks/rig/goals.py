"""Goals for the rig's controllers, and whether a run of the benchmark met them."""

from collections.abc import Iterator
from statistics import median

from softrobot_env.benchmarks.jobs import Row
from softrobot_env.benchmarks.rig.cases import FAST, SLOW
from softrobot_env.evaluation.thesis import TRIANGLE

#: The thesis' controller, and that with the model in several pieces, which a real rig is.
_HYBRIDS = ("hybrid", "hybrid_flexible")

#: Beyond the thesis: policy, and its mean error [m] on the fast triangle.
_BEST, _BEYOND = "hybrid_calibrated", 4e-3

_SPEED = 20.0  # times real time
_STEP = 0.020  # s, the control period

_NAMES = ("e_mean", "e_max")


def rows(found: list[Row]) -> list[Row]:
    """Goals and what rows of the benchmark say about them, medians over the twins.

    Returns:
        Rows with goal, policy, unit ("mm", "ms", "x" or "") to show, value, limit and met; value is
        None where an episode failed.
    """
    twins = [row for row in found if row.get("twin") is not None]
    return [*_accuracy(twins), *_ranking(twins), *_speed(twins)] if twins else []


def middle(rows: list[Row], name: str, policy: str, period: float) -> float | None:
    """Median of a value over the rigs; None if one of them failed, or none was run."""
    values = [row[name] for row in rows if (row["policy"], row["period"]) == (policy, period)]
    return None if not values or None in values else median(values)


def _accuracy(twins: list[Row]) -> Iterator[Row]:
    for policy in _HYBRIDS:
        for period in (SLOW, FAST):
            for name, limit in zip(_NAMES, TRIANGLE["hybrid", period], strict=True):
                text = f"T = {period:g} s, {'mean' if name == 'e_mean' else 'largest'} error"
                yield _at_most(text, policy, "mm", middle(twins, name, policy, period), limit)
    text = f"T = {FAST:g} s, mean error, beyond the thesis"
    yield _at_most(text, _BEST, "mm", middle(twins, "e_mean", _BEST, FAST), _BEYOND)


def _ranking(twins: list[Row]) -> Iterator[Row]:
    """By mean errors; a value of 1 says that it is the thesis'."""
    network, model, hybrid = "rig_nn", "inverse_dynamics", "hybrid"
    slow, fast = (
        {name: middle(twins, "e_mean", name, period) for name in (network, model, hybrid)}
        for period in (SLOW, FAST)
    )
    orders = (
        (f"T = {SLOW:g} s: hybrid before network before model", slow, (hybrid, network, model)),
        (f"T = {FAST:g} s: hybrid before model before network", fast, (hybrid, model, network)),
    )
    for text, errors, order in orders:
        values = [errors[name] for name in order]
        yield _true(text, None not in values and values == sorted(values))


def _speed(twins: list[Row]) -> Iterator[Row]:
    for policy in dict.fromkeys(row["policy"] for row in twins):
        mine = [row for row in twins if row["policy"] == policy]
        factor = median(row["computing_factor"] for row in mine)
        goal = _goal("inputs, times real time", policy, "x", factor, _SPEED)
        yield goal | {"met": factor >= _SPEED}
        longest = median(row["policy_time_p99"] for row in mine)
        yield _at_most("99 % of the decisions", policy, "ms", longest, _STEP)


def _goal(text: str, policy: str, unit: str, value: float | None, limit: float) -> Row:
    return {"goal": text, "policy": policy, "unit": unit, "value": value, "limit": limit}


def _at_most(text: str, policy: str, unit: str, value: float | None, limit: float) -> Row:
    goal = _goal(text, policy, unit, value, limit)
    return goal | {"met": value is not None and value <= limit}


def _true(text: str, met: bool) -> Row:
    return _goal(text, "", "", float(met), 1.0) | {"met": met}
