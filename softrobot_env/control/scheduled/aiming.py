"""The target of laws with a plan: the equilibrium that moves with the reference.

Model errors are estimated from the actions actually applied, and compensated: a shift of the
curvatures, an offset of the tip, and, if wanted, the stiffness.
"""

from functools import singledispatch
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import implementation, kernel
from softrobot_env.core.interfaces import Observation

from ..base import FINE, SATURATED, UNREACHABLE, Memory, usable
from ..limits import finite
from ..reference_smoothing import begin_smoothing, memory_size, smoothed
from .law import Law, ScheduledLaw, in_space, strongest
from .table import Row, Table, blend, inverse_of, look_up

#: Damping of the inverse of the tip's derivative by actions.
_DAMPING = 1e-2

#: [1], memory of the stiffness estimate, times the period of the first mode; its weight on the
#: nominal stiffness, as curvature times length; and the range of its factors.
_FORGETTING, _TRUST, _RANGE = 2.0, 0.02, (0.3, 3.0)

#: Jumps [1] over the reach, and accelerations that replace them, over the reach and T^2.
_JUMP, _ACCELERATION = 1e-2, 29.0

#: Distance from the reference, over the reach, that the equilibria of the table leave at most.
_FAR = 0.02

#: [1], by which an action may exceed the one that needs the full force of a servo.
_ROUNDING = 1e-9


class Seen(NamedTuple):
    """The observations of a law with a plan, and the current actions.

    Attributes:
        curvature, rate: (n,) [1/m, 1/(m s)].
        tip, target: (2,) or (3,) [m], of the robot and of the reference.
        preview: (size k,) [m], of the target; empty without.
        previous: (m,) [1].
    """

    curvature: ndarray
    rate: ndarray
    tip: ndarray
    target: ndarray
    preview: ndarray
    previous: ndarray


class TrackingTarget(NamedTuple):
    """The target of a law, and the robot's deviation from it.

    Attributes:
        action: (m,) [1], of the equilibrium now.
        rising: (m,) [1/s], its rate with the moving reference.
        away: (2 n + m,), curvatures [1/m], their rates and actions, minus those of the moving
            equilibrium; (2 n,) for a law without actions as states.
        ways: (3 k,) [m], references ahead, minus the extrapolation of the present one at its
            velocity; (2 k,) in the plane of the arm.
        velocity: (3,) [m/s], of the reference.
        bending: (n, 3) [1/m2], how the curvatures at rest move with the reference.
        status_code: Why the law may miss its target, a code of `status`.
        gains: Of the law.
    """

    action: ndarray
    rising: ndarray
    away: ndarray
    ways: ndarray
    velocity: ndarray
    bending: ndarray
    status_code: int
    gains: ndarray


class AimingLaw(ScheduledLaw):
    """A law that plans about an equilibrium that moves with the reference."""

    observables = (*ScheduledLaw.observables, "reference_preview")

    def start(self, observation: Observation) -> Memory:
        """Begin from the current actions, with the nominal model.

        Raises:
            ValueError: The reference has too few coordinates, or the preview has another number of
                times than this policy needs.
        """
        law = self._law
        self._check_reference(observation)
        n, m = law.table.n, law.table.m
        values = np.zeros(3 * n + m + 6 + memory_size(3))
        # once per episode, so in plain Python: compiling these takes half a second
        own = remembered.py_func(values, n, m)
        own.held[:] = self._begun(observation)
        tip, here = observation["tip_position"], np.empty(3)
        here_seen = usable(tip if np.isfinite(tip).all() else observation["reference"])
        in_space.py_func(here_seen, law.planar, here)
        begin_smoothing.py_func(here, own.smoothing)
        return Memory(values, FINE)

    def stiffness(self, state: Memory) -> float:
        """Estimated factor [1] on the nominal stiffness; 1 unless the law is adaptive."""
        table = self._law.table
        own = remembered.py_func(state.values, table.n, table.m)
        return 1.0 + float(own.stiffness[0])


class Remembered(NamedTuple):
    """Views of the memory of an `AimingLaw`.

    Attributes:
        curvature, rate: (n,), before.
        shift: (n,), of the curvatures at rest; for the arm, the force on them.
        held: (m,), actions of the previous equilibrium.
        offset: (3,) [m], of the tip.
        stiffness: (2,), sums from which it is estimated.
        begun: (1,), whether a decision was made before.
        smoothing: Of references.
    """

    curvature: ndarray
    rate: ndarray
    shift: ndarray
    held: ndarray
    offset: ndarray
    stiffness: ndarray
    begun: ndarray
    smoothing: ndarray


