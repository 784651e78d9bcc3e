"""How fibres and tags follow a shape: compiled, the same for one robot and for many.

A shape is the rotation of the cross-sections per length, (beta, gamma, torsion) [1/m], constant in
each of some cells along the robot: the stations of a chain, or parts of a beam's pieces.
"""

import numba
import numpy as np
from numpy import ndarray

_kernel = numba.njit(cache=True, error_model="numpy")


class Places:
    """Where on the robot joints of fibres and spans between sections are.

    Attributes:
        nodes: (g,) [m], all ends of cells, fibres and spans.
        cell: (g - 1,), which cell lies between neighbours of these.
        joints: (j, 3), nodes at the ends of two fibres that meet.
        spans: (k, 2), nodes between whose sections a turn is measured.
    """

    def __init__(
        self,
        edges: ndarray,
        joints: list[tuple[float, float, float]],
        spans: list[tuple[float, float]],
    ) -> None:
        """Place joints and spans, given as arc lengths [m], on cells with edges (cells + 1,)."""
        ends = np.array([s for ends in (*joints, *spans) for s in ends])
        # Nodes that differ by rounding only are one.
        tiny = 1e-9 * edges[-1]
        raw = np.sort(np.concatenate([edges, ends]))
        self.nodes = raw[np.append(True, np.diff(raw) > tiny)]
        middle = (self.nodes[:-1] + self.nodes[1:]) / 2
        self.cell = np.clip(np.searchsorted(edges, middle) - 1, 0, len(edges) - 2)
        self.joints = self._nodes(joints, 3)
        self.spans = self._nodes(spans, 2)

    def _nodes(self, places: list[tuple[float, ...]], size: int) -> ndarray:
        flat = np.array(places, float).reshape(-1, size)
        return np.abs(self.nodes - flat[..., None]).argmin(axis=-1)

    def turns(self, strain: ndarray) -> tuple[ndarray, ndarray]:
        """Angles [rad] towards +x and +y of robots' own, turning sections.

        Args:
            strain: (n, cells, 3) [1/m].

        Returns:
            Of fibres at their joints, from chord to chord (n, j, 2); and of spans (n, k, 2), the
            integral of beta and gamma.
        """
        count = len(strain)
        bent = np.empty((count, len(self.joints), 2)), np.empty((count, len(self.spans), 2))
        _turns(np.ascontiguousarray(strain), self.nodes, self.cell, self.joints, self.spans, *bent)
        return bent


@_kernel
def _turns(strain, nodes, cell, joints, spans, at_joints, over_spans):
    """Set angles (n, j, 2) and (n, k, 2), see `Places.turns`."""
    count = len(nodes)
    place, frame = np.zeros((count, 3)), np.zeros((count, 3, 3))
    total = np.zeros((count, 2))
    for k in range(3):
        frame[0, k, k] = 1.0
    for robot in range(len(strain)):
        for i in range(count - 1):
            length = nodes[i + 1] - nodes[i]
            beta, gamma, torsion = strain[robot, cell[i]]
            total[i + 1, 0] = total[i, 0] + length * beta
            total[i + 1, 1] = total[i, 1] + length * gamma
            _step(-gamma, beta, torsion, length, place, frame, i)
        for j in range(len(joints)):
            _angle(place, frame, joints[j], at_joints[robot, j])
        for j in range(len(spans)):
            for k in range(2):
                over_spans[robot, j, k] = total[spans[j, 1], k] - total[spans[j, 0], k]


@_kernel
def _step(x, y, z, length, place, frame, i):
    """Go along an arc with the rotation (x, y, z) [1/m] to the next node."""
    turn = length * np.sqrt(x * x + y * y + z * z)
    if turn < 1e-3:
        a, b = 1 - turn**2 / 6, 0.5 - turn**2 / 24
        c = 1 / 6 - turn**2 / 120
    else:
        a, b = np.sin(turn) / turn, (1 - np.cos(turn)) / turn**2
        c = (turn - np.sin(turn)) / turn**3
    x, y, z = x * length, y * length, z * length
    w = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    for r in range(3):
        way = 0.0
        for s in range(3):
            new = frame[i, r, s]
            for t in range(3):
                square = 0.0
                for u in range(3):
                    square += w[t, u] * w[u, s]
                new += frame[i, r, t] * (a * w[t, s] + b * square)
            frame[i + 1, r, s] = new
        for t in range(3):
            square = 0.0
            for u in range(3):
                square += w[t, u] * w[u, 2]
            way += frame[i, r, t] * ((1.0 if t == 2 else 0.0) + b * w[t, 2] + c * square)
        place[i + 1, r] = place[i, r] + length * way


@_kernel
def _angle(place, frame, nodes, out):
    """Set the angle (2,) from a chord to the next, along the axes of the section between them."""
    before, after = np.zeros(3), np.zeros(3)
    for k in range(3):
        for r in range(3):
            axis = frame[nodes[1], r, k]
            before[k] += axis * (place[nodes[1], r] - place[nodes[0], r])
            after[k] += axis * (place[nodes[2], r] - place[nodes[1], r])
    x = before[1] * after[2] - before[2] * after[1]
    y = before[2] * after[0] - before[0] * after[2]
    z = before[0] * after[1] - before[1] * after[0]
    sine = np.sqrt(x * x + y * y + z * z)
    cosine = before[0] * after[0] + before[1] * after[1] + before[2] * after[2]
    scale = np.arctan2(sine, cosine) / sine if sine > 0 else 0.0
    out[0], out[1] = y * scale, -x * scale
    if sine != sine:  # not a number: a state that diverged
        out[0] = out[1] = sine
