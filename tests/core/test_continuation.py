"""How equilibria are found: steps from a guess, and along the path of growing loads."""

import numpy as np
import pytest

from softrobot_env.core.continuation import Newton, find_equilibrium
from softrobot_env.core.equilibrium import EquilibriumError


class Spring:
    """A body on a spring: stiff within a unit of its rest, and soft beyond; counts stiffnesses.

    Full steps of Newton's method go to and fro between the soft parts.
    """

    def __init__(self, load=0.0, stiff=10.0, soft=0.1, scale=1000.0):
        self.load, self.stiff, self.soft, self.scale = load, stiff, soft, np.array([scale])
        self.stiffnesses, self.again_calls = 0, 0

    def _force(self, q, share):
        inner = np.clip(q, -1.0, 1.0)
        return share * self.load - self.stiff * inner - self.soft * (q - inner)

    def newton(self, q, share):
        self.stiffnesses += 1
        self._rate = self.stiff if abs(q[0]) < 1 else self.soft
        return Newton(self._force(q, share) / self._rate, np.array([self.load / self._rate]))

    def again(self, q, share):
        self.again_calls += 1
        return self._force(q, share) / self._rate

    def moved(self, q, change):
        return q + change


@pytest.mark.parametrize("start", [5.0, -30.0])
def test_kinks_between_the_guess_and_the_equilibrium_are_passed(start):
    found = find_equilibrium(Spring(load=2.0), np.zeros(1), np.array([start]), 1, nearby=True)
    assert found == pytest.approx([0.2], abs=1e-9)


def test_a_guess_too_far_to_arrive_from_is_given_up_at_once():
    spring = Spring(scale=1.0)
    with pytest.raises(EquilibriumError, match="near the guess"):
        find_equilibrium(spring, np.zeros(1), np.array([50.0]), 1, nearby=True)
    assert spring.stiffnesses == 1


class Pendulum:
    """A weightless arm on a torsion spring, pulled sideways at its end."""

    load, scale = 5.0, np.array([2.0])

    def __init__(self):
        self.stiffnesses = self.again_calls = 0

    def _force(self, q, share):
        return share * self.load * np.cos(q) - q

    def newton(self, q, share):
        self.stiffnesses += 1
        self._rate = 1 + share * self.load * np.sin(q)
        return Newton(self._force(q, share) / self._rate, self.load * np.cos(q) / self._rate)

    def again(self, q, share):
        self.again_calls += 1
        return self._force(q, share) / self._rate

    def moved(self, q, change):
        return q + change


def test_corrections_along_a_path_reuse_its_stiffness():
    arm = Pendulum()
    q = find_equilibrium(arm, np.zeros(1), None, 8)
    assert q == pytest.approx(5 * np.cos(q), abs=1e-9)
    assert arm.again_calls > arm.stiffnesses
