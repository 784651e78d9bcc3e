"""The rig with other tendons, stiffness and damping, and what its servos do."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from softrobot_env.benchmarks.stability.runs import ChainSystem
from softrobot_env.robots import RIG, SERVO_SPEED, RobotParams
from softrobot_env.scene.config import SceneConfig

#: [s], control period of the rig's environments.
PERIOD = 0.02

#: Bend that the lengths belong to [m], and its azimuth [rad], between the tendons.
_PULL, _AZIMUTH = 6e-3, 0.4

#: [m], by which all tendons are let out until they hang slack; [s] between the commands.
_SLACK, _HOLD = -15e-3, 0.4

#: Way [m] of a servo in a control period.
_REACH = SERVO_SPEED * PERIOD

#: [s] simulated.
DURATION = 1.6


@dataclass(frozen=True)
class Variation:
    """What differs from the rig.

    Attributes:
        tendon_stiffness, modulus, damping: Factors [1]; that of Young's modulus keeps the damping
            time.
        pretension, friction: [N] of every tendon.
        motion: Key of `MOTIONS`.
    """

    tendon_stiffness: float = 1.0
    modulus: float = 1.0
    damping: float = 1.0
    pretension: float = RIG.tendons[0].pretension
    friction: float = 0.0
    motion: str = "bend"

    def robot(self) -> RobotParams:
        """The rig so varied."""
        varied = RIG.vary(youngs_modulus=self.modulus, damping_time=self.damping)
        tendons = (
            replace(
                tendon,
                stiffness=self.tendon_stiffness * tendon.stiffness,
                pretension=self.pretension,
                friction=self.friction,
            )
            for tendon in varied.tendons
        )
        return replace(varied, tendons=tuple(tendons))

    def system(self, n: int) -> ChainSystem:
        """The chain on n joints, straight, whose servos follow the motion."""
        config = SceneConfig(
            self.robot(),
            pieces=n // 2,
            actuation="length",
            bending="spatial",
            control_period=PERIOD,
        )
        return ChainSystem(config, np.zeros(2 * n), MOTIONS[self.motion])


def _bent(size: float) -> np.ndarray:
    """Lengths (3,) [m] that fit together: each by its tendon's place in the bend."""
    return size * np.cos(_AZIMUTH - 2 * np.pi * np.arange(3) / 3)


def _toward(targets: np.ndarray) -> Callable[[float], np.ndarray]:
    """Lengths over time of servos that hold each of targets (k, 3) [m] for a while."""
    path, lengths = [], np.zeros(3)
    for target in targets:
        for _ in range(round(_HOLD / PERIOD)):
            lengths = lengths + np.clip(target - lengths, -_REACH, _REACH)
            path.append(lengths)
    return lambda time: path[min(int(time / PERIOD + 1e-6), len(path) - 1)]


#: What the servos do: bend to one side, to the other and back; or let out all tendons until they
#: are slack, and tighten them again in a bend.
MOTIONS = {
    "bend": _toward(np.array([_bent(_PULL), _bent(-_PULL), _bent(_PULL), np.zeros(3)])),
    "slack": _toward(np.array([_bent(_PULL), np.full(3, _SLACK), _bent(-_PULL), np.zeros(3)])),
}
