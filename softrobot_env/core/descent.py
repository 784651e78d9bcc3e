"""Damped steps downhill: what all methods of Levenberg and Marquardt have in common."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np


class Costly(Protocol):
    """What has a cost."""

    @property
    def cost(self) -> float:
        """Its cost."""


Place = TypeVar("Place", bound=Costly)


@dataclass(frozen=True)
class Damping:
    """How damping changes.

    Attributes:
        factor: By which it rises after a step that does not lower the cost, and falls after one
            that does.
        least: Smallest one to go on with.
        most: Beyond it nothing is tried.
        tries: Steps from one place, at most.
    """

    factor: float = 10.0
    least: float = 1e-20
    most: float = np.inf
    tries: int = 1000


def descend(
    here: Place, step: Callable[[float], Place], damping: float, rule: Damping
) -> tuple[Place | None, float]:
    """The first of ever shorter steps that lowers the cost.

    Args:
        here: Where the steps begin.
        step: From a damping to where its step leads; LinAlgError where the damping is too small.
        damping: Of the first step.
        rule: How it changes.

    Returns:
        Where it leads, None if no step lowers the cost, and the damping to go on with.
    """
    for _ in range(rule.tries):
        if damping > rule.most:
            break
        try:
            moved = step(damping)
        except np.linalg.LinAlgError:
            moved = None
        if moved is not None and moved.cost < here.cost:
            return moved, max(damping / rule.factor, rule.least)
        damping *= rule.factor
    return None, damping
