"""Records of episodes that several benchmarks have."""

from dataclasses import dataclass
from typing import Any, TypeVar

from softrobot_env.benchmarks.records import Record
from softrobot_env.control.registry import POLICIES
from softrobot_env.evaluation.rows import EpisodeRow
from softrobot_env.evaluation.runner import Outcome
from softrobot_env.thesis.figures import CONTROLLERS

Kind = TypeVar("Kind", bound="EpisodeRecord")


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


def policies() -> list[str]:
    """The thesis' controllers, then all others of the arm but the one that does nothing."""
    known = [*(name for name in CONTROLLERS if name in POLICIES), *POLICIES]
    return [name for name in dict.fromkeys(known) if name != "hold"]
