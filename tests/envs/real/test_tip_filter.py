"""What measurements of the tip say of its motion and of its error."""

import numpy as np
import pytest
from gymnasium import spaces

from softrobot_env.envs.real.tip_filter import TipFilter, reference_at
from softrobot_env.hardware.tip import Sight


def test_velocity_is_by_difference_of_different_pictures():
    tip = TipFilter(Sight(1.0, np.zeros(2)), spaces.Box(-1.0, 1.0, (2,), np.float64))
    assert tip.velocity.tolist() == [0.0, 0.0]
    tip.add(Sight(1.01, np.array([0.002, -0.001])))
    assert tip.velocity == pytest.approx([0.2, -0.1])
    tip.add(Sight(1.01, np.array([0.002, -0.001])))
    assert tip.velocity == pytest.approx([0.2, -0.1])


def test_reference_between_control_instants():
    points = np.array([[0.0, 0.0], [1.0, 10.0], [2.0, 40.0]])
    assert reference_at(points, 1.5) == pytest.approx([1.5, 25.0])
    assert reference_at(points, -1.0) == pytest.approx([0.0, 0.0])
