"""How an equilibrium is found, alike for every model: along the path of growing loads.

The path of equilibria from the robot at rest is followed by predictor and corrector, its length
being the parameter instead of the loads' share (Riks 1979; Allgower and Georg, Introduction to
Numerical Continuation Methods): it may turn back where the robot snaps. The steps are as long as
Newton's method contracts fast, so that it stays on the branch that slow loading leads to.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from numpy import ndarray

from .equilibrium import EquilibriumError

_ITERATIONS = 40  # from a guess
_HALVINGS = 6  # of a careful iteration
_LARGEST_CHANGE = 0.5  # of a coordinate's scale in one iteration or step
_GAINED = 0.5  # of a change is what the next one may be after a full iteration
_HOPELESS = 1.5  # times what the iterations that are left can change
_CONVERGED = 1e-10
_STALLED = 1e-7  # where a change that no longer shrinks is rounding error
_NEARLY = 0.2  # of a coordinate's scale: changes after which the old stiffness may serve again
_WORTH = 0.3  # of a change is what the next one may be where the old stiffness serves
_NEAR = 1e-7  # of the path: a slender rod resists a stretch of 1e-4 with all its strength
_CORRECTIONS = 12
_FIRST_CORRECTION, _CONTRACTION = 0.3, 0.3  # beyond which a step is too long
_FEW, _MANY = 5, 8  # corrections after which the next step is longer, or shorter
_SHORTEST = 1e-5
_STEPS = 2000


class Newton(NamedTuple):
    """Changes (n,) by Newton's method: to balance the forces, and per share of the loads."""

    balance: ndarray
    per_share: ndarray


class Loaded(Protocol):
    """A model under a share of its inputs, gravity and pretension.

    Attributes:
        scale: (n,) size of a large change of each coordinate.
    """

    scale: ndarray

    def newton(self, q: ndarray, share: float) -> Newton | None:
        """Newton's changes at q, None where the stiffness is singular or not finite."""

    def again(self, q: ndarray, share: float) -> ndarray:
        """The change (n,) to balance the forces at q, by the stiffness of the last `newton`."""

    def moved(self, q: ndarray, change: ndarray) -> ndarray:
        """Coordinates changed by (n,)."""


class _Point(NamedTuple):
    """An equilibrium q (n,) under a share of the loads, and the path's direction there."""

    q: ndarray
    share: float
    turn: ndarray
    growth: float


def find_equilibrium(
    loaded: Loaded,
    rest: ndarray,
    guess: ndarray | None,
    load_steps: int,
    careful: bool = False,
    nearby: bool = False,
) -> ndarray:
    """Equilibrium under full loads, near a guess or else where slow loading leads.

    Args:
        loaded: The model and its loads.
        rest: Coordinates in equilibrium without loads.
        guess: Coordinates, tried first.
        load_steps: Least number of equal steps of the loads.
        careful: Whether to shorten steps from the guess, which forces with kinks need.
        nearby: Whether only the guess is tried, and no path followed.

    Raises:
        EquilibriumError: There is none near the guess, or the path does not reach the loads, or
            could not be followed.
    """
    q = None if guess is None else _near(loaded, guess, careful)
    if q is None and nearby:
        raise EquilibriumError("there is no equilibrium near the guess")
    return _follow(loaded, rest, load_steps) if q is None else q


def _size(loaded: Loaded, change: ndarray) -> float:
    """Largest change of a coordinate relative to its scale."""
    return float(np.max(np.abs(change) / loaded.scale))


def _near(loaded: Loaded, q: ndarray, careful: bool) -> ndarray | None:
    """Equilibrium (n,) under full loads by damped iterations, None if they do not converge.

    Careful ones are so short that the next change, by the same stiffness, is smaller (Deuflhard,
    Newton Methods for Nonlinear Problems, 2004): forces with kinks, of what sticks or slides or of
    tendons that go slack, make full ones go to and fro. So they are careful once a full one gained
    little. They end when what is left of them would be too few for a change as large as it is.
    """
    before, quick, full = np.inf, False, False
    for left in range(_ITERATIONS, 0, -1):
        change = loaded.again(q, 1.0) if quick else _balance(loaded, q)
        if change is None:
            return None
        size = _size(loaded, change)
        if size > _HOPELESS * left * _LARGEST_CHANGE:
            return None
        if quick and not size < _WORTH * before:  # the stiffness has become another
            quick = False
            continue
        careful = careful or (full and size > _GAINED * before)
        share = min(1.0, _LARGEST_CHANGE / size) if size > 0 else 1.0
        there = loaded.moved(q, share * change)
        for _ in range(_HALVINGS if careful else 0):
            if _size(loaded, loaded.again(there, 1.0)) <= (1 - share / 4) * size:
                break
            share /= 2
            there = loaded.moved(q, share * change)
        q = there
        if _converged(size, before):
            return q
        quick, before, full = size < _NEARLY and not careful, size, share == 1
    return None