@kernel
def remembered(memory: ndarray, n: int, m: int) -> Remembered:
    """The parts of a memory, for n curvatures and m actions."""
    k = 3 * n + m
    return Remembered(
        memory[:n],
        memory[n : 2 * n],
        memory[2 * n : 3 * n],
        memory[3 * n : k],
        memory[k : k + 3],
        memory[k + 3 : k + 5],
        memory[k + 5 : k + 6],
        memory[k + 6 :],
    )


@kernel
def _estimate(law: Law, now: Row, memory: ndarray, seen: Seen, tip: ndarray) -> ndarray:
    """Update the estimated model errors; returns the shift (n,) [1/m] of the curvatures at rest.

    From the balance of forces, divided by the stiffness: K^-1 (M q.. + D q.) + q - q_OP - X (a -
    a_OP).
    """
    own, rate = remembered(memory, law.table.n, law.table.m), seen.rate
    shift, stiffer = own.shift, own.stiffness
    bend = seen.curvature - now.curvature
    missing = tip - now.tip - now.jacobian @ bend
    if own.begun[0]:
        left = now.inertia @ ((rate - own.rate) / law.period) + now.damping @ rate + bend
        left -= now.by_action @ (seen.previous - now.action)
        if law.adaptive:
            _adapt(law, now, left, stiffer)
        left += stiffer[0] * now.elastic
        shift += law.force * (left - shift)
        own.offset[:] += law.offset * (missing - own.offset)
    elif law.offset > 0:
        own.offset[:] = missing
    own.begun[0] = 1.0
    own.rate[:] = rate
    return shift - stiffer[0] * now.elastic


@kernel
def _adapt(law: Law, now: Row, left: ndarray, stiffer: ndarray) -> None:
    """Update the factor stiffer[0]: springs stiffer by a share s shift curvatures by -s elastic.

    Least squares with forgetting, as one gradient step.
    """
    trust = (_TRUST / law.reach) ** 2 * len(left)
    size = trust + np.sum(now.elastic**2)
    error = -np.sum(now.elastic * left) - stiffer[0] * size
    stiffer[0] += min(law.period / law.first * _FORGETTING, 1.0) * error / size
    stiffer[0] = min(max(stiffer[0], _RANGE[0] - 1), _RANGE[1] - 1)


@kernel
def references_of(
    law: Law, target: ndarray, preview: ndarray, smoothing: ndarray
) -> tuple[ndarray, ndarray]:
    """Points (1 + k, 3) [m], now and ahead, without jumps, and the present velocity (3,) [m/s]."""
    times, size = law.times, len(target)
    points = np.zeros((len(times), 3))
    in_space(target, law.planar, points[0])
    if len(times) == 1:
        return points, np.zeros(3)
    for k in range(1, len(times)):
        in_space(preview[(k - 1) * size : k * size], law.planar, points[k])
    far = _ACCELERATION * law.reach / law.first**2
    here = points[0].copy()
    smoothed(law.period, here, times, _JUMP * law.reach, far, smoothing, points)
    velocity, square = np.empty(3), 0.0
    for x in range(3):
        velocity[x] = (points[1, x] - points[0, x]) / times[1]
        square += velocity[x] * velocity[x]
    if np.sqrt(square) * law.period > _JUMP * law.reach:
        velocity[:] = 0.0  # a jump ahead has no velocity
    return points, velocity


@singledispatch
def aimed(table: Any, law: Any, memory: Any, seen: Any) -> Any:
    """Find and correct the equilibrium at the reference, as `TrackingTarget`; memory is updated.

    Args:
        table: The operating points.
        law: The law that they belong to.
        memory: See `Remembered`.
        seen: A `Seen`.
    """
    raise NotImplementedError


