"""Goals for the rig's controllers, and whether a run of the benchmark met them."""

from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median

from softrobot_env.benchmarks.records import Record, names, select
from softrobot_env.benchmarks.rig.cases import FAST, SLOW, LapsRow
from softrobot_env.evaluation.thesis import TRIANGLE

#: The thesis' controller, and that with the model in several pieces, which a real rig is.
_HYBRIDS = ("hybrid", "hybrid_flexible")

#: Beyond the thesis: policy, and its mean error [m] on the fast triangle.
_BEST, _BEYOND = "hybrid_calibrated", 4e-3

_SPEED = 20.0  # times real time
_STEP = 0.020  # s, the control period

_NAMES = ("e_mean", "e_max")


@dataclass(frozen=True)
class GoalRow(Record):
    """A goal, and what was found.

    Attributes:
        goal: For people.
        policy: That is judged; "" where it is a ranking.
        unit: "mm", "ms", "x" or "", to show.
        value: In SI units; None where an episode failed.
        limit: The least or largest allowed.
        met: Whether it was met.
    """

    goal: str
    policy: str
    unit: str
    value: float | None
    limit: float
    met: bool


def rows(found: list[LapsRow]) -> list[GoalRow]:
    """Goals and what episodes say about them, medians over the twins."""
    twins = [row for row in found if row.twin is not None]
    return [*_accuracy(twins), *_ranking(twins), *_speed(twins)] if twins else []


def middle(rows: list[LapsRow], name: str, policy: str, period: float) -> float | None:
    """Median of a value over the rigs; None if one of them failed, or none was run."""
    values = [getattr(row, name) for row in select(rows, policy=policy, period=period)]
    return None if not values or None in values else median(values)


def _accuracy(twins: list[LapsRow]) -> Iterator[GoalRow]:
    for policy in _HYBRIDS:
        for period in (SLOW, FAST):
            for name, limit in zip(_NAMES, TRIANGLE["hybrid", period], strict=True):
                text = f"T = {period:g} s, {'mean' if name == 'e_mean' else 'largest'} error"
                yield _at_most(text, policy, "mm", middle(twins, name, policy, period), limit)
    text = f"T = {FAST:g} s, mean error, beyond the thesis"
    yield _at_most(text, _BEST, "mm", middle(twins, "e_mean", _BEST, FAST), _BEYOND)


def _ranking(twins: list[LapsRow]) -> Iterator[GoalRow]:
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
        met = None not in values and values == sorted(values)
        yield GoalRow(text, "", "", float(met), 1.0, met)


def _speed(twins: list[LapsRow]) -> Iterator[GoalRow]:
    for policy in names(twins):
        mine = select(twins, policy=policy)
        factor = median(row.computing_factor for row in mine)
        text = "inputs, times real time"
        yield GoalRow(text, policy, "x", factor, _SPEED, factor >= _SPEED)
        longest = median(row.policy_time_p99 for row in mine)
        yield _at_most("99 % of the decisions", policy, "ms", longest, _STEP)


def _at_most(text: str, policy: str, unit: str, value: float | None, limit: float) -> GoalRow:
    return GoalRow(text, policy, unit, value, limit, value is not None and value <= limit)
