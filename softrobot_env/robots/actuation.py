"""From reduced inputs to tendon tensions: the actuation redundancy of opposing tendons."""

from copy import copy

import numpy as np

from softrobot_env.robots.parameters import RobotParams, Tendon


class TendonMap:
    """Resolves the actuation redundancy of opposing tendons (secs. 3.1.2 and 6.2.2).

    Within a group the tensions that produce the reduced input u are known up to a common
    tension; the map returns the smallest ones that respect the pretension:
    F_k = max_j (F~_k - F~_j) + F_pre with F~ = pinv(Phi) u (audit of (3.3) to (3.5)).
    For a pair this is (6.8): one tendon pulls, the other keeps its pretension.

    Attributes:
        phi: (n_inputs, n_tendons), reduced input u = phi @ tension.
        input_scale: (n_inputs,) [N], reduced input of a full-scale action.
    """

    def __init__(self, robot: RobotParams) -> None:
        groups = [t.group for t in robot.tendons]
        if groups != sorted(groups):
            raise ValueError(f"robot {robot.name!r}: order the tendons by group")
        blocks = [[t for t in robot.tendons if t.group == g] for g in sorted(set(groups))]
        self.phi = _block_diagonal([_directions(robot, block) for block in blocks])
        self.input_scale = np.array([b[0].tension_limit - b[0].pretension for b in blocks])
        self._pretension = np.array([t.pretension for t in robot.tendons])
        self._pretensioned = bool(self._pretension.any())
        self._differences = _group_differences(self.phi, [len(b) for b in blocks])
        self._zero = np.zeros(len(robot.tendons))

    @property
    def n_inputs(self) -> int:
        """Number of reduced inputs."""
        return self.phi.shape[0]

    def per_action(self) -> "TendonMap":
        """The same map for actions: its `tension` takes multiples [1] of `input_scale`."""
        scaled = copy(self)
        scaled._differences = [d * self.input_scale for d in self._differences]
        return scaled

    def tension(self, reduced: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Tensions (n_tendons,) [N] >= pretension for reduced inputs (n_inputs,) [N]."""
        out = np.empty_like(self._zero) if out is None else out
        low = self._zero
        for difference in self._differences:
            np.maximum(difference.dot(reduced), low, out=out)
            low = out
        if self._pretensioned:
            out += self._pretension
        return out

    def tensions(self, reduced: np.ndarray) -> np.ndarray:
        """As `tension`, for many: (n, n_tendons) [N] for reduced inputs (n, n_inputs) [N]."""
        out = np.zeros((len(reduced), len(self._zero)))
        for difference in self._differences:
            np.maximum(reduced @ difference.T, out, out=out)
        return out + self._pretension if self._pretensioned else out

    def reduced(self, tension: np.ndarray) -> np.ndarray:
        """Reduced inputs (..., n_inputs) [N] that tensions (..., n_tendons) [N] produce."""
        return np.asarray(tension) @ self.phi.T


def _directions(robot: RobotParams, tendons: list[Tendon]) -> np.ndarray:
    """Phi of one group: the side (+1 or -1) of the neutral fibre each tendon pulls to."""
    offsets = np.array([t.offset for t in tendons])
    if len(tendons) != 2 or np.any(offsets[:, 1] != 0) or offsets[:, 0].sum() != 0:
        raise ValueError(
            f"robot {robot.name!r}: a planar tendon group is a pair at offsets (r, 0) and (-r, 0), "
            f"got {[t.offset for t in tendons]}"
        )
    if len({(t.end, t.tension_limit, t.pretension) for t in tendons}) > 1:
        raise ValueError(
            f"robot {robot.name!r}: opposing tendons need the same end, tension_limit and "
            f"pretension, unlike {' and '.join(t.name for t in tendons)}"
        )
    return np.sign(offsets[:, :1].T)


def _block_diagonal(blocks: list[np.ndarray]) -> np.ndarray:
    """As scipy.linalg.block_diag, whose import takes longer than all of `gymnasium.make`."""
    shape = np.sum([b.shape for b in blocks], axis=0) if blocks else (0, 0)
    out = np.zeros(shape)
    row = column = 0
    for block in blocks:
        out[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    return out


def _group_differences(phi: np.ndarray, sizes: list[int]) -> list[np.ndarray]:
    """Matrices (n_tendons, n_inputs) whose products with u are F~_k - F~_(k+shift)."""
    spread = np.linalg.pinv(phi)
    starts = np.cumsum([0, *sizes])
    differences = []
    for shift in range(1, max(sizes, default=1)):
        other = [a + (k + shift) % n for a, n in zip(starts, sizes, strict=False) for k in range(n)]
        differences.append(spread - spread[other])
    return differences or [np.zeros((0, 0))]