@implementation(aimed, Table)
@kernel
def _looked_up(table: Table, law: Law, memory: ndarray, seen: Seen) -> TrackingTarget:
    n, m, knots = table.n, table.m, len(law.times) - 1
    own = remembered(memory, n, m)
    tip = np.empty(3)
    in_space(seen.tip, law.planar, tip)
    points, velocity = references_of(law, seen.target, seen.preview, own.smoothing)
    now = look_up(table, points[0], own.held)
    own.held[:] = now.action
    shift = _estimate(law, now, memory, seen, tip)

    to_action = inverse_of(now.jacobian @ now.by_action, table.directions, _DAMPING)
    gap = table.directions @ (now.tip - points[0])
    correction = -(to_action @ (now.jacobian @ shift + own.offset + now.tip - points[0]))
    rising = to_action @ velocity
    moving = now.by_action @ rising
    braking = now.damping @ moving
    correction += to_action @ (now.jacobian @ braking)
    action = now.action + correction
    away, ways, ahead = np.empty(2 * n + m), np.empty(3 * knots), np.empty(m)
    moved, before = now.jacobian @ now.by_action, now.action
    away[:n] = seen.curvature - (now.curvature + shift - braking + now.by_action @ correction)
    away[n : 2 * n] = seen.rate - moving
    away[2 * n :] = seen.previous + law.period * rising - action
    for i in range(knots):
        if law.times[i + 1] > law.curved * law.first:
            blend(table, points[i + 1], before, ahead)
            way = moved @ (ahead - now.action)
            before = ahead.copy()
        else:
            way = points[i + 1] - points[0]
        ways[3 * i : 3 * i + 3] = way - law.times[i + 1] * velocity
    bending, status_code = now.by_action @ to_action, status_code_of(law, gap)
    return TrackingTarget(action, rising, away, ways, velocity, bending, status_code, now.gains)


@kernel
def status_code_of(law: Law, gap: ndarray) -> int:
    """Status code for a gap (k,) [m] between the operating point's tip and the reference."""
    return UNREACHABLE if np.sqrt(np.sum(gap**2)) > _FAR * law.reach else FINE


@kernel
def planned(law: Law, aim: TrackingTarget) -> ndarray:
    """(c, m) [1]: actions at the nodes, as `plan_gains` plans them."""
    table, count = law.table, len(law.nodes)
    n, m = table.n, table.m
    away, ways, gains = aim.away, aim.ways, aim.gains
    inner, outer = len(away), len(ways)
    size = count * m * inner
    feedback = gains[:size].reshape(count * m, inner)
    ahead = gains[size : size + count * m * outer].reshape(count * m, outer)
    actions = np.empty((count, m))
    for c in range(count):
        for j in range(m):
            row = c * m + j
            wanted = aim.action[j] + (law.nodes[c] - law.period) * aim.rising[j]
            if inner > 2 * n:
                wanted += away[2 * n + j]
            for i in range(inner):
                wanted -= feedback[row, i] * away[i]
            for i in range(outer):
                wanted += ahead[row, i] * ways[i]
            actions[c, j] = wanted
    return actions


@kernel
def seen_well(seen: Seen) -> bool:
    """Whether all observations are finite."""
    state = finite(seen.curvature) and finite(seen.rate) and finite(seen.tip)
    return state and finite(seen.target) and finite(seen.preview) and finite(seen.previous)


@kernel
def forget_balance(law: Law, memory: ndarray) -> None:
    """Restart the balance of forces: the next one would span more than a period."""
    remembered(memory, law.table.n, law.table.m).begun[0] = 0.0


@kernel
def conclude(
    law: Law,
    wanted: ndarray,
    previous: ndarray,
    curvature: ndarray,
    status_code: int,
    memory: ndarray,
) -> tuple[ndarray, ndarray, int]:
    """Action (m,), next memory and code of a decision.

    Where drives are too slow for a change of the actions, all changes are scaled down by the same
    factor; where they are too weak, the code says so. The action is NaN if it or the memory could
    not be computed; `Controller` then keeps both.

    Args:
        law: The law, with the speeds of its drives.
        wanted: (m,) [1].
        previous: (m,) [1], current actions.
        curvature: (n,) [1/m].
        status_code: Code of any other reason why the law may miss its target.
        memory: Of this decision.
    """
    m, share, code, speed = len(wanted), 1.0, status_code, law.speed
    if not (finite(wanted) and finite(memory)):
        return np.full(m, np.nan), memory, FINE
    for j in range(m):
        share = min(share, speed[j] / max(abs(wanted[j] - previous[j]), 1e-300))
    action, most = np.empty(m), strongest(law, curvature)
    for j in range(m):
        asked = previous[j] + share * (wanted[j] - previous[j])
        action[j] = min(max(asked, -1.0), 1.0)
        if action[j] != asked or share < 1.0 or action[j] > most[j] + _ROUNDING:
            code = SATURATED
    return action, memory, code
