"""Records of the controller benchmark."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

from softrobot_env.benchmarks.episodes import EpisodeRecord, of_kind, one
from softrobot_env.benchmarks.records import Record, drawn
from softrobot_env.evaluation.rollout import Rollout

#: Parameter that sec. 6.6.3 varies.
E = "youngs_modulus"


@dataclass(frozen=True, kw_only=True)
class ControllerRow(EpisodeRecord):
    """An episode.

    Attributes:
        setting: What it belongs to, one of `controllers.run.SETTINGS`.
        feedback: What the policy measured.
        e_motion, e_motion_least: [m], largest and smallest error between the kinks of the
            reference; None for steps, and after a failure.
        trace: Every few milliseconds of the episode, on the thesis' plant.
    """

    setting: str
    feedback: str
    e_motion: float | None
    e_motion_least: float | None
    trace: Rollout | None = drawn()  # noqa: RUF009

    @property
    def modulus(self) -> float | None:
        """Factor on Young's modulus; None where something else varies."""
        return 1.0 if not self.variation else self.variation.get(E)


@dataclass(frozen=True, kw_only=True)
class VariedRow(ControllerRow):
    """An episode with another robot than the policy knows.

    Attributes:
        e_max_ratio, e_rms_ratio: Errors over those with the nominal robot [1]; None if there are
            none.
    """

    e_max_ratio: float | None
    e_rms_ratio: float | None


@dataclass(frozen=True)
class GoalRow(Record):
    """A goal, and what was found.

    Attributes:
        goal: For people.
        policy, setting: Of the episodes that are judged.
        metric: Field of a row, whose unit is that of value and limit.
        value: None where an episode failed or never settled.
        limit: The largest allowed.
        met: Whether it was met.
    """

    goal: str
    policy: str
    setting: str
    metric: str
    value: float | None
    limit: float
    met: bool


Row = ControllerRow | GoalRow


def episodes(rows: Iterable[Row]) -> list[ControllerRow]:
    """Rows of episodes."""
    return of_kind(rows, ControllerRow)


def moduli(rows: Iterable[ControllerRow]) -> list[float]:
    """Factors on Young's modulus that occur, 1 among them, in ascending order."""
    return sorted({1.0} | {row.modulus for row in rows if row.modulus is not None})


def with_ratios(rows: list[ControllerRow]) -> list[ControllerRow]:
    """The rows, those of varied robots with ratios to the nominal one."""
    return [_varied(rows, row) if row.variation else row for row in rows]


def _varied(rows: list[ControllerRow], row: ControllerRow) -> VariedRow:
    kept = ("plant", "policy", "task", "step_width", "feedback")
    nominal = one(rows, **{name: getattr(row, name) for name in kept}, variation={})
    ratios: dict[str, Any] = {}
    for name in ("e_max", "e_rms"):
        value, base = getattr(row, name), getattr(nominal, name, None)
        ratios[f"{name}_ratio"] = None if value is None or not base else value / base
    return VariedRow(**{f.name: getattr(row, f.name) for f in fields(ControllerRow)}, **ratios)
