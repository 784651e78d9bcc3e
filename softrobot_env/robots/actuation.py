"""From reduced inputs to tendon tensions: the actuation redundancy of opposing tendons."""

from copy import copy

import numpy as np

from softrobot_env.robots.parameters import RobotParams, Tendon


class TendonMap:
    """Resolves the actuation redundancy of opposing tendons (secs. 3.1.2 and 6.2.2).

    The tensions of a pair that produce the reduced input u are known up to a common tension; the
    map returns the smallest ones that respect the pretension: F_k = max(F~_k - F~_j, 0) + F_pre,
    where j opposes k and F~ = pinv(Phi) u (audit of (3.3) to (3.5)). That is (6.8): one tendon
    pulls, the other keeps its pretension.

    Attributes:
        phi: (n_inputs, n_tendons), reduced input u = phi @ tension.
        input_scale: (n_inputs,) [N], reduced input of a full-scale action.
    """

    def __init__(self, robot: RobotParams) -> None:
        groups = [t.group for t in robot.tendons]
        if groups != sorted(groups):
            raise ValueError(f"robot {robot.name!r}: order the tendons by group")
        pairs = [[t for t in robot.tendons if t.group == g] for g in sorted(set(groups))]
        self.phi = np.zeros((len(pairs), len(robot.tendons)))
        for k, pair in enumerate(pairs):
            self.phi[k, 2 * k : 2 * k + 2] = _sides(robot, pair)
        self.input_scale = np.array([p[0].tension_limit - p[0].pretension for p in pairs])
        self._pretension = np.array([t.pretension for t in robot.tendons])
        self._pretensioned = bool(self._pretension.any())
        spread = np.linalg.pinv(self.phi)
        opposing = np.arange(len(robot.tendons)) ^ 1
        self._difference = (spread - spread[opposing]).T

    @property
    def n_inputs(self) -> int:
        """Number of reduced inputs."""
        return self.phi.shape[0]

    def per_action(self) -> "TendonMap":
        """The same map for actions: its `tension` takes multiples [1] of `input_scale`."""
        scaled = copy(self)
        scaled._difference = self._difference * self.input_scale[:, None]
        return scaled

    def tension(self, reduced: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Tensions (..., n_tendons) [N] >= pretension for reduced inputs (..., n_inputs) [N]."""
        out = np.maximum(reduced.dot(self._difference), 0.0, out=out)
        if self._pretensioned:
            out += self._pretension
        return out

    def reduced(self, tension: np.ndarray) -> np.ndarray:
        """Reduced inputs (..., n_inputs) [N] that tensions (..., n_tendons) [N] produce."""
        return np.asarray(tension) @ self.phi.T


def _sides(robot: RobotParams, tendons: list[Tendon]) -> np.ndarray:
    """Phi (2,) of one group: the side (+1 or -1) of the neutral fibre each tendon pulls to."""
    offsets = np.array([t.offset for t in tendons])
    sides, beside = offsets.T
    straight = all(t.is_straight for t in tendons)
    if len(tendons) != 2 or not straight or beside.any() or sides.sum() != 0 or not sides.any():
        raise ValueError(
            f"robot {robot.name!r}: a planar tendon group is a pair at offsets (r, 0) and (-r, 0), "
            f"straight, got {[t.offset for t in tendons]}"
        )
    if len({(t.end, t.tension_limit, t.pretension) for t in tendons}) > 1:
        raise ValueError(
            f"robot {robot.name!r}: opposing tendons need the same end, tension_limit and "
            f"pretension, unlike {' and '.join(t.name for t in tendons)}"
        )
    return np.sign(sides)