def _balance(loaded: Loaded, q: ndarray) -> ndarray | None:
    change = loaded.newton(q, 1.0)
    return None if change is None else change.balance


def _converged(size: float, before: float) -> bool:
    return size < _CONVERGED or (size < _STALLED and size > 0.5 * before)


def _follow(loaded: Loaded, rest: ndarray, load_steps: int) -> ndarray:
    """Equilibrium (n,) under full loads at the end of the path from rest."""
    tangent = loaded.newton(rest, 0.0)
    if tangent is None:
        raise EquilibriumError("nothing holds the robot: its stiffness at rest is singular")
    point = _point(loaded, rest, 0.0, tangent.per_share, None)
    length, furthest = _LARGEST_CHANGE, 0.0
    for _ in range(_STEPS):
        length = min(length, 1 / load_steps / max(abs(point.growth), 1e-12))
        found, corrections = _step(loaded, point, length)
        if found is None:
            length /= 2
            if length < _SHORTEST:
                raise EquilibriumError(_lost(furthest, "could not be followed any further"))
            continue
        if found.share == 1.0:
            return found.q
        point, furthest = found, max(furthest, found.share)
        if point.share < 0:
            raise EquilibriumError(_lost(furthest, "turns back there and never reaches them"))
        if corrections <= _FEW:
            length = min(2 * length, _LARGEST_CHANGE)
        elif corrections >= _MANY:
            length /= 1.5
    raise EquilibriumError(_lost(furthest, f"goes on for more than {_STEPS} steps"))


def _lost(share: float, why: str) -> str:
    return (
        f"no equilibrium beyond {share:.1%} of the loads: the path of equilibria that growing "
        f"loads lead along {why}"
    )


def _point(
    loaded: Loaded, q: ndarray, share: float, per_share: ndarray, old: _Point | None
) -> _Point:
    """A point whose direction has size one and goes on from an old one."""
    size = max(_size(loaded, per_share), 1.0)
    turn, growth = per_share / size, 1 / size
    if old is not None and turn @ (loaded.scale**-2 * old.turn) + growth * old.growth < 0:
        turn, growth = -turn, -growth
    return _Point(q, share, turn, growth)


def _step(loaded: Loaded, start: _Point, length: float) -> tuple[_Point | None, int]:
    """The next point, None if the step is too long, and the corrections it took.

    Newton's method runs across the path's direction, or at full loads where they would be passed.
    A stiffness serves for further corrections as long as these shrink as fast as they have to.
    """
    final = start.share + length * start.growth >= 1
    if final:
        length = (1 - start.share) / start.growth
    q = loaded.moved(start.q, length * start.turn)
    share = 1.0 if final else start.share + length * start.growth
    weights, change, quick = loaded.scale**-2 * start.turn, None, False
    before = full = np.inf  # changes by the last stiffness, and by the last of its own
    for correction in range(_CORRECTIONS):
        if quick:
            change = Newton(loaded.again(q, share), change.per_share)
        else:
            change = loaded.newton(q, share)
        if change is None:
            return None, correction
        rise = 0.0
        if not final:
            rise = -(weights @ change.balance) / (weights @ change.per_share + start.growth)
        moved = change.balance + rise * change.per_share
        size = max(_size(loaded, moved), abs(rise))
        contracts = size < _CONTRACTION * before or size < _STALLED
        if quick and not contracts:  # the stiffness has become another
            quick, before = False, full
            continue
        if not (size < _FIRST_CORRECTION and contracts):
            return None, correction
        q, share = loaded.moved(q, moved), share + rise
        if _converged(size, before) if final else size < _NEAR:
            if share > 1:  # the loads were passed by
                return None, correction
            return _point(loaded, q, share, change.per_share, start), correction
        full = full if quick else size
        before, quick = size, True
    return None, _CORRECTIONS


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
