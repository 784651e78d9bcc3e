"""Tables of operating points with the gains of a law at each, and their use in kernels."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from softrobot_env.compile.kernels import kernel, structure

#: Largest number of points in a blend.
NEIGHBOURS = 6

#: [1], smallest distance of a point, in actions: at a point the blend is that point alone.
_ON_POINT = 1e-9


@structure
class Table(NamedTuple):
    """Operating points and gains, of n curvatures, m actions, k gains per action.

    Attributes:
        n, m: Sizes.
        tips: (points, 3) [m].
        to_action: (points, m, 3) [1/m], see `operating_points.Equilibrium`.
        directions: (k, 3), unit vectors along which the tip can be controlled.
        moment_arms: (m, n) [N m], of a robot driven by length: how much the tension of a tendon
            falls as the curvatures grow; zeros for others.
        rows: (points, size), one row for each point, see `split`.
    """

    n: int
    m: int
    tips: ndarray
    to_action: ndarray
    directions: ndarray
    moment_arms: ndarray
    rows: ndarray


@kernel
def blend_weights(
    table: Table, place: ndarray, held: ndarray, index: ndarray, weight: ndarray
) -> int:
    """Points near a place, and their weights, which change smoothly with it and sum to one.

    The distance of a point is measured by the actions that would move the tip from it to the place,
    so that points lie close together where the statics are strongly nonlinear, and by the
    difference of the resulting actions from those held until now. So a robot that can hold a place
    in several configurations stays in its present one. The weights, ((R - d) / (R d))^2 with R the
    distance of the first point left out (Franke and Little), vanish where a point becomes one of
    the nearest.

    Args:
        table: The table.
        place: (3,) [m].
        held: (m,) [1], equilibrium of the previous decision.
        index: (k,), set to the points.
        weight: (k,), set to their weights.

    Returns:
        Number of points: the entries after it are not set.
    """
    tips, to_action, count = table.tips, table.to_action, len(table.tips)
    near = min(len(index), count)
    distance = np.full(near + 1, np.inf)
    order = np.zeros(near + 1, np.int64)
    way = np.empty(3)
    for i in range(count):
        for x in range(3):
            way[x] = place[x] - tips[i, x]
        square = 0.0
        for j in range(table.m):
            step = 0.0
            for x in range(3):
                step += to_action[i, j, x] * way[x]
            away = table.rows[i, j] + step - held[j]
            square += step * step + away * away
        if square < distance[near]:
            slot = near
            while slot > 0 and square < distance[slot - 1]:
                distance[slot], order[slot] = distance[slot - 1], order[slot - 1]
                slot -= 1
            distance[slot], order[slot] = square, i
    total, outer = 0.0, np.sqrt(distance[near])
    for slot in range(near):
        d = max(np.sqrt(distance[slot]), _ON_POINT)
        index[slot] = order[slot]
        share = 1 / d if np.isinf(outer) else max(outer - d, 0.0) / (outer * d)
        weight[slot] = share * share
        total += weight[slot]
    if total == 0.0:  # all at the same distance
        weight[:near] = 1.0
        total = float(near)
    for slot in range(near):
        weight[slot] /= total
    return near


class Row(NamedTuple):
    """Data for a position of the tip; views of one array.

    Attributes:
        action: (m,) [1], at rest there.
        curvature: (n,) [1/m], likewise.
        tip: (3,) [m], of that equilibrium: the position, unless it is out of reach.
        to_action: P (m, 3) [1/m].
        by_action: X (n, m) [1/m].
        jacobian: C (3, n) [m2].
        inertia: K^-1 M (n, n) [s2].
        damping: K^-1 D (n, n) [s].
        elastic: (n,) [1/m], K^-1 times the force of the springs: to first order the decrease of the
            curvature for springs twice as stiff.
        second: (m + n + 3, k (k + 1) / 2), second order of action, curvature and tip in the
            displacements (k,) [m] along the directions: factors of their products.
        gains: Of the law.
    """

    action: ndarray
    curvature: ndarray
    tip: ndarray
    to_action: ndarray
    by_action: ndarray
    jacobian: ndarray
    inertia: ndarray
    damping: ndarray
    elastic: ndarray
    second: ndarray
    gains: ndarray


def row_size(n: int, m: int, k: int) -> int:
    """Size of a row before the gains, for n curvatures, m actions and k directions."""
    terms = k * (k + 1) // 2
    return m + n + 3 + 3 * m + n * m + 3 * n + 2 * n * n + n + (m + n + 3) * terms


@kernel
def split(row: ndarray, n: int, m: int, k: int) -> Row:
    """Views of a row (size,) for n curvatures, m actions and k directions."""
    a, b = m + n, m + n + 3
    c = b + 3 * m
    d = c + n * m
    e = d + 3 * n
    f, g = e + n * n, e + 2 * n * n
    terms = k * (k + 1) // 2
    h = g + n + b * terms
    return Row(
        row[:m],
        row[m:a],
        row[a:b],
        row[b:c].reshape(m, 3),
        row[c:d].reshape(n, m),
        row[d:e].reshape(3, n),
        row[e:f].reshape(n, n),
        row[f:g].reshape(n, n),
        row[g : g + n],
        row[g + n : h].reshape(b, terms),
        row[h:],
    )


@kernel
def look_up(table: Table, place: ndarray, held: ndarray) -> Row:
    """The row at a place (3,) [m]: a blend of nearby points, each expanded to second order.

    Args:
        table: The table.
        place: (3,) [m].
        held: (m,) [1], actions of the previous equilibrium.
    """
    out = np.empty(table.rows.shape[1])
    blend(table, place, held, out)
    return split(out, table.n, table.m, len(table.directions))


@kernel
def blend(table: Table, place: ndarray, held: ndarray, out: ndarray) -> None:
    """Set out (size,) to the row of `look_up`, or out (m,) to its actions, which is far faster."""
    n, m, whole = table.n, table.m, len(out) > table.m
    index, weight = np.empty(NEIGHBOURS, np.int64), np.empty(NEIGHBOURS)
    count = blend_weights(table, place, held, index, weight)
    out[:] = 0.0
    for slot in range(count):
        share, row = weight[slot], table.rows[index[slot]]
        for i in range(len(out)):
            out[i] += share * row[i]
        point = split(row, n, m, len(table.directions))
        way = place - table.tips[index[slot]]
        step = point.to_action @ way
        for j in range(m):
            out[j] += share * step[j]
        for i in range(n if whole else 0):
            bend = 0.0
            for j in range(m):
                bend += point.by_action[i, j] * step[j]
            out[m + i] += share * bend
            for x in range(3):
                out[m + n + x] += share * point.jacobian[x, i] * bend
        _add_second(share, point, way, table.directions, out[: m + n + 3])


@kernel
def _add_second(share: float, point: Row, way: ndarray, directions: ndarray, out: ndarray) -> None:
    """Add a share of the second order in a displacement (3,) [m] to the first entries (k,)."""
    along, term = directions @ way, 0
    for x in range(len(along)):
        for y in range(x + 1):
            square = share * along[x] * along[y]
            for i in range(len(out)):
                out[i] += square * point.second[i, term]
            term += 1


@kernel
def inverse_of(moved: ndarray, directions: ndarray, damping: float) -> ndarray:
    """(m, 3): actions of least norm that move the tip along directions (k, 3), damped.

    Args:
        moved: J (3, m) [m], derivative of the tip by the actions at rest.
        directions: Unit vectors.
        damping: Over the norm of J.
    """
    along = directions @ moved
    square = along @ along.T
    size = 0.0
    for i in range(len(square)):
        size += square[i, i]
    for i in range(len(square)):
        square[i, i] += damping**2 * size
    return along.T @ np.linalg.solve(square, directions)
