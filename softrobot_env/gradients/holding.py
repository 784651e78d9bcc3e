"""Springs of drives and dry friction of tendons in an Euler step, and back; compiled.

As `scene.integration.friction` finds them. Of the impulses s of the columns C, those of springs and
of what sticks are unknown, and those of what slides follow from the tensions ahead of them, hence
from these: s = N u + s0. With the answers Y of the inertia to the unknowns' columns,

    (E + Y' C' N) u = C_u v + Y' (r - C' s0),    A w = r - C' s,

so that only these are solved for. The adjoint goes through the same systems the other way round.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.native import jit
from softrobot_env.scene.integration import articulated
from softrobot_env.scene.integration.articulated import Tree
from softrobot_env.scene.integration.linear_algebra import dot

from . import model as m

#: As `scene.integration.friction`: what sticks gives way by this share, what is rounding, and how
#: often guesses are mended.
GIVE, _SLOW, _WEAK, _GUESSES, _PATIENCE = 1e-9, 1e-9, 1e-7, 200, 4


class Step(NamedTuple):
    """An Euler step from a posture.

    Attributes:
        tree: Factors of the mass matrix with springs and dampers.
        diagonal, right: (nv,), those, and impulses of all that is known before.
        answers: (1 + columns, nv), room, and change by impulses of the columns that are unknown.
        shares: (columns, columns), of the impulses over the unknowns, which are in this order.
        acts: (columns, nv), what all impulses do that follow from an unknown.
        factor: (columns, columns), factors of the system.
        grows: (columns,) [1], change of the tension in a zone that slides over that before it.
        impulse, known: (columns,), impulses, and what is known of them before.
        slide: (columns,), whether what rubs slides, by the sign of the length's rate, or sticks.
        sides: (columns,), that as what follows from it has it.
        change: (nv,), of velocities.
        unknown, order, answered: (columns,), which columns are unknown, rows of the factors, and
            whether there is an answer.
        found: (columns,), impulses of the unknowns.
        count: (1,), number of unknowns.
    """

    tree: Tree
    diagonal: ndarray
    right: ndarray
    answers: ndarray
    shares: ndarray
    acts: ndarray
    factor: ndarray
    grows: ndarray
    impulse: ndarray
    known: ndarray
    slide: ndarray
    sides: ndarray
    change: ndarray
    unknown: ndarray
    order: ndarray
    answered: ndarray
    found: ndarray
    count: ndarray


@jit
def hold(plan, values, at, step, h, known):
    """Find impulses and the change of velocities in a step [s] whose tree is factorized.

    What slides is known, or a guess.
    """
    columns, wound = at.columns.shape[0], plan.wound.size
    for c in range(columns):
        step.answered[c] = 0
    fewest, patience = columns + 1, _PATIENCE
    for _ in range(_GUESSES):
        _list_unknowns(plan, at, step)
        _share_out(plan, values, at, step, h)
        _find(plan, values, at, step, h)
        if known or wound == columns:
            return
        wrong = _judge(plan, values, at, step, h)
        if wrong == 0:
            return
        fewest, patience = (wrong, _PATIENCE) if wrong < fewest else (fewest, patience - 1)
        _mend(plan, step, patience > 0)


@jit
def is_there(plan, at, c):
    """Whether a column has an impulse: no drive at its limits has, and no zone that is straight."""
    wound, whole = plan.wound.size, plan.wound.size + plan.rubs.size
    if c < wound:
        return at.law[plan.wound[c]].real == 0
    return c < whole or at.exponent[c - whole].real > 0


@jit
def _list_unknowns(plan, at, step):
    """List the unknowns, and answer them."""
    count, columns = 0, at.columns.shape[0]
    for c in range(columns):
        if not is_there(plan, at, c) or (c >= plan.wound.size and step.slide[c].real != 0):
            continue
        step.unknown[count] = c
        count += 1
        if step.answered[c]:
            continue
        answer, step.answered[c] = step.answers[1 + c], 1
        for i in range(at.v.size):
            answer[i] = at.columns[c, i]
        articulated.solve(step.tree, step.answers[1 + c : 2 + c].T, 1)
    step.count[0] = count


@jit
def _spring(plan, step, drive):
    """Which of the unknowns is that of a drive, or -1."""
    for u in range(step.count[0]):
        c = step.unknown[u]
        if c < plan.wound.size and plan.wound[c] == drive:
            return u
    return -1


@jit
def _share_out(plan, values, at, step, h):
    """What is known of impulses, and their shares over the unknowns."""
    wound, whole, count = plan.wound.size, plan.wound.size + plan.rubs.size, step.count[0]
    for c in range(at.columns.shape[0]):
        step.known[c] = step.grows[c] = 0.0
        for u in range(count):
            step.shares[c, u] = 1.0 if step.unknown[u] == c else 0.0
        if wound <= c < whole:
            friction = values.tendon[plan.rubs[c - wound], m.FRICTION]
            step.known[c] = h * step.slide[c] * friction
        elif c >= whole and step.slide[c].real != 0:
            step.grows[c] = np.expm1(step.slide[c].real * at.exponent[c - whole])
            _share_ahead(plan, at, step, c, h)


@jit
def _share_ahead(plan, at, step, c, h):
    """Let the impulse of a zone that slides be its share of the tension before it."""
    whole = plan.wound.size + plan.rubs.size
    drive, grows = plan.zones[c - whole, 0], step.grows[c]
    spring = _spring(plan, step, drive)
    step.known[c] = grows * h * at.tension[drive]
    if spring >= 0:
        step.shares[c, spring] -= grows
    for b in range(c - 1, whole - 1, -1):
        if plan.zones[b - whole, 0] != drive:
            return
        step.known[c] += grows * step.known[b]
        for u in range(step.count[0]):
            step.shares[c, u] += grows * step.shares[b, u]


@jit
def _find(plan, values, at, step, h):
    """Solve for the unknowns by the guess of what slides; then impulses and change follow."""
    columns, count = at.columns.shape[0], step.count[0]
    found, room = step.found, step.answers[0]
    for i in range(at.v.size):
        room[i] = step.right[i]
        for u in range(count):
            step.acts[u, i] = 0.0
    for c in range(columns):
        _add(room, -step.known[c], at.columns[c])
        for u in range(count):
            _add(step.acts[u], step.shares[c, u], at.columns[c])
    for u in range(count):
        c = step.unknown[u]
        answer = step.answers[1 + c]
        found[u] = dot(at.columns[c], at.v) + dot(answer, room)
        for w in range(count):
            step.factor[u, w] = dot(answer, step.acts[w])
        if c < plan.wound.size:
            step.factor[u, u] -= 1 / (h * h * values.drive[plan.wound[c], m.BY_LENGTH])
        else:
            step.factor[u, u] *= 1 + GIVE
    _factorize(step.factor, step.order, count)
    _substitute(step.factor, step.order, found, count)
    for c in range(columns):
        step.impulse[c] = step.known[c]
        for u in range(count):
            step.impulse[c] += step.shares[c, u] * found[u]
    for u in range(count):
        _add(room, -found[u], step.acts[u])
    articulated.solve(step.tree, step.answers[:1].T, 1)
    for i in range(at.v.size):
        step.change[i] = room[i]


@jit
def _add(row, share, other):
    """Add a share of (nv,) to a row."""
    if share != 0:
        for i in range(row.size):
            row[i] += share * other[i]


@jit
def _judge(plan, values, at, step, h):
    """Of how many columns the guess of what slides was wrong; the mended one is kept."""
    wound, whole, columns = plan.wound.size, plan.wound.size + plan.rubs.size, at.columns.shape[0]
    largest, fastest, wrong, rates = 0.0, 0.0, 0, step.sides
    for c in range(wound, columns):
        rates[c] = dot(at.columns[c], at.v) + dot(at.columns[c], step.change)
        if is_there(plan, at, c):
            largest = max(largest, abs(step.impulse[c].real))
            fastest = max(fastest, abs(rates[c].real))
    ahead, drive = 0.0, -1
    for c in range(wound, columns):
        side, impulse, rate = step.slide[c].real, step.impulse[c].real, rates[c].real
        step.sides[c] = side
        if c < whole:
            most = h * values.tendon[plan.rubs[c - wound], m.FRICTION].real
            least = -most
        else:
            zone, exponent = plan.zones[c - whole], at.exponent[c - whole].real
            if zone[0] != drive:
                drive = zone[0]
                spring = _spring(plan, step, drive)
                ahead = h * at.tension[drive].real
                if spring >= 0:
                    ahead -= step.impulse[step.unknown[spring]].real
            most, least = (
                max(ahead, 0.0) * np.expm1(exponent),
                max(ahead, 0.0) * np.expm1(-exponent),
            )
            ahead += impulse
        if not is_there(plan, at, c):
            continue
        if side == 0:
            if impulse > most + _WEAK * largest:
                step.sides[c] = 1.0
            elif impulse < least - _WEAK * largest:
                step.sides[c] = -1.0
        elif side * rate < -_SLOW * fastest:
            step.sides[c] = 0.0
        wrong += step.sides[c].real != side
    return wrong


@jit
def _mend(plan, step, everywhere):
    """Adopt the mended guess, everywhere or of the last column that was wrong."""
    for c in range(step.slide.size - 1, plan.wound.size - 1, -1):
        if step.slide[c].real != step.sides[c].real:
            step.slide[c] = step.sides[c]
            if not everywhere:
                return


@jit
def _factorize(matrix, order, n):
    """Factors L U of a matrix (n, n), in its place, of its rows in an order (n,)."""
    for i in range(n):
        best = i
        for k in range(i + 1, n):
            if abs(matrix[k, i].real) > abs(matrix[best, i].real):
                best = k
        order[i] = best
        if best != i:
            for j in range(n):
                matrix[i, j], matrix[best, j] = matrix[best, j], matrix[i, j]
        for k in range(i + 1, n):
            matrix[k, i] /= matrix[i, i]
            for j in range(i + 1, n):
                matrix[k, j] -= matrix[k, i] * matrix[i, j]


@jit
def _substitute(factor, order, x, n):
    """x (n,) becomes the solution, by the factors of `_factorize`."""
    for i in range(n):
        x[i], x[order[i]] = x[order[i]], x[i]
    for i in range(n):
        for j in range(i):
            x[i] -= factor[i, j] * x[j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] -= factor[i, j] * x[j]
        x[i] /= factor[i, i]


@jit
def _substitute_transposed(factor, order, x, n):
    """As `_substitute`, of the transposed matrix."""
    for i in range(n):
        for j in range(i):
            x[i] -= factor[j, i] * x[j]
        x[i] /= factor[i, i]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            x[i] -= factor[j, i] * x[j]
    for i in range(n - 1, -1, -1):
        x[i], x[order[i]] = x[order[i]], x[i]


# ---------------------------------------------------------------- and back


@jit
def hold_back(plan, at, step, back):
    """Let the adjoint, of the inertia alone, be that of the step.

    `holding` becomes the adjoint of each impulse: of its equation.

    Returns:
        What of the derivative along a relative change of all impulses there is, but for signs.
    """
    adjoint, count, wanted = back.adjoint[0], step.count[0], step.found
    press(plan, at, step, adjoint, back.holding)
    size = 0.0
    for u in range(count):
        wanted[u] = back.holding[step.unknown[u]]
        size += abs(wanted[u] * step.impulse[step.unknown[u]])
    _substitute_transposed(step.factor, step.order, wanted, count)
    for u in range(count):
        for i in range(at.v.size):
            adjoint[i] -= wanted[u] * step.answers[1 + step.unknown[u], i]
    if plan.wound.size < at.columns.shape[0]:
        press(plan, at, step, adjoint, back.holding)
    for c in range(plan.wound.size):
        back.holding[c] = 0.0
    for u in range(count):
        back.holding[step.unknown[u]] = wanted[u]
    return size


@jit
def press(plan, at, step, adjoint, out):
    """What impulses (columns,) do along an adjoint, with those that follow from them."""
    whole, columns, behind, drive = plan.wound.size + plan.rubs.size, out.size, 0.0, -1
    for c in range(columns):
        out[c] = dot(at.columns[c], adjoint)
    for c in range(columns - 1, whole - 1, -1):
        if plan.zones[c - whole, 0] != drive:
            drive, behind = plan.zones[c - whole, 0], 0.0
        out[c] += behind
        behind += step.grows[c] * out[c]
        if c == whole or plan.zones[c - whole - 1, 0] != drive:
            spring = _spring(plan, step, drive)
            if spring >= 0:
                out[step.unknown[spring]] -= behind
