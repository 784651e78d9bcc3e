"""A chain linearised about an equilibrium: its natural frequencies, and how its tip answers inputs.

About an equilibrium under constant inputs u (tensions, or lengths that servos hold),

    M q'' + D q' + K q = B (u - u0),    tip - tip0 = J q,

with the exact tangent K of `scene.tangent`, so that weight, loads, guides and elastic tendons count
as they do there.
"""

from typing import NamedTuple

import numpy as np

from softrobot_env.scene.inverse import InverseStatics
from softrobot_env.scene.tangent import StaticForces

_SHARE = 1e-6  # of the largest inputs, of a difference quotient


class LinearChain(NamedTuple):
    """A chain near an equilibrium.

    Attributes:
        mass, damping, stiffness: (nv, nv) of small turns of the joints, [kg m2] and so on.
        by_inputs: (nv, n_inputs), force by the robot's inputs.
        tip: (3, nv) [m], motion of the tip by small turns.
    """

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    by_inputs: np.ndarray
    tip: np.ndarray

    @property
    def frequencies(self) -> np.ndarray:
        """Natural frequencies (nv,) [Hz] without damping, the lowest first."""
        squared = np.linalg.eigvals(np.linalg.solve(self.mass, self.stiffness)).real
        return np.sqrt(np.sort(squared)) / (2 * np.pi)

    def response(self, rate: float) -> np.ndarray:
        """Complex amplitudes (3, n_inputs) [m] of the tip by those of inputs at a rate [rad/s]."""
        dynamic = self.stiffness - rate**2 * self.mass + 1j * rate * self.damping
        return self.tip @ np.linalg.solve(dynamic, self.by_inputs)


def linearised(inverse: InverseStatics, inputs: np.ndarray) -> LinearChain:
    """The chain of inverse statics about its equilibrium under inputs (n_inputs,).

    Raises:
        EquilibriumError: There is none, or it is unstable.
    """
    scene, inputs = inverse.scene, np.asarray(inputs, dtype=float)
    posture, forces = inverse.posture(inputs), StaticForces(scene.model)

    def force(values: np.ndarray) -> np.ndarray:
        controls = np.zeros(scene.model.nu)
        commanded = inverse.inputs.command(values)
        controls[: len(commanded)] = commanded
        return forces.force(posture, controls).copy()

    steps = _SHARE * np.diag(inverse.inputs.input_scale)
    by_inputs = [(force(inputs + h) - force(inputs - h)) / (2 * h.max()) for h in steps]
    force(inputs)
    damping = np.diag(scene.model.dof_damping)
    return LinearChain(
        forces.mass(),
        damping,
        -forces.tangent(),
        np.array(by_inputs).T,
        forces.tip_by_turns()[1],
    )
