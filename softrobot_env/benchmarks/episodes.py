"""Records of episodes that several benchmarks have."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

from softrobot_env.benchmarks.records import Record, groups, select
from softrobot_env.control.registry import POLICIES
from softrobot_env.evaluation.rows import EpisodeRow
from softrobot_env.evaluation.runner import Outcome
from softrobot_env.evaluation.thesis import CONTROLLERS

Kind = TypeVar("Kind", bound="EpisodeRecord")
AnyRecord = TypeVar("AnyRecord")


@dataclass(frozen=True, kw_only=True)
class EpisodeRecord(EpisodeRow, Record):
    """An episode of the arm.

    Attributes:
        decision_period: [s] between decisions of the policy.
        tension_max: [N], largest tension of a tendon; None after a failure.
    """

    decision_period: float
    tension_max: float | None


def record_of(outcome: Outcome, kind: type[Kind], **own: Any) -> Kind:
    """An episode as a record; `own` are the fields that its kind adds."""
    rollout, period = outcome.rollout, outcome.decision_period
    tension = float(rollout.tendon_tension.max()) if rollout.failure is None else None
    return outcome.row(kind, decision_period=period, tension_max=tension, **own)


def one(records: Iterable[AnyRecord], **values: Any) -> AnyRecord | None:
    """The first record that has given values in some fields; None if there is none."""
    return next(iter(select(records, **values)), None)


def of_kind(records: Iterable[Any], kind: type[AnyRecord]) -> list[AnyRecord]:
    """Records of a kind."""
    return [record for record in records if isinstance(record, kind)]


def names(records: Iterable[Any]) -> list[str]:
    """Policies in the order of their first records."""
    return [policy for (policy,) in groups(records, "policy")]


def policies() -> list[str]:
    """The thesis' controllers, then all others of the arm but the one that does nothing."""
    known = [*(name for name in CONTROLLERS if name in POLICIES), *POLICIES]
    return [name for name in dict.fromkeys(known) if name != "hold"]
